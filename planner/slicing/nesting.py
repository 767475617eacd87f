"""Kernels for plane loops: signed area, box, and which loop lies in which."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]

MAX_PLAIN_LOOPS = 24
"""Loops of one plane up to which every pair is compared; above it a grid finds the boxes that hold a point."""
LINES = (0.5, 0.37, 0.63, 0.22, 0.78, 0.11, 0.89)
"""Heights, as fractions of a loop's box, at which a point inside is sought; the first serves all but odd shapes."""
SLENDER_FRACTION = 1e-3
"""Width of the loop, as a fraction of its box, that is safe to put a point into."""


@njit(cache=True)
def measure_loops(
    points: Floats, start: Ints, plane: Ints32, along: Floats, middle: Floats, snap_mm: Floats
) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Signed area (positive counter-clockwise, mm²), whether there is area at all, and box of every loop.

    points : (n, 3) float mm, loop after loop;  start : (loops + 1,) int64;  plane : (loops,) int32, plane of each
    along : (2, 3) float, axes in the plane;  middle : (3,) float mm, where the boxes count from
    A loop thinner than the snap_mm (planes,) of its plane over its length has no area. Returns (loops,) float, (loops,) bool and (loops, 4)
    float: low x, low y, high x, high y in the axes.
    """
    loops = start.shape[0] - 1
    area = np.zeros(loops, np.float64)
    solid = np.empty(loops, np.bool_)
    box = np.empty((loops, 4), np.float64)
    (ux, uy, uz), (vx, vy, vz) = along[0], along[1]
    for loop in range(loops):
        first = start[loop]
        x0, y0, z0 = points[first, 0], points[first, 1], points[first, 2]
        ax, ay = 0.0, 0.0
        low_x, low_y, high_x, high_y = 0.0, 0.0, 0.0, 0.0
        doubled = 0.0
        for i in range(first + 1, start[loop + 1]):
            dx, dy, dz = points[i, 0] - x0, points[i, 1] - y0, points[i, 2] - z0
            bx = dx * ux + dy * uy + dz * uz
            by = dx * vx + dy * vy + dz * vz
            doubled += ax * by - ay * bx
            low_x, low_y, high_x, high_y = min(low_x, bx), min(low_y, by), max(high_x, bx), max(high_y, by)
            ax, ay = bx, by
        area[loop] = 0.5 * doubled
        reach = (start[loop + 1] - first) * (high_x - low_x + high_y - low_y)
        solid[loop] = abs(area[loop]) > snap_mm[plane[loop]] * reach
        if not solid[loop]:
            solid[loop] = abs(area[loop]) > snap_mm[plane[loop]] * perimeter_mm(points[first : start[loop + 1]])
        x = (x0 - middle[0]) * ux + (y0 - middle[1]) * uy + (z0 - middle[2]) * uz
        y = (x0 - middle[0]) * vx + (y0 - middle[1]) * vy + (z0 - middle[2]) * vz
        box[loop] = np.array((x + low_x, y + low_y, x + high_x, y + high_y))
    return area, solid, box


@njit(cache=True)
def perimeter_mm(points: Floats) -> float:
    """Length of a closed loop, mm.  points : (n, 3) float mm."""
    total = 0.0
    for i in range(points.shape[0]):
        j = i + 1 if i + 1 < points.shape[0] else 0
        total += np.sqrt(
            (points[j, 0] - points[i, 0]) ** 2 + (points[j, 1] - points[i, 1]) ** 2 + (points[j, 2] - points[i, 2]) ** 2
        )
    return float(total)


@njit(cache=True)
def _flatten(points: Floats, along: Floats, middle: Floats, xy: Floats) -> None:
    """Fill xy (n, 2) mm with the coordinates, in the axes along (2, 3), of points (n, 3) mm counted from middle."""
    for i in range(points.shape[0]):
        dx, dy, dz = points[i, 0] - middle[0], points[i, 1] - middle[1], points[i, 2] - middle[2]
        xy[i, 0] = dx * along[0, 0] + dy * along[0, 1] + dz * along[0, 2]
        xy[i, 1] = dx * along[1, 0] + dy * along[1, 1] + dz * along[1, 2]


@njit(cache=True)
def point_inside(loop: Floats) -> tuple[float, float]:
    """A point strictly inside a loop by the even-odd rule: in the middle of the widest piece of a level line.

    loop : (n, 2) float mm, with area.  Source: even-odd scan line.
    """
    low_y, high_y = loop[:, 1].min(), loop[:, 1].max()
    width = loop[:, 0].max() - loop[:, 0].min()
    best_x, best_y, best = loop[0, 0], loop[0, 1], -1.0
    cuts = np.empty(loop.shape[0], np.float64)
    for line in LINES:
        y = low_y + line * (high_y - low_y)
        count = 0
        for i in range(loop.shape[0]):
            j = i + 1 if i + 1 < loop.shape[0] else 0
            if (loop[i, 1] <= y) != (loop[j, 1] <= y):
                cuts[count] = _cut(loop, i, j, y)
                count += 1
        spans = cuts[:count]
        if count > 2:
            spans = np.sort(spans)
        elif spans[0] > spans[1]:
            spans[0], spans[1] = spans[1], spans[0]
        for i in range(0, count - 1, 2):
            if spans[i + 1] - spans[i] > best:
                best = spans[i + 1] - spans[i]
                best_x, best_y = 0.5 * (spans[i] + spans[i + 1]), y
        if best > SLENDER_FRACTION * width:
            break
    return best_x, best_y


@njit(cache=True)
def _cut(loop: Floats, i: int, j: int, y: float) -> float:
    """Where the segment i, j of a loop meets the level line y, mm; the same from either end."""
    if loop[i, 1] > loop[j, 1]:
        i, j = j, i
    t = (y - loop[i, 1]) / (loop[j, 1] - loop[i, 1])
    return float(loop[i, 0] + t * (loop[j, 0] - loop[i, 0]))


@njit(cache=True)
def holds_point(loop: Floats, x: float, y: float) -> bool:
    """Whether (x, y) lies inside the loop, (n, 2) float mm, by the even-odd rule."""
    inside = False
    for i in range(loop.shape[0]):
        j = i + 1 if i + 1 < loop.shape[0] else 0
        if (loop[i, 1] <= y) != (loop[j, 1] <= y) and x < _cut(loop, i, j, y):
            inside = not inside
    return inside


@njit(cache=True)
def _is_boxed(inner: Floats, outer: Floats, slack_mm: float) -> bool:
    """Whether one box (4,) lies in the other."""
    return bool(
        outer[0] <= inner[0] + slack_mm
        and outer[1] <= inner[1] + slack_mm
        and outer[2] >= inner[2] - slack_mm
        and outer[3] >= inner[3] - slack_mm
    )


@njit(cache=True)
def _is_larger(area: Floats, a: int, b: int) -> bool:
    """Whether loop a counts as larger than loop b; of equal ones the first does, so that coinciding loops nest too."""
    return bool(abs(area[a]) > abs(area[b]) or (abs(area[a]) == abs(area[b]) and a < b))


@njit(cache=True)
def _nest_few(
    xy: Floats, rows: Ints, members: Ints, area: Floats, box: Floats, slack_mm: float, parent: Ints32
) -> None:
    """As `_nest_many`, comparing every pair of loops; area and box are those of all loops, members the numbers."""
    for a in range(rows.shape[0]):
        is_known = False
        x, y = 0.0, 0.0
        for b in range(rows.shape[0]):
            if not _is_larger(area, members[b], members[a]):
                continue
            if parent[a] >= 0 and not _is_larger(area, members[parent[a]], members[b]):
                continue
            if not _is_boxed(box[members[a]], box[members[b]], slack_mm):
                continue
            if not is_known:
                x, y = point_inside(xy[rows[a, 0] : rows[a, 1]])
                is_known = True
            if holds_point(xy[rows[b, 0] : rows[b, 1]], x, y):
                parent[a] = b


@njit(cache=True)
def _toggle_held(loop: Floats, inner: Floats, wanted: Ints, held: NDArray[np.bool_]) -> None:
    """Note which points lie inside a loop, by the even-odd rule.

    loop : (n, 2) float mm;  inner : (q, 2) float mm;  wanted : (w,) numbers of the points asked for, by ascending y
    held : (w,) bool, filled.  Every segment finds by bisection the points at whose height it passes.
    """
    held[:] = False
    for i in range(loop.shape[0]):
        j = i + 1 if i + 1 < loop.shape[0] else 0
        low, high = min(loop[i, 1], loop[j, 1]), max(loop[i, 1], loop[j, 1])
        first, last = 0, wanted.shape[0]
        while first < last:  # the first point not below the segment
            half = (first + last) // 2
            if inner[wanted[half], 1] < low:
                first = half + 1
            else:
                last = half
        for w in range(first, wanted.shape[0]):
            y = inner[wanted[w], 1]
            if y >= high:
                break
            if inner[wanted[w], 0] < _cut(loop, i, j, y):
                held[w] = not held[w]


@njit(cache=True)
def _grid(inner: Floats, by_height: Ints, low: Floats, step: Floats, side: int) -> tuple[Ints, Ints]:
    """Points of each cell of a side × side grid, each cell's by ascending height: items[first[c] : first[c + 1]]."""
    first = np.zeros(side * side + 1, np.int64)
    cell = np.empty(inner.shape[0], np.int64)
    for a in range(inner.shape[0]):
        column = min(int((inner[a, 0] - low[0]) / step[0]), side - 1)
        row = min(int((inner[a, 1] - low[1]) / step[1]), side - 1)
        cell[a] = row * side + column
        first[cell[a] + 1] += 1
    first = np.cumsum(first)
    slot = first[:-1].copy()
    items = np.empty(inner.shape[0], np.int64)
    for a in by_height:
        items[slot[cell[a]]] = a
        slot[cell[a]] += 1
    return first, items


@njit(cache=True)
def _reach(low: float, high: float, start: float, step: float, side: int) -> tuple[int, int]:
    """First and last cell that the interval low … high meets, of `side` cells of width `step` from `start`."""
    first = max(0, min(side - 1, int((low - start) / step) - 1))
    last = max(0, min(side - 1, int((high - start) / step) + 1))
    return first, last


@njit(cache=True)
def _nest_many(xy: Floats, rows: Ints, area: Floats, box: Floats, slack_mm: float, parent: Ints32) -> None:
    """Smallest loop that each loop lies in, of loops of one plane.

    xy : (n, 2) float mm;  rows : (loops, 2) int64, first and last row + 1 of each;  area : (loops,);  box : (loops, 4)
    parent : (loops,) int32, all -1, filled with numbers.  Time n log n and the crossings of loops with the level
    lines through the points they hold.
    """
    loops = rows.shape[0]
    inner = np.empty((loops, 2), np.float64)
    for a in range(loops):
        inner[a, 0], inner[a, 1] = point_inside(xy[rows[a, 0] : rows[a, 1]])
    by_height = np.argsort(inner[:, 1], kind="mergesort")
    side = int(np.sqrt(loops))
    low = np.array((inner[:, 0].min(), inner[:, 1].min()))
    step = np.array((inner[:, 0].max() - low[0], inner[:, 1].max() - low[1])) / side + slack_mm
    first, items = _grid(inner, by_height, low, step, side)
    wanted = np.empty(loops, np.int64)
    held = np.empty(loops, np.bool_)
    for b in range(loops):
        left, right = _reach(box[b, 0], box[b, 2], low[0], step[0], side)
        bottom, top = _reach(box[b, 1], box[b, 3], low[1], step[1], side)
        count = 0
        for row in range(bottom, top + 1):
            for i in range(first[row * side + left], first[row * side + right + 1]):
                a = items[i]
                if (
                    _is_larger(area, b, a)
                    and (parent[a] < 0 or _is_larger(area, parent[a], b))
                    and _is_boxed(box[a], box[b], slack_mm)
                ):
                    wanted[count] = a
                    count += 1
        if count == 0:
            continue
        asked = wanted[:count]
        asked = asked[np.argsort(inner[asked, 1], kind="mergesort")]
        _toggle_held(xy[rows[b, 0] : rows[b, 1]], inner, asked, held[:count])
        for w in range(count):
            if held[w]:
                parent[asked[w]] = b


@njit(cache=True)
def nest_loops(
    points: Floats, start: Ints, loops: Ints, first: Ints, area: Floats, box: Floats, along: Floats, middle: Floats,
    slack_mm: float,
) -> Ints32:  # fmt: skip
    """Smallest loop of the same plane that each loop lies in; of loops that coincide the first holds the others.

    points : (n, 3) float mm;  start : (all + 1,) int64, rows of each loop;  area, box : as from `measure_loops`
    loops : (l,) int64, numbers of the loops that count, plane after plane;  first : (planes + 1,) int64 into loops
    along : (2, 3), middle : (3,) mm, the axes of the boxes;  slack_mm : rounding allowed when boxes are compared
    Returns parent : (l,) int32, counted from the plane's first loop, -1 for none.
    """
    parent = np.full(loops.shape[0], -1, np.int32)
    xy, rows = np.empty((0, 2), np.float64), np.empty((0, 2), np.int64)
    for k in range(first.shape[0] - 1):
        count = first[k + 1] - first[k]
        if count < 2:
            continue
        members = loops[first[k] : first[k + 1]]
        if count > rows.shape[0]:
            rows = np.empty((2 * count, 2), np.int64)
        total = 0
        for i in range(count):
            size = start[members[i] + 1] - start[members[i]]
            rows[i, 0], rows[i, 1] = total, total + size
            total += size
        if total > xy.shape[0]:
            xy = np.empty((2 * total, 2), np.float64)
        for i in range(count):
            _flatten(points[start[members[i]] : start[members[i] + 1]], along, middle, xy[rows[i, 0] : rows[i, 1]])
        found = parent[first[k] : first[k + 1]]
        if count <= MAX_PLAIN_LOOPS:
            _nest_few(xy, rows[:count], members, area, box, slack_mm, found)
        else:
            _nest_many(xy, rows[:count], area[members], box[members], slack_mm, found)
    return parent
