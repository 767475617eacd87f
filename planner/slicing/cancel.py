"""Kernels that find the loops which together enclose nothing, where a plane only touches the surface along a ring."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.slicing.nesting import perimeter_mm

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]


@njit(cache=True)
def _is_empty(
    points: Floats, start: Ints, area: Floats, box: Floats, members: Ints, loop: int, child: Ints32, sibling: Ints32,
    snap_mm: float,
) -> bool:  # fmt: skip
    """Whether a loop and the loops of the other sense right inside it enclose no more than a strip of snap_mm.

    members : (l,) int64, numbers of one plane's loops into start, area and box;  loop : which of them
    child, sibling : (l,) int32, each loop's first loop inside and the next one beside it, -1 for none
    """
    outer = members[loop]
    net, bound_mm, has_other = area[outer], _longest_mm(start, box, outer), False
    inner = child[loop]
    while inner >= 0:
        number = members[inner]
        if area[number] * area[outer] < 0.0:
            has_other = True
            net += area[number]
            bound_mm += _longest_mm(start, box, number)
        inner = sibling[inner]
    if not has_other or abs(net) > snap_mm * bound_mm:
        return False
    length_mm = perimeter_mm(points[start[outer] : start[outer + 1]])
    inner = child[loop]
    while inner >= 0:
        number = members[inner]
        if area[number] * area[outer] < 0.0:
            length_mm += perimeter_mm(points[start[number] : start[number + 1]])
        inner = sibling[inner]
    return bool(abs(net) <= snap_mm * length_mm)


@njit(cache=True)
def _longest_mm(start: Ints, box: Floats, number: int) -> float:
    """More than a loop's perimeter, mm: its points times half the perimeter of its box."""
    return float(
        (start[number + 1] - start[number]) * (box[number, 2] - box[number, 0] + box[number, 3] - box[number, 1])
    )


@njit(cache=True)
def _lift_out(first: int, parent: Ints32, child: Ints32, sibling: Ints32, outer: int) -> None:
    """Put the loop `first` and those beside it into the loop `outer` (-1: into none)."""
    while first >= 0:
        following = sibling[first]
        parent[first] = outer
        if outer >= 0:
            sibling[first] = child[outer]
            child[outer] = first
        first = following


@njit(cache=True)
def _remove(
    loop: int, area: Floats, members: Ints, parent: Ints32, child: Ints32, sibling: Ints32, is_kept: NDArray[np.bool_]
) -> None:
    """Take a loop and the loops of the other sense right inside it out; what lies in them moves outwards."""
    is_kept[loop] = False
    inner = child[loop]
    while inner >= 0:
        following = sibling[inner]
        if area[members[inner]] * area[members[loop]] < 0.0:
            is_kept[inner] = False
            _lift_out(child[inner], parent, child, sibling, parent[loop])
        else:
            sibling[inner] = -1
            _lift_out(inner, parent, child, sibling, parent[loop])
        inner = following


@njit(cache=True)
def cancel_empty_regions(
    points: Floats, start: Ints, loops: Ints, first: Ints, area: Floats, box: Floats, parents: Ints32, snap_mm: Floats
) -> NDArray[np.bool_]:
    """Which loops enclose something: False for a loop whose holes fill it, and for a hole that its islands fill.

    points : (n, 3) float mm;  start : (all + 1,) int64;  area, box : as from `measure_loops`
    loops : (l,) int64, numbers of the loops that count, plane after plane;  first : (planes + 1,) int64 into loops
    parents : (l,) int32 as from `nest_loops`; changed in place to the loops that stay, still counted with the others
    snap_mm : (planes,) float; a region thinner than this over the length of its boundary is none
    A plane that touches a surface along a ring cuts two loops of opposite sense and the same outline; along a ring
    with spokes, one loop and as many holes as there are sectors. From the innermost loop outwards, so that shells in
    shells cancel pair by pair.
    """
    is_kept = np.ones(loops.shape[0], np.bool_)
    for k in range(first.shape[0] - 1):
        count = first[k + 1] - first[k]
        if count < 2:
            continue
        members, parent, kept = loops[first[k] : first[k + 1]], parents[first[k] : first[k + 1]], is_kept[first[k] :]
        if parent.max() < 0:
            continue
        child, sibling = np.full(count, -1, np.int32), np.full(count, -1, np.int32)
        for loop in np.argsort(-np.abs(area[members]), kind="mergesort")[::-1]:
            if _is_empty(points, start, area, box, members, loop, child, sibling, snap_mm[k]):
                _remove(loop, area, members, parent, child, sibling, kept)
            elif parent[loop] >= 0:
                sibling[loop] = child[parent[loop]]
                child[parent[loop]] = loop
    return is_kept
