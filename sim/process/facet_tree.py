"""Exact signed distance to a closed triangle mesh: a tree of boxes finds the nearest facet, its pseudonormal gives the sign."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAF_FACETS = 4
FEW_FACETS = 24  # within reach of a place: so many are tried one by one, more are searched for
DEEPEST = 64  # of the stack of a search: a tree of halves is never as deep
FACE, SIDES, CORNERS = 0, 1, 4  # where on a facet the nearest point lies: inside, on side 0..2 (from that corner), at corner 0..2


class FacetTree(NamedTuple):
    """Facets in the order of the tree's leaves, as kernels take them.

    low, high : (n, 3) float, mm   Box of each node.
    first, last : (n,) int   Leaf: its facets; inner node: -1 and its first child, whose sibling is the next node.
    corners : (m, 3, 3) float, mm
    normals : (m, 7, 3) float   Outward pseudonormals of the facet, its three sides (0-1, 1-2, 2-0) and its three corners.
    order : (m,) int   Which facet of the mesh each one is.
    """

    low: Array
    high: Array
    first: Index
    last: Index
    corners: Array
    normals: Array
    order: Index


def facet_tree(corners: Array) -> FacetTree:
    """Tree over the facets of a closed mesh; facets without area are left out. corners : (m, 3, 3) float, mm.

    Raises ValueError when no facet has an area.
    """
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    kept = np.flatnonzero(np.linalg.norm(cross, axis=1) > 1e-12)
    if not len(kept):
        raise ValueError("the mesh has no facet with an area")
    corners = np.ascontiguousarray(corners[kept], dtype=np.float64)
    low, high, first, last, order = split(corners, LEAF_FACETS)
    return FacetTree(low, high, first, last, corners[order], pseudonormals(corners)[order], kept[order])


def pseudonormals(corners: Array) -> Array:
    """Outward directions whose product with (point - nearest point) has the sign of the distance, (m, 7, 3): see FacetTree.

    Corners are joined by equal coordinates. Source: Baerentzen and Aanaes, Signed Distance Computation Using the Angle Weighted
    Pseudonormal, IEEE TVCG 11 (2005): of a side the sum of its facets' normals, of a corner that sum weighted by their angles.
    """
    count = len(corners)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face = cross / np.linalg.norm(cross, axis=1)[:, None]
    _, ids = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    ids = ids.reshape(count, 3).astype(np.int64)
    sides = np.sort(np.stack([ids, np.roll(ids, -1, axis=1)], axis=2), axis=2)
    _, side = np.unique(sides[..., 0] * (ids.max() + 1) + sides[..., 1], return_inverse=True)
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cosine = (after * before).sum(axis=2) / (np.linalg.norm(after, axis=2) * np.linalg.norm(before, axis=2))
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)).ravel()
    per_corner = np.repeat(face, 3, axis=0)
    out = np.empty((count, 7, 3))
    out[:, FACE] = face
    for d in range(3):
        out[:, SIDES:CORNERS, d] = np.bincount(side.ravel(), per_corner[:, d])[side.reshape(count, 3)]
        out[:, CORNERS:, d] = np.bincount(ids.ravel(), angle * per_corner[:, d])[ids]
    return out


@njit(cache=True, nogil=True)
def split(corners: Array, leaf: int) -> tuple[Array, Array, Index, Index, Index]:
    """Halve the facets at the median of their middles along the longest side of the box, until at most `leaf` are left.

    corners : (m, 3, 3) float, mm -> low, high, first, last of the nodes and order of the facets (FacetTree)
    """
    count = corners.shape[0]
    most = 2 * count + 1
    low, high = np.empty((most, 3)), np.empty((most, 3))
    first, last = np.empty(most, np.int64), np.empty(most, np.int64)
    order = np.arange(count)
    middle = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0
    first[0], last[0] = 0, count
    nodes = 1
    node = 0
    while node < nodes:
        begin, end = first[node], last[node]
        for d in range(3):
            low[node, d], high[node, d] = np.inf, -np.inf
            for n in range(begin, end):
                for c in range(3):
                    low[node, d] = min(low[node, d], corners[order[n], c, d])
                    high[node, d] = max(high[node, d], corners[order[n], c, d])
        if end - begin > leaf:
            axis = int(np.argmax(high[node] - low[node]))
            part = order[begin:end].copy()
            order[begin:end] = part[np.argsort(middle[part, axis], kind="mergesort")]
            half = (begin + end) // 2
            first[nodes], last[nodes], first[nodes + 1], last[nodes + 1] = begin, half, half, end
            first[node], last[node] = -1, nodes
            nodes += 2
        node += 1
    return low[:nodes].copy(), high[:nodes].copy(), first[:nodes].copy(), last[:nodes].copy(), order


@njit(cache=True, nogil=True)
def box_gap2(tree: FacetTree, node: int, x: float, y: float, z: float) -> float:
    """Squared distance of a point from a node's box, mm2."""
    gx = max(tree.low[node, 0] - x, x - tree.high[node, 0], 0.0)
    gy = max(tree.low[node, 1] - y, y - tree.high[node, 1], 0.0)
    gz = max(tree.low[node, 2] - z, z - tree.high[node, 2], 0.0)
    return float(gx * gx + gy * gy + gz * gz)


@njit(cache=True, nogil=True)
def to_facet(tree: FacetTree, f: int, x: float, y: float, z: float) -> tuple[float, float, float, float, int]:
    """Vector from the nearest point of a facet to a point, its squared length, and where on the facet that is (FACE, SIDES, CORNERS).

    Source: Ericson, Real-Time Collision Detection, 5.1.5.
    """
    c = tree.corners
    abx, aby, abz = c[f, 1, 0] - c[f, 0, 0], c[f, 1, 1] - c[f, 0, 1], c[f, 1, 2] - c[f, 0, 2]
    acx, acy, acz = c[f, 2, 0] - c[f, 0, 0], c[f, 2, 1] - c[f, 0, 1], c[f, 2, 2] - c[f, 0, 2]
    px, py, pz = x - c[f, 0, 0], y - c[f, 0, 1], z - c[f, 0, 2]
    d1, d2 = abx * px + aby * py + abz * pz, acx * px + acy * py + acz * pz
    bb, bc, cc = abx * abx + aby * aby + abz * abz, abx * acx + aby * acy + abz * acz, acx * acx + acy * acy + acz * acz
    d3, d4, d5, d6 = d1 - bb, d2 - bc, d1 - bc, d2 - cc
    v = w = 0.0
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if d1 <= 0.0 and d2 <= 0.0:
        where = CORNERS
    elif d3 >= 0.0 and d4 <= d3:
        where, v = CORNERS + 1, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        where, v = SIDES, d1 / (d1 - d3)
    elif d6 >= 0.0 and d5 <= d6:
        where, w = CORNERS + 2, 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        where, w = SIDES + 2, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        where, v = SIDES + 1, 1.0 - w
    else:
        where, v, w = FACE, vb / (va + vb + vc), vc / (va + vb + vc)
    rx, ry, rz = px - v * abx - w * acx, py - v * aby - w * acy, pz - v * abz - w * acz
    return rx, ry, rz, rx * rx + ry * ry + rz * rz, where


@njit(cache=True, nogil=True)
def nearest(tree: FacetTree, stack: Array, x: float, y: float, z: float, start: int) -> tuple[float, int]:
    """Signed distance of a point, mm, negative inside, and its nearest facet.

    stack : (DEEPEST, 2) float, room to work in   start : a facet to begin with: a near one saves time
    """
    rx, ry, rz, least, where = to_facet(tree, start, x, y, z)
    best = start
    n = tree.normals
    side = rx * n[best, where, 0] + ry * n[best, where, 1] + rz * n[best, where, 2]
    stack[0, 0], stack[0, 1] = 0.0, 0.0
    height = 1
    while height > 0:
        height -= 1
        if stack[height, 1] >= least:
            continue
        node = int(stack[height, 0])
        if tree.first[node] < 0:
            left = tree.last[node]
            gap, other = box_gap2(tree, left, x, y, z), box_gap2(tree, left + 1, x, y, z)
            far = left + 1
            if other < gap:
                gap, other, far, left = other, gap, left, left + 1
            if other < least:
                stack[height, 0], stack[height, 1] = far, other
                height += 1
            if gap < least:
                stack[height, 0], stack[height, 1] = left, gap
                height += 1
            continue
        for f in range(tree.first[node], tree.last[node]):
            rx, ry, rz, gap, where = to_facet(tree, f, x, y, z)
            if gap < least:
                least, best = gap, f
                side = rx * n[f, where, 0] + ry * n[f, where, 1] + rz * n[f, where, 2]
    return (-np.sqrt(least) if side < 0.0 else np.sqrt(least)), best


@njit(cache=True, nogil=True)
def signed_distances(tree: FacetTree, points: Array) -> tuple[Array, Index]:
    """Signed distance of each point, mm, and its nearest facet. points : (n, 3) float, mm; fastest where neighbours follow each other."""
    distance, facet = np.empty(points.shape[0]), np.empty(points.shape[0], np.int64)
    stack = np.empty((DEEPEST, 2))
    best = 0
    for p in range(points.shape[0]):
        distance[p], best = nearest(tree, stack, points[p, 0], points[p, 1], points[p, 2], best)
        facet[p] = tree.order[best]
    return distance, facet


@njit(cache=True, nogil=True)
def facets_within(tree: FacetTree, stack: Array, x: float, y: float, z: float, reach: float, few: Index, boxes: Array) -> int:
    """Facets that come nearer to a point than `reach`, into `few` (FEW_FACETS,), and their boxes; how many, FEW_FACETS + 1 when they do not fit."""
    count = 0
    stack[0, 0] = 0.0
    height = 1
    while height > 0:
        height -= 1
        node = int(stack[height, 0])
        if box_gap2(tree, node, x, y, z) > reach * reach:
            continue
        if tree.first[node] < 0:
            stack[height, 0], stack[height + 1, 0] = tree.last[node], tree.last[node] + 1
            height += 2
            continue
        for f in range(tree.first[node], tree.last[node]):
            if to_facet(tree, f, x, y, z)[3] <= reach * reach:
                if count == few.shape[0]:
                    return count + 1
                few[count] = f
                for d in range(3):
                    p, q, r = tree.corners[f, 0, d], tree.corners[f, 1, d], tree.corners[f, 2, d]
                    boxes[count, d], boxes[count, 3 + d] = min(p, q, r), max(p, q, r)
                count += 1
    return count


@njit(cache=True, nogil=True)
def nearest_of(tree: FacetTree, few: Index, boxes: Array, count: int, x: float, y: float, z: float, band: float) -> float:
    """Signed distance to the nearest of a few facets, mm; the band when none is nearer. The nearest one becomes the first.

    boxes : (count, 6) float, mm   Box of each facet.
    """
    least, side, best = band * band, 1.0, 0
    n, c = tree.normals, tree.corners
    for m in range(count):
        gx = max(boxes[m, 0] - x, x - boxes[m, 3], 0.0)
        gy = max(boxes[m, 1] - y, y - boxes[m, 4], 0.0)
        gz = max(boxes[m, 2] - z, z - boxes[m, 5], 0.0)
        if gx * gx + gy * gy + gz * gz >= least:
            continue
        f = few[m]
        rise = (x - c[f, 0, 0]) * n[f, 0, 0] + (y - c[f, 0, 1]) * n[f, 0, 1] + (z - c[f, 0, 2]) * n[f, 0, 2]
        if rise * rise >= least:
            continue
        rx, ry, rz, gap, where = to_facet(tree, f, x, y, z)
        if gap < least:
            least, best = gap, m
            side = rx * n[f, where, 0] + ry * n[f, where, 1] + rz * n[f, where, 2]
    if best > 0:
        few[0], few[best] = few[best], few[0]
        for d in range(6):
            boxes[0, d], boxes[best, d] = boxes[best, d], boxes[0, d]
    return float(-np.sqrt(least) if side < 0.0 else np.sqrt(least))


@njit(cache=True, nogil=True)
def close_distances(tree: FacetTree, points: Array, ball: float) -> Array:
    """Signed distance of each point, mm, where most points lie within `ball` mm of those before them: the facets that matter are kept.

    points : (n, 3) float, mm. As exact as `signed_distances`, several times faster on the vertices of a surface near the mesh.
    """
    distance = np.empty(points.shape[0])
    stack, few, boxes = np.empty((DEEPEST, 2)), np.empty(FEW_FACETS, np.int64), np.empty((FEW_FACETS, 6))
    best, count, reach = 0, 0, 0.0
    cx, cy, cz = np.inf, np.inf, np.inf
    for p in range(points.shape[0]):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        if (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2 > ball * ball:
            distance[p], best = nearest(tree, stack, x, y, z, best)
            cx, cy, cz = x, y, z
            reach = abs(distance[p]) + 2.0 * ball
            count = facets_within(tree, stack, x, y, z, reach, few, boxes)
        elif count <= FEW_FACETS:
            distance[p] = nearest_of(tree, few, boxes, count, x, y, z, 2.0 * reach)
        else:
            distance[p], best = nearest(tree, stack, x, y, z, best)
    return distance
