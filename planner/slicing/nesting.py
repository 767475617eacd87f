"""Kernels for plane loops: signed area, a point inside, and which loop lies in which."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(cache=True)
def signed_areas(xy: Floats, start: Ints) -> tuple[Floats, Floats]:
    """Area (positive counter-clockwise, mm²) and perimeter (mm) of every loop.

    xy : (n, 2) float mm, loop after loop;  start : (loops + 1,) int64
    """
    loops = start.shape[0] - 1
    area = np.zeros(loops, np.float64)
    perimeter = np.zeros(loops, np.float64)
    for loop in range(loops):
        first = start[loop]
        for i in range(first, start[loop + 1]):
            j = i + 1 if i + 1 < start[loop + 1] else first
            ax, ay = xy[i, 0] - xy[first, 0], xy[i, 1] - xy[first, 1]
            bx, by = xy[j, 0] - xy[first, 0], xy[j, 1] - xy[first, 1]
            area[loop] += 0.5 * (ax * by - ay * bx)
            perimeter[loop] += np.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    return area, perimeter


@njit(cache=True)
def point_inside(loop: Floats) -> tuple[float, float]:
    """A point strictly inside a loop by the even-odd rule: on a line that passes between its vertices' heights.

    loop : (n, 2) float mm, with area.  Source: even-odd scan line; the widest gap of heights is the safest line.
    """
    heights = np.sort(loop[:, 1])
    best = 0
    for i in range(heights.shape[0] - 1):
        if heights[i + 1] - heights[i] > heights[best + 1] - heights[best]:
            best = i
    y = 0.5 * (heights[best] + heights[best + 1])
    cuts = np.empty(loop.shape[0], np.float64)
    count = 0
    for i in range(loop.shape[0]):
        j = (i + 1) % loop.shape[0]
        if (loop[i, 1] <= y) != (loop[j, 1] <= y):
            t = (y - loop[i, 1]) / (loop[j, 1] - loop[i, 1])
            cuts[count] = loop[i, 0] + t * (loop[j, 0] - loop[i, 0])
            count += 1
    cuts = np.sort(cuts[:count])
    widest = 0
    for i in range(0, count - 1, 2):
        if cuts[i + 1] - cuts[i] > cuts[widest + 1] - cuts[widest]:
            widest = i
    return 0.5 * (cuts[widest] + cuts[widest + 1]), y


@njit(cache=True)
def holds_point(loop: Floats, x: float, y: float) -> bool:
    """Whether (x, y) lies inside the loop, (n, 2) float mm, by the even-odd rule."""
    inside = False
    for i in range(loop.shape[0]):
        j = (i + 1) % loop.shape[0]
        if (loop[i, 1] <= y) != (loop[j, 1] <= y):
            t = (y - loop[i, 1]) / (loop[j, 1] - loop[i, 1])
            if x < loop[i, 0] + t * (loop[j, 0] - loop[i, 0]):
                inside = not inside
    return inside


@njit(cache=True)
def nest_loops(xy: Floats, start: Ints, plane: Ints, area: Floats, slack_mm: float) -> Ints:
    """Smallest loop of the same plane that each loop lies in.

    xy : (n, 2) float mm;  start : (loops + 1,);  plane : (loops,) int64, ascending;  area : (loops,) float, signed
    slack_mm : rounding allowed when boxes are compared
    Returns parent : (loops,) int64, -1 for none.
    """
    loops = plane.shape[0]
    parent = np.full(loops, -1, np.int64)
    box = np.empty((loops, 4), np.float64)
    inner = np.empty((loops, 2), np.float64)
    for a in range(loops):
        loop = xy[start[a] : start[a + 1]]
        box[a, 0], box[a, 1] = loop[:, 0].min(), loop[:, 1].min()
        box[a, 2], box[a, 3] = loop[:, 0].max(), loop[:, 1].max()
        inner[a, 0], inner[a, 1] = point_inside(loop)
    first = 0
    for a in range(loops):
        if plane[a] != plane[first]:
            first = a
        b = first
        while b < loops and plane[b] == plane[a]:
            is_larger = abs(area[b]) > abs(area[a]) and (parent[a] < 0 or abs(area[b]) < abs(area[parent[a]]))
            if is_larger and (
                box[b, 0] <= box[a, 0] + slack_mm
                and box[b, 1] <= box[a, 1] + slack_mm
                and box[b, 2] >= box[a, 2] - slack_mm
                and box[b, 3] >= box[a, 3] - slack_mm
                and holds_point(xy[start[b] : start[b + 1]], inner[a, 0], inner[a, 1])
            ):
                parent[a] = b
            b += 1
    return parent
