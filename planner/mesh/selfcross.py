"""Where a mesh passes through itself: pairs of facets from a tree of boxes, edges against facets."""

from __future__ import annotations

import numpy as np
from numba import njit

from planner.mesh.facets import boxes_of
from planner.mesh.mesh import Floats, Ints, Mesh
from planner.mesh.nearest import LEAF, FacetTree

DEPTH_FRACTION = 2e-6
"""How deep an edge must pierce a facet, as a fraction of the part's diagonal, to count: 30 times the rounding of
32-bit coordinates (6e-8), so that what only touches is not reported, and 0.1 micrometre on a part of 50 mm."""
MAX_COMPARISONS = 1_000_000_000
"""Pairs compared before the check is given up (seconds); a part of a million facets needs a twentieth."""


def crossing_facets(mesh: Mesh) -> tuple[Ints, Floats, bool]:
    """Pairs of facets that pass through each other, found where boxes of a `FacetTree` meet.

    Returns (k, 2) int64 facets, (k, 3) float mm, a point of each crossing, and whether the check was completed.
    Facets that share an edge, touch, or lie in one plane do not count. The time grows as n log n, however the facets lie.
    """
    low, high = boxes_of(mesh.vertices, mesh.facets)
    tree = FacetTree(mesh)
    pairs, places, comparisons = _meeting(
        mesh.vertices, mesh.facets, mesh.normals, low, high, tree.order, tree.boxes, DEPTH_FRACTION * mesh.diagonal
    )
    return pairs, places, comparisons <= MAX_COMPARISONS


@njit(cache=True)
def _shared_corners(facets: Ints, f: int, g: int) -> int:
    shared = 0
    for a in range(3):
        for b in range(3):
            if facets[f, a] == facets[g, b]:
                shared += 1
    return shared


@njit(cache=True)
def _boxes_apart(low: Floats, high: Floats, f: int, g: int) -> bool:
    meet = True
    for axis in range(3):
        meet &= low[g, axis] <= high[f, axis] and low[f, axis] <= high[g, axis]
    return not meet


@njit(cache=True)
def _nodes_meet(boxes: Floats, first: int, second: int) -> bool:
    meet = True
    for axis in range(3):
        meet &= boxes[first, 0, axis] <= boxes[second, 1, axis] and boxes[second, 0, axis] <= boxes[first, 1, axis]
    return meet


@njit(cache=True)
def _meeting(
    vertices: Floats,
    facets: Ints,
    normals: Floats,
    low: Floats,
    high: Floats,
    order: Ints,
    boxes: Floats,
    depth_mm: float,
) -> tuple[Ints, Floats, int]:
    """Crossing pairs, their places and how many boxes were compared; gives up above MAX_COMPARISONS.

    order, boxes : of a `FacetTree`. Each leaf looks in the tree for leaves from itself onward that meet its box.
    """
    pairs, places = np.empty((16, 2), np.int64), np.empty((16, 3), np.float64)
    place, stack = np.empty(3, np.float64), np.empty(128, np.int64)
    count, comparisons = 0, 0
    leaves = boxes.shape[0] // 2
    for leaf in range(leaves, leaves + (facets.shape[0] + LEAF - 1) // LEAF):
        stack[0], top = 1, 1
        while top > 0:
            top -= 1
            node = stack[top]
            comparisons += 1
            if not _nodes_meet(boxes, leaf, node):
                continue
            if node < leaves:
                stack[top], stack[top + 1] = 2 * node, 2 * node + 1
                top += 2
                continue
            if node < leaf:
                continue
            for i in range((leaf - leaves) * LEAF, min((leaf - leaves + 1) * LEAF, facets.shape[0])):
                from_place = i + 1 if node == leaf else (node - leaves) * LEAF
                for k in range(from_place, min((node - leaves + 1) * LEAF, facets.shape[0])):
                    f, g = order[i], order[k]
                    if not _cross(vertices, facets, normals, low, high, f, g, depth_mm, place):
                        continue
                    if count == pairs.shape[0]:
                        pairs = np.concatenate((pairs, np.empty_like(pairs)))
                        places = np.concatenate((places, np.empty_like(places)))
                    pairs[count, 0], pairs[count, 1] = min(f, g), max(f, g)
                    places[count] = place
                    count += 1
        if comparisons > MAX_COMPARISONS:
            break
    return pairs[:count], places[:count], comparisons


@njit(cache=True)
def _cross(
    vertices: Floats,
    facets: Ints,
    normals: Floats,
    low: Floats,
    high: Floats,
    f: int,
    g: int,
    depth_mm: float,
    place: Floats,
) -> bool:
    """Whether two facets pass through each other, and where."""
    if _boxes_apart(low, high, f, g) or _shared_corners(facets, f, g) >= 2:
        return False
    return _edges_pierce(vertices, facets, normals, f, g, depth_mm, place) or _edges_pierce(
        vertices, facets, normals, g, f, depth_mm, place
    )


@njit(cache=True)
def _over(vertices: Floats, v: int, base: int, nx: float, ny: float, nz: float) -> float:
    """Height of vertex v over vertex base along a normal, mm."""
    return float(
        (vertices[v, 0] - vertices[base, 0]) * nx
        + (vertices[v, 1] - vertices[base, 1]) * ny
        + (vertices[v, 2] - vertices[base, 2]) * nz
    )


@njit(cache=True)
def _edges_pierce(
    vertices: Floats, facets: Ints, normals: Floats, f: int, g: int, depth_mm: float, place: Floats
) -> bool:
    """Whether an edge of facet f passes through facet g, deeper than depth_mm on both sides and within its rim."""
    nx, ny, nz = normals[g, 0], normals[g, 1], normals[g, 2]
    base = facets[g, 0]
    height = (
        _over(vertices, facets[f, 0], base, nx, ny, nz),
        _over(vertices, facets[f, 1], base, nx, ny, nz),
        _over(vertices, facets[f, 2], base, nx, ny, nz),
    )
    if max(height) <= depth_mm or min(height) >= -depth_mm:
        return False
    for j in range(3):
        p, q = facets[f, j], facets[f, j + 1 if j < 2 else 0]
        hp, hq = height[j], height[j + 1 if j < 2 else 0]
        if not ((hp > depth_mm and hq < -depth_mm) or (hp < -depth_mm and hq > depth_mm)):
            continue
        t = hp / (hp - hq)
        for axis in range(3):
            place[axis] = vertices[p, axis] + t * (vertices[q, axis] - vertices[p, axis])
        inside = True
        for k in range(3):
            a = vertices[facets[g, k]]
            b = vertices[facets[g, (k + 1) % 3]]
            ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            rx, ry, rz = place[0] - a[0], place[1] - a[1], place[2] - a[2]
            # distance inward of the rim edge: (n x e) . r / |e|
            inward = ((ny * ez - nz * ey) * rx + (nz * ex - nx * ez) * ry + (nx * ey - ny * ex) * rz) / np.sqrt(
                ex * ex + ey * ey + ez * ez
            )
            if inward < depth_mm:
                inside = False
                break
        if inside:
            return True
    return False
