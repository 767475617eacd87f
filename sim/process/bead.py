"""Metal added under the melt pool: what the pool catches settles as a cap over the surface that it finds, and no volume is lost.

The pool is a disc of the bead's width that travels with the spot. Each piece of path brings a volume; it fills the columns under the
disc up to one common level plus the parabolic cap of the bead, so a track on a flat plate is the parabola of `melt`, a second layer
stands on the first with an upright wall, overlapping tracks fill the valley between them, and both ends of a track are round.

Width and catch follow from what the spot meets (`spot`) and from the part's temperature (`heat`). Light without powder melts the
surface and leaves it as it is, but for its mark. Powder without light is lost. What hangs over an edge sags (`sag`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import Material
from config.cell import Tool
from sim.process.field import BLOCK, Blocks, Field, put
from sim.process.heat import HeatLaw, add_metal, heat_law, heat_step
from sim.process.melt import MeltLaw, bead_at, melt_law
from sim.process.pool import HANGING, HOLDING, RESTING, fill_column, is_metal, level_of, surface_below, underside
from sim.process.sag import ADHESION_WIDTHS, DROOP_HEIGHTS, droop_mm, hang_lengths, run_slope
from sim.process.spot import FALL_MM, meet
from sim.process.window import Frame, Window, cell_of, close_window, frame_of, open_window, turned

Array = NDArray[np.float64]

REACH_HEIGHTS = 1.5  # of the bead's height below the pool's plane: what lies deeper the pool does not touch
REACH_WIDTHS = 0.25  # of its width, for flat beads: they are molten that deep
WIDEST_MM = 12.0  # of a pool: no set-points of a material's window come near, and the stock makes room for it
TALLEST_MM = 10.0  # of what one piece fills, from the lowest column that it touches
THIN_MM = 0.01  # high: a bead of so little powder is a remelted surface
RUN_MM = 1.5  # of path that a window of the stock is opened for
ACROSS = 1e-3  # component of gravity across the axis below which the pool does not run
# columns of a piece; POOL_SPEED 0 is time without a pool, LINE the N-word, MOVE the piece of the trace that ended it
START, END, AXIS, DOWN, POWER, POWDER, SECONDS, POOL_SPEED, LINE, MOVE = 0, 3, 6, 9, 12, 13, 14, 15, 16, 17
PIECE_COLUMNS = 18
# columns of what was laid
WIDTH, HEIGHT, CATCH, DEFOCUS, UNSUPPORTED, BASE_K = range(6)
LAID_COLUMNS = 6


class PoolLaw(NamedTuple):
    """melt, heat : the laws of `melt` and `heat`   min_power_w : below it nothing melts   hold_tan : tangent of the overhang that holds."""

    melt: MeltLaw
    heat: HeatLaw
    min_power_w: float
    hold_tan: float


def pool_law(material: Material, tool: Tool) -> PoolLaw:
    """The law for one material under one deposition head."""
    hold = float(np.tan(np.radians(material.deposition.max_overhang_deg)))
    return PoolLaw(melt_law(material, tool), heat_law(material), material.bead.min_power_w, hold)


class Pool(NamedTuple):
    """One piece in the turned frame, mm: start, way across the axis, axis, gravity (unit vectors), plane's height along the axis, bead's figures."""

    start: Array
    way: Array
    axis: Array
    down: Array
    plane: float
    width: float
    height: float
    reach: float
    hold_tan: float


@njit(cache=True, nogil=True)
def box_of(pool: Pool, frame: Frame, cell: float, band: float, ahead_mm: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last (exclusive) cell of the turned frame that a pool may read or change, (3,) each, and as it goes on for `ahead_mm`."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    axis = pool.axis
    length = np.sqrt(pool.way[0] ** 2 + pool.way[1] ** 2 + pool.way[2] ** 2)
    goes_on = ahead_mm / length if length > 0.0 else 0.0
    spare = 2 if ahead_mm > 0.0 else 0  # the next pool may be a little wider
    deep = pool.reach + 2.0 * cell
    tall = pool.reach + 2.0 * pool.height + 2.0 * cell
    shift = pool.plane - (pool.start[0] * axis[0] + pool.start[1] * axis[1] + pool.start[2] * axis[2])
    for d in range(3):
        at = pool.start[d] + shift * axis[d]
        on = pool.way[d] * (1.0 + goes_on)
        side = 0.5 * pool.width * np.sqrt(max(0.0, 1.0 - axis[d] * axis[d]))
        below, above = deep * max(axis[d], 0.0) + tall * max(-axis[d], 0.0), tall * max(axis[d], 0.0) + deep * max(-axis[d], 0.0)
        if d == 2:
            below, above = below / axis[2] ** 2 + 2.0 * band / axis[2], above / axis[2] ** 2 + band / axis[2]
        origin = frame.x0 if d == 0 else (frame.y0 if d == 1 else frame.z0)
        low[d] = int(np.floor((at + min(0.0, on) - side - below - origin) / cell)) - spare
        high[d] = int(np.ceil((at + max(0.0, on) + side + above - origin) / cell)) + 1 + spare
    low[2], high[2] = max(low[2], 0), min(high[2], frame.length)
    return low, high


@njit(cache=True, nogil=True)
def columns_under(window: Window, cell: float, pool: Pool, box: NDArray[np.int64]) -> tuple[int, NDArray[np.int64], Array, NDArray[np.int8]]:
    """Columns under the pool: how many; their indices (n, 2) in the box; [height along the axis, found height in the column, cap, way down
    across the axis] (n, 4) in mm; the kind of all columns of the box.

    box : (2, 2) int   First and last (exclusive) column of the window.
    """
    radius, axis, start, way = 0.5 * pool.width, pool.axis, pool.start, pool.way
    nx, ny = max(0, box[1, 0] - box[0, 0]), max(0, box[1, 1] - box[0, 1])
    kind = np.full((nx, ny), -1, np.int8)
    index, of = np.empty((nx * ny, 2), np.int64), np.empty((nx * ny, 4))
    length2 = way[0] ** 2 + way[1] ** 2 + way[2] ** 2
    upright = axis[2] > 1.0 - 1e-9
    level = start[0] * axis[0] + start[1] * axis[1] + start[2] * axis[2]
    thin = (DROOP_HEIGHTS * pool.height) / cell + 0.5  # metal that hangs from this very pool may be as thick: it carries nothing
    count = 0
    for i in range(nx):
        x = window.x0 + (box[0, 0] + i) * cell
        for j in range(ny):
            y = window.y0 + (box[0, 1] + j) * cell
            at = (pool.plane - x * axis[0] - y * axis[1]) / axis[2]  # height at which the column meets the pool's plane
            if upright:
                ox, oy = across(x - start[0], y - start[1], 0.0, way, length2)[:2]
                if ox * ox + oy * oy >= radius * radius:
                    continue
            column = window.value[box[0, 0] + i, box[0, 1] + j]
            k_plane = (at - window.z0) / cell
            k = surface_below(column, int(np.ceil(k_plane + 1.0)), max(0, int(np.floor(k_plane - pool.reach / cell))))
            z = window.z0 + k * cell if k >= 0.0 else at
            depth = (x - start[0]) * axis[0] + (y - start[1]) * axis[1] + (z - start[2]) * axis[2]
            met = z if z <= at + pool.reach else at  # what stands far above the pool's plane is met in the plane
            dx, dy, dz = x - start[0], y - start[1], met - start[2]
            off = dx * axis[0] + dy * axis[1] + dz * axis[2]
            ox, oy, oz = across(dx - off * axis[0], dy - off * axis[1], dz - off * axis[2], way, length2)
            distance2 = (ox * ox + oy * oy + oz * oz) / (radius * radius)
            if distance2 >= 1.0:
                continue
            kind[i, j] = HANGING
            if k >= 0.0:
                kind[i, j] = HOLDING if is_metal(column, min(k, k_plane) - thin) else RESTING
            index[count, 0], index[count, 1] = i, j
            of[count, 0], of[count, 1], of[count, 2] = level + depth, z, pool.height * (1.0 - distance2)
            of[count, 3] = ox * pool.down[0] + oy * pool.down[1] + oz * pool.down[2]
            count += 1
    return count, index, of, kind


@njit(cache=True, nogil=True)
def across(x: float, y: float, z: float, way: Array, length2: float) -> tuple[float, float, float]:
    """From the nearest point of the pool's way (from 0) to a point of the plane across the axis."""
    if length2 <= 0.0:
        return x, y, z
    share = min(1.0, max(0.0, (x * way[0] + y * way[1] + z * way[2]) / length2))
    return x - share * way[0], y - share * way[1], z - share * way[2]


@njit(cache=True, nogil=True)
def sag(cell: float, pool: Pool, count: int, index: NDArray[np.int64], of: Array, kind: NDArray[np.int8]) -> int:
    """Let hanging columns droop or fall, in place. Returns how many are left."""
    limit = ADHESION_WIDTHS * pool.width
    hang = hang_lengths(kind, int(limit / cell) + 1)
    along = -(pool.down[0] * pool.axis[0] + pool.down[1] * pool.axis[1] + pool.down[2] * pool.axis[2])
    kept = 0
    for c in range(count):
        i, j = index[c, 0], index[c, 1]
        drop = 0.0
        if kind[i, j] == HANGING:
            drop = droop_mm(hang[i, j] * cell, pool.width, pool.height, pool.hold_tan)
            if drop == np.inf:
                continue
            drop *= along
        index[kept, 0], index[kept, 1] = i, j
        of[kept, 0], of[kept, 1] = of[c, 0] - drop, of[c, 1] - drop / pool.axis[2]
        of[kept, 2], of[kept, 3] = of[c, 2], of[c, 3]
        kept += 1
    return kept


@njit(cache=True, nogil=True)
def settle_volume(window: Window, cell: float, band: float, pool: Pool, box: NDArray[np.int64], volume: float) -> tuple[float, float]:
    """Pour `volume` (mm3) into the pool. Returns the volume that stuck and the share of the pool that hung."""
    axis = pool.axis
    count, index, of, kind = columns_under(window, cell, pool, box)
    holding = hanging = 0
    for c in range(count):
        what = kind[index[c, 0], index[c, 1]]
        holding += what == HOLDING
        hanging += what == HANGING
    if holding == 0:
        return 0.0, 1.0
    kept = sag(cell, pool, count, index, of, kind) if hanging > 0 else count
    held = volume * kept / count
    slope = 0.0
    along = pool.down[0] * axis[0] + pool.down[1] * axis[1] + pool.down[2] * axis[2]
    if 1.0 - along * along > ACROSS * ACROSS:
        slope = run_slope(pool.width)
    free = of[:, 0] - of[:, 2] - slope * of[:, 3]
    level = level_of(free, kept, held * axis[2] / (cell * cell))
    for c in range(kept):
        rise = level - free[c]
        if rise <= 0.0:
            continue
        a, b = box[0, 0] + index[c, 0], box[0, 1] + index[c, 1]
        column, found, top = window.value[a, b], of[c, 1], of[c, 1] + rise / axis[2]
        bottom = found
        if kind[index[c, 0], index[c, 1]] != HANGING:
            bottom = underside(column, window.z0, cell, found, top - 2.0 * band / axis[2])
        first, last = fill_column(column, window.z0, cell, band, bottom, found, top, axis[2])
        window.low[a, b], window.high[a, b] = min(window.low[a, b], first), max(window.high[a, b], last)
    return held, hanging / count


@njit(cache=True, nogil=True)
def remelt(blocks: Blocks, frame: Frame, window: Window, pool: Pool, box: NDArray[np.int64], mark: int) -> None:
    """Light without powder: the surface under the pool gets the mark, its place stays."""
    cell, band = blocks.size[0], blocks.size[1]
    count, index, of, kind = columns_under(window, cell, pool, box)
    for c in range(count):
        if kind[index[c, 0], index[c, 1]] == HANGING:
            continue
        a, b = box[0, 0] + index[c, 0], box[0, 1] + index[c, 1]
        first = int(np.floor((of[c, 1] - window.z0) / cell))
        for n in range(first, min(first + 2, window.value.shape[2])):
            if abs(window.value[a, b, n]) < band:
                x, y, z = cell_of(frame, window.first[0] + a, window.first[1] + b, window.first[2] + n)
                put(blocks, x, y, z, window.value[a, b, n], mark)


@njit(cache=True, nogil=True)
def pool_under(blocks: Blocks, law: PoolLaw, frame: Frame, piece: Array, base_k: float, laid: Array) -> tuple[Pool, float]:
    """The pool of a piece of bead and the volume that it catches (mm3), on metal of `base_k`; fills a row of `laid`. Width 0: no pool."""
    laid[:] = 0.0
    laid[BASE_K] = base_k
    vectors = np.empty((4, 3))
    for row, first in enumerate((START, END, AXIS, DOWN)):
        vectors[row, 0], vectors[row, 1], vectors[row, 2] = turned(frame, piece[first], piece[first + 1], piece[first + 2])
    start, axis, down = vectors[0], vectors[2], vectors[3]
    way = vectors[1] - start
    way -= axis * (way[0] * axis[0] + way[1] * axis[1] + way[2] * axis[2])
    power, powder, speed = piece[POWER], piece[POWDER], piece[POOL_SPEED]
    width = height = area = reach = plane = 0.0
    if power >= law.min_power_w:
        width, height, _, _ = bead_at(law.melt, power, powder, speed, 0.0, 1.0, base_k)
    if width > 0.0:
        rising, cosine, plane = _meet(blocks, piece, 0.5 * min(width, WIDEST_MM), max(REACH_HEIGHTS * height, REACH_WIDTHS * width))
        laid[DEFOCUS], laid[UNSUPPORTED] = FALL_MM, 1.0
        width = 0.0
        if rising > -np.inf:
            laid[DEFOCUS] = -rising
            width, height, area, _ = bead_at(law.melt, power, powder, speed, -rising, cosine, base_k)
            width = min(width, WIDEST_MM)
            reach = max(REACH_HEIGHTS * height, REACH_WIDTHS * width)
    laid[WIDTH], laid[HEIGHT] = width, height
    level = start[0] * axis[0] + start[1] * axis[1] + start[2] * axis[2] + plane
    return Pool(start, way, axis, down, level, width, height, reach, law.hold_tan), area * speed * piece[SECONDS]


@njit(cache=True, nogil=True)
def _meet(blocks: Blocks, piece: Array, radius: float, reach: float) -> tuple[float, float, float]:
    """`meet` for the end of a piece."""
    ax, ay, az = piece[AXIS], piece[AXIS + 1], piece[AXIS + 2]
    tx, ty, tz = piece[END] - piece[START], piece[END + 1] - piece[START + 1], piece[END + 2] - piece[START + 2]
    along = tx * ax + ty * ay + tz * az
    tx, ty, tz = tx - along * ax, ty - along * ay, tz - along * az
    length = np.sqrt(tx * tx + ty * ty + tz * tz)
    if length > 1e-9:
        tx, ty, tz = tx / length, ty / length, tz / length
    else:
        tx = ty = tz = 0.0
    return meet(blocks, piece[END], piece[END + 1], piece[END + 2], ax, ay, az, tx, ty, tz, radius, reach)


@njit(cache=True, nogil=True)
def lay(
    blocks: Blocks, law: PoolLaw, pieces: Array, first: int, mark_of_line: NDArray[np.int16], state: Array, laid: Array, sums: Array,
    room: int,
) -> int:  # fmt: skip
    """Carry out pieces in order of time from `first` on, as long as there is room for `room` more blocks; returns the next one.

    pieces : (n, PIECE_COLUMNS) float   state : (2,) float, of `heat`, changed in place   laid : (n, LAID_COLUMNS) float, filled
    mark_of_line : (m,) int16   Mark by N-word; lines beyond it are marked 1.
    sums : (2,) float   Volumes caught by the pool and stuck, mm3, are added.
    """
    cell, band = blocks.size[0], blocks.size[1]
    frame, frame_mark, is_open = frame_of(blocks, 0.0, 0.0, 1.0), 0, False
    window = open_window(blocks, frame, np.zeros(3, np.int64), np.zeros(3, np.int64))
    for n in range(first, pieces.shape[0]):
        piece, held = pieces[n], 0.0
        if piece[POOL_SPEED] > 0.0:
            wanted, line = frame_of(blocks, piece[AXIS], piece[AXIS + 1], piece[AXIS + 2]), int(piece[LINE])
            mark = int(mark_of_line[line]) if 0 <= line < mark_of_line.shape[0] else 1
            if is_open and (wanted != frame or mark != frame_mark or stands(piece)):
                close_window(blocks, frame, window, frame_mark)
                is_open = False
            frame, frame_mark = wanted, mark
            pool, volume = pool_under(blocks, law, frame, piece, state[0], laid[n])
            if pool.width > 0.0:
                low, high = box_of(pool, frame, cell, band, 0.0)
                if not (is_open and holds(window, low, high)):
                    if is_open:
                        close_window(blocks, frame, window, mark)
                        is_open = False
                    if blocks.count[0] + blocks.value.shape[0] - blocks.count[1] < room:
                        return n
                    window = open_window(blocks, frame, *box_of(pool, frame, cell, band, RUN_MM))
                    is_open = True
                box = np.stack((low[:2], high[:2])) - window.first[:2]
                if volume > 0.0:
                    held, laid[n, UNSUPPORTED] = settle_volume(window, cell, band, pool, box, volume)
                    laid[n, CATCH] = held * law.melt.density * 60.0 / (piece[POWDER] * piece[SECONDS])
                if pool.height < THIN_MM:
                    close_window(blocks, frame, window, mark)
                    remelt(blocks, frame, window, pool, box, mark)
            sums[0] += volume
            sums[1] += held
        heat_step(law.heat, state, law.melt.absorptivity * piece[POWER], piece[SECONDS])
        if held > 0.0:
            add_metal(law.heat, state, held * law.melt.density)
    close_window(blocks, frame, window, frame_mark)
    return int(pieces.shape[0])


@njit(cache=True, nogil=True)
def stands(piece: Array) -> bool:
    """Whether a piece has no length: its pool rises on itself, and the next look at the surface has to see that."""
    return bool(piece[START] == piece[END] and piece[START + 1] == piece[END + 1] and piece[START + 2] == piece[END + 2])


@njit(cache=True, nogil=True)
def holds(window: Window, low: NDArray[np.int64], high: NDArray[np.int64]) -> bool:
    """Whether a box of the turned frame is within a window."""
    within = True
    for d in range(3):
        within &= low[d] >= window.first[d] and high[d] <= window.first[d] + window.value.shape[d]
    return within


def lay_pieces(field: Field, law: PoolLaw, pieces: Array, mark_of_line: NDArray[np.int16], state: Array) -> tuple[Array, float, float]:
    """Carry out pieces in order of time. Returns what was laid (n, LAID_COLUMNS) and the volumes caught by the pool and stuck, mm3.

    pieces : (n, PIECE_COLUMNS) float   mark_of_line : (m,) int16, mark by N-word   state : (2,) float, of `heat`, changed in place
    """
    laid, sums = np.zeros((len(pieces), LAID_COLUMNS)), np.zeros(2)
    edge = BLOCK * field.cell_mm
    room = int((WIDEST_MM / edge + 3.0) ** 2 * (TALLEST_MM / edge + 3.0))
    done = 0
    field.refresh_if_due()
    while done < len(pieces):
        field.reserve_blocks(room)
        done = lay(field.blocks, law, pieces, done, mark_of_line, state, laid, sums, room)
    return laid, float(sums[0]), float(sums[1])
