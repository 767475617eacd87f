"""The volume that a turning cutter sweeps on one piece of its path, as a signed distance: flat, bull-nose and ball end mills.

The cutter is a convex solid of revolution, its flutes only. On a piece the cutter's end and its axis go linearly with the share of the piece.
The distance to the swept volume is the least distance to the cutter over that share:
- axis still, motion straight across it or straight along it: in closed form;
- axis still, motion both across and along it: the distance to a convex body that moves straight is convex in the share, a golden section
  finds the least (Kiefer, Sequential minimax search for a maximum, 1953);
- axis turning: seen from the cutter the point goes along a path that is bent by at most `bend_mm`. Pieces are split until that is a small part
  of a cell (`pieces_of`); samples bracket the least, a golden section finds it.
The distance to a union of bodies is 1-Lipschitz in the point: one look at the middle of a block tells about all its cells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

GOLDEN = 0.6180339887498949
SHARPNESS = 0.01  # of a cell: what the search for the least leaves
BEND = 0.05  # of a cell: a piece whose points bend more, seen from the cutter, is split
STILL = 0.005  # of a cell: an axis that moves the cutter's far end by less stands still
SAMPLES = 4  # shares of a turning piece that are looked at first, less one
PARALLEL = 1e-9  # mm
EVER = 1e9  # mm: a cutter without an upper end


class Sweep(NamedTuple):
    """One piece of path of one cutter. mm and unit vectors, build frame.

    x, y, z : the cutter's end at the begin   mx, my, mz : its motion   ax, ay, az : axis at the begin, not normalised
    bx, by, bz : change of the axis over the piece   ux, uy, uz : axis in the middle, unit   vx, vy, vz : direction across it of the motion, unit
    length, lift : of the motion across and along the middle axis   turn : angle of the axis over the piece, rad; 0: stands still
    radius, corner, flute : of the cutter; corner 0 flat, = radius ball; flute is the length that cuts   sharp : mm that the search leaves
    """

    x: float
    y: float
    z: float
    mx: float
    my: float
    mz: float
    ax: float
    ay: float
    az: float
    bx: float
    by: float
    bz: float
    ux: float
    uy: float
    uz: float
    vx: float
    vy: float
    vz: float
    length: float
    lift: float
    turn: float
    radius: float
    corner: float
    flute: float
    sharp: float


@njit(cache=True, nogil=True)
def cutter_distance(radial: float, axial: float, radius: float, corner: float, flute: float = EVER) -> float:
    """Signed distance (mm, negative inside) to an end mill that cuts up to `flute` above its end.

    radial, axial : distance from the axis, and height above the cutter's end, mm. corner : 0 flat, = radius ball.
    """
    above = axial - flute
    if above > 0.0:
        beside = radial - radius
        return float(np.sqrt(beside * beside + above * above)) if beside > 0.0 else float(above)
    r = radial - (radius - corner)
    z = corner - axial
    lower = np.sqrt(r * r + z * z) - corner if r > 0.0 and z > 0.0 else max(r, z) - corner
    return float(max(lower, above))


@njit(cache=True, nogil=True)
def bend_mm(move: Array, turn: float, radius: float, flute: float) -> float:
    """How far the path of a point, seen from a cutter that turns by `turn` (rad) while it goes by `move` (mm), is from straight."""
    step = min(np.sqrt(move[0] ** 2 + move[1] ** 2 + move[2] ** 2), 2.0 * radius)
    return float(0.125 * flute * turn * turn + 0.25 * step * turn)


@njit(cache=True, nogil=True)
def pieces_of(start: Array, end: Array, axis0: Array, axis1: Array, radius: float, flute: float, cell: float) -> int:
    """Into how many pieces a sweep is split so that each bends by less than BEND cells."""
    cross = np.cross(axis0, axis1)
    turn = np.arctan2(np.sqrt(cross[0] ** 2 + cross[1] ** 2 + cross[2] ** 2), np.dot(axis0, axis1))
    if turn * flute < STILL * cell:
        return 1
    return max(1, int(np.ceil(np.sqrt(bend_mm(end - start, turn, radius, flute) / (BEND * cell)))))


@njit(cache=True, nogil=True)
def sweep_of(start: Array, end: Array, axis0: Array, axis1: Array, share0: float, share1: float, cutter: Array, cell: float) -> Sweep:
    """The part of a piece between two shares of it. start, end, axis0, axis1 : (3,); cutter : (3,) radius, corner, flute, mm."""
    radius, corner, flute = cutter[0], min(cutter[1], cutter[0]), max(cutter[2], cutter[1])
    change = axis1 - axis0
    begin, move = start + share0 * (end - start), (share1 - share0) * (end - start)
    first, turned = axis0 + share0 * change, (share1 - share0) * change
    unit = first + 0.5 * turned
    size = np.sqrt(np.dot(unit, unit))
    unit = unit / size
    turn = np.sqrt(np.dot(turned, turned)) / size
    if turn * flute < STILL * cell:
        turn = 0.0
    lift = np.dot(move, unit)
    across = move - lift * unit
    length = np.sqrt(np.dot(across, across))
    across = across / length if length > PARALLEL else 0.0 * across
    return Sweep(
        begin[0], begin[1], begin[2], move[0], move[1], move[2], first[0], first[1], first[2], turned[0], turned[1], turned[2],
        unit[0], unit[1], unit[2], across[0], across[1], across[2], length, lift, turn, radius, corner, flute, SHARPNESS * cell,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def sweep_bound(s: Sweep, x: float, y: float, z: float) -> float:
    """Never more than the distance from a point to the swept volume, mm; the distance itself if the axis stands still and `is_plain`."""
    dx, dy, dz = x - s.x, y - s.y, z - s.z
    axial = dx * s.ux + dy * s.uy + dz * s.uz
    ahead = dx * s.vx + dy * s.vy + dz * s.vz
    far2 = dx * dx + dy * dy + dz * dz
    past = ahead - min(s.length, max(0.0, ahead))
    radial = np.sqrt(max(0.0, far2 - axial * axial - ahead * ahead + past * past))
    bound = cutter_distance(radial, axial - min(0.0, s.lift), s.radius, s.corner, s.flute + abs(s.lift))
    if s.turn > 0.0:
        bound -= 0.5 * s.turn * (np.sqrt(far2) + s.length + abs(s.lift))
    return float(bound)


@njit(cache=True, nogil=True)
def is_plain(s: Sweep) -> bool:
    """Whether `sweep_bound` is the distance itself."""
    return s.turn == 0.0 and (s.length <= PARALLEL or abs(s.lift) <= PARALLEL)


@njit(cache=True, nogil=True)
def distance_at_share(s: Sweep, dx: float, dy: float, dz: float, share: float) -> float:
    """Signed distance to the cutter at one share of the piece. dx, dy, dz : from the cutter's end at the begin, mm."""
    px, py, pz = dx - share * s.mx, dy - share * s.my, dz - share * s.mz
    if s.turn > 0.0:
        ux, uy, uz = s.ax + share * s.bx, s.ay + share * s.by, s.az + share * s.bz
        axial = (px * ux + py * uy + pz * uz) / np.sqrt(ux * ux + uy * uy + uz * uz)
    else:
        axial = px * s.ux + py * s.uy + pz * s.uz
    radial = np.sqrt(max(0.0, px * px + py * py + pz * pz - axial * axial))
    return cutter_distance(radial, axial, s.radius, s.corner, s.flute)


@njit(cache=True, nogil=True)
def least_between(s: Sweep, dx: float, dy: float, dz: float, share0: float, share1: float, steps: int) -> float:
    """Golden section for the least distance to the cutter between two shares of the piece, mm."""
    a = share1 + GOLDEN * (share0 - share1)
    b = share0 + GOLDEN * (share1 - share0)
    at_a, at_b = distance_at_share(s, dx, dy, dz, a), distance_at_share(s, dx, dy, dz, b)
    for _ in range(steps):
        if at_a < at_b:
            share1, b, at_b = b, a, at_a
            a = share1 + GOLDEN * (share0 - share1)
            at_a = distance_at_share(s, dx, dy, dz, a)
        else:
            share0, a, at_a = a, b, at_b
            b = share0 + GOLDEN * (share1 - share0)
            at_b = distance_at_share(s, dx, dy, dz, b)
    return min(at_a, at_b)


@njit(cache=True, nogil=True)
def sweep_distance(s: Sweep, x: float, y: float, z: float) -> float:
    """Signed distance from a point to the swept volume, mm, negative inside; within `sharp` of the least where it has to be searched."""
    if is_plain(s):
        return sweep_bound(s, x, y, z)
    dx, dy, dz = x - s.x, y - s.y, z - s.z
    speed = np.sqrt(s.mx * s.mx + s.my * s.my + s.mz * s.mz)  # per share
    share0, share1, least = 0.0, 1.0, min(distance_at_share(s, dx, dy, dz, 0.0), distance_at_share(s, dx, dy, dz, 1.0))
    if s.turn > 0.0:
        speed += s.turn * (np.sqrt(dx * dx + dy * dy + dz * dz) + speed)
        best = 0 if distance_at_share(s, dx, dy, dz, 0.0) <= least else SAMPLES
        for n in range(1, SAMPLES):
            sample = distance_at_share(s, dx, dy, dz, n / SAMPLES)
            if sample < least:
                best, least = n, sample
        share0, share1 = max(0.0, (best - 1.0) / SAMPLES), min(1.0, (best + 1.0) / SAMPLES)
    left = speed * (share1 - share0)
    steps = 0
    while left > s.sharp:
        left *= GOLDEN
        steps += 1
    return min(least, least_between(s, dx, dy, dz, share0, share1, steps))


@njit(cache=True, nogil=True)
def sweep_box(s: Sweep, margin: float) -> tuple[Array, Array]:
    """Corners (3,) mm of a box round the swept volume and a margin."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for n in range(2):
        ux, uy, uz = s.ax + n * s.bx, s.ay + n * s.by, s.az + n * s.bz
        size = np.sqrt(ux * ux + uy * uy + uz * uz)
        unit = np.array([ux, uy, uz]) / size
        foot = np.array([s.x + n * s.mx, s.y + n * s.my, s.z + n * s.mz])
        for d in range(3):
            side = s.radius * np.sqrt(max(0.0, 1.0 - unit[d] * unit[d])) + margin + s.turn * s.turn * s.flute
            low[d] = min(low[d], foot[d] + min(0.0, unit[d] * s.flute) - side)
            high[d] = max(high[d], foot[d] + max(0.0, unit[d] * s.flute) + side)
    return low, high
