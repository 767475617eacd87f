"""Signed distance of two solids of the machine: how far apart, or how deep in each other."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.machine import gjk
from sim.machine.bodies import HULL, MESH, Bodies, body_distance, corner_row
from sim.machine.facets import DEPTH, box_gap2
from sim.machine.links import multiply_inverse

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def pair_distance(bodies: Bodies, a: int, b: int, pose_a: Array, pose_b: Array, allowed: float, at: Array) -> float:
    """Signed distance of two solids, mm: the gap, or minus the least way that parts them.

    pose_a, pose_b : (3, 4)   One frame from theirs.   allowed : mm   Of overlap; a depth below it is only bounded.
    at : (3,)   Gets a point of the nearest (or deepest) place, in that one frame.
    A concave solid overlaps as deep as the deepest of its facets does, or as the other lies inside it.
    """
    if bodies.kind[a] == MESH and bodies.kind[b] != MESH:
        return _mesh_distance(bodies, a, b, pose_a, pose_b, at)
    if bodies.kind[b] == MESH and bodies.kind[a] != MESH:
        return _mesh_distance(bodies, b, a, pose_b, pose_a, at)
    if bodies.kind[a] == MESH:
        return _two_meshes(bodies, a, b, pose_a, pose_b, at)
    own = np.empty(3)
    pose = np.empty((3, 4))
    multiply_inverse(pose_a, pose_b, pose)
    rows = (bodies.hull[a, 0], bodies.hull[a, 1], bodies.hull[b, 0], bodies.hull[b, 1])
    gap = _gap(bodies, (bodies.kind[a], bodies.kind[b]), (a, b), rows, pose, np.inf, allowed, own)
    _into(pose_a, own, at)
    return gap


@njit(cache=True, nogil=True)
def _into(pose: Array, point: Array, out: Array) -> None:
    for i in range(3):
        out[i] = pose[i, 0] * point[0] + pose[i, 1] * point[1] + pose[i, 2] * point[2] + pose[i, 3]


@njit(cache=True, nogil=True)
def _gap(
    bodies: Bodies, kinds: tuple[int, int], pair: tuple[int, int], rows: tuple[int, int, int, int], pose: Array, enough: float,
    allowed: float, own: Array,
) -> float:  # fmt: skip
    """Signed distance of two convex solids, or of single facets of them. rows : first and last point of each   pose : first from second"""
    size_a, size_b = bodies.size[pair[0]], bodies.size[pair[1]]
    a0, a1, b0, b1 = rows
    gap = gjk.distance(kinds[0], size_a, a0, a1, kinds[1], size_b, b0, b1, bodies.points, pose, enough, own)
    if gap > 0.0:
        return gap
    return -max(0.0, gjk.overlap(kinds[0], size_a, a0, a1, kinds[1], size_b, b0, b1, bodies.points, pose, allowed, own))


@njit(cache=True, nogil=True)
def _mesh_distance(bodies: Bodies, a: int, b: int, pose_a: Array, pose_b: Array, at: Array) -> float:
    """The same for a concave solid `a` and a convex one `b`."""
    pose = np.empty((3, 4))
    multiply_inverse(pose_a, pose_b, pose)
    own, centre = np.empty(3), np.empty(3)
    middle = np.empty(3)
    _own_centre(bodies, b, middle)
    _into(pose, middle, centre)
    rows = (bodies.hull[b, 0], bodies.hull[b, 1])
    best = _facets_against(bodies, a, bodies.kind[b], b, rows, pose, centre, bodies.radius[b], np.inf, own)
    if best > 0.0:
        inside = body_distance(bodies, a, centre[0], centre[1], centre[2])
        if inside < 0.0:
            best = inside
            own[:] = centre
    _into(pose_a, own, at)
    return best


@njit(cache=True, nogil=True)
def _own_centre(bodies: Bodies, b: int, out: Array) -> None:
    """Centre of a solid's sphere in its own frame."""
    pose, centre = bodies.pose[b], bodies.centre[b]
    for i in range(3):
        out[i] = 0.0
        for j in range(3):
            out[i] += pose[j, i] * (centre[j] - pose[j, 3])


@njit(cache=True, nogil=True)
def _facets_against(
    bodies: Bodies, a: int, kind: int, b: int, other: tuple[int, int], pose: Array, centre: Array, radius: float, best: float, own: Array
) -> float:
    """Least signed distance, if less than `best`, of a's facets from a convex solid b, or a facet of it, in a sphere at `centre` of a's frame."""
    first, rows = bodies.facet[a, 0], bodies.node[a]
    boxes, nodes = bodies.boxes[rows[0] : rows[1]], bodies.nodes[rows[0] : rows[1]]
    stack = np.empty(DEPTH, np.int64)
    stack[0], depth = 0, 1
    trial = np.empty(3)
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if np.sqrt(box_gap2(boxes[node], centre[0], centre[1], centre[2])) - radius >= max(best, 0.0):
            continue
        if nodes[node, 1] == 0:
            near, far = nodes[node, 0], nodes[node, 0] + 1
            if box_gap2(boxes[near], centre[0], centre[1], centre[2]) > box_gap2(boxes[far], centre[0], centre[1], centre[2]):
                near, far = far, near
            stack[depth], stack[depth + 1] = far, near
            depth += 2
            continue
        for f in range(nodes[node, 0], nodes[node, 0] + nodes[node, 1]):
            row = corner_row(bodies, first + f)
            gap = _gap(bodies, (int(np.int64(HULL)), kind), (a, b), (row, row + 3, other[0], other[1]), pose, max(best, 0.0), 0.0, trial)
            if gap < best:
                best = gap
                own[:] = trial
    return best


@njit(cache=True, nogil=True)
def _two_meshes(bodies: Bodies, a: int, b: int, pose_a: Array, pose_b: Array, at: Array) -> float:
    """The same for two concave solids: each facet of b against a."""
    pose = np.empty((3, 4))
    multiply_inverse(pose_a, pose_b, pose)
    corners, own = np.empty((3, 3)), np.empty(3)
    found = np.empty(3)
    best = np.inf
    back = np.empty((3, 4))
    multiply_inverse(pose_b, pose_a, back)
    for f in range(bodies.facet[b, 0], bodies.facet[b, 1]):
        row = corner_row(bodies, f)
        for c in range(3):
            _into(pose, bodies.points[row + c], corners[c])
        centre = (corners[0] + corners[1] + corners[2]) / 3.0
        radius = 0.0
        for c in range(3):
            radius = max(radius, np.sqrt(np.sum((corners[c] - centre) ** 2)))
        gap = _facets_against(bodies, a, int(np.int64(HULL)), b, (row, row + 3), pose, centre, radius, best, own)
        if gap < best:
            best = gap
            found[:] = own
    if best > 0.0:
        for c in range(3):
            corners[0, c] = bodies.points[corner_row(bodies, bodies.facet[b, 0]), c]
            corners[1, c] = bodies.points[corner_row(bodies, bodies.facet[a, 0]), c]
        _into(pose, corners[0], own)
        there = body_distance(bodies, a, own[0], own[1], own[2])
        _into(back, corners[1], corners[2])
        here = body_distance(bodies, b, corners[2, 0], corners[2, 1], corners[2, 2])
        if min(here, there) < 0.0:
            best = min(here, there)
            found[:] = own if there < here else corners[1]
    _into(pose_a, found, at)
    return best
