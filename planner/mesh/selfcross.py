"""Where a mesh passes through itself: sweep along one axis, then edges against facets."""

from __future__ import annotations

import numpy as np
from numba import njit

from planner.mesh.mesh import Floats, Ints, Mesh

DEPTH_FRACTION = 2e-6
"""How deep an edge must pierce a facet, as a fraction of the part's diagonal, to count: 30 times the rounding of
32-bit coordinates (6e-8), so that what only touches is not reported, and 0.1 micrometre on a part of 50 mm."""
MAX_SWEEP_PAIRS = 400_000_000
"""Pairs of boxes that are compared before the check is given up (about a second)."""


def sweep_axis(mesh: Mesh) -> tuple[int, int]:
    """Axis along which the fewest facet boxes overlap, and how many pairs do."""
    low, high = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    pairs = []
    for axis in range(3):
        begin = np.sort(low[:, axis])
        after = np.searchsorted(begin, high[:, axis], side="right")
        before = np.searchsorted(begin, low[:, axis], side="right")
        pairs.append(int((after - before).sum()) + len(begin))
    best = int(np.argmin(pairs))
    return best, pairs[best]


def crossing_facets(mesh: Mesh, axis: int) -> tuple[Ints, Floats]:
    """Pairs of facets that pass through each other, found by sweeping along `axis`.

    Returns (k, 2) int64 facets and (k, 3) float mm, a point of each crossing. Facets that share an edge, touch, or lie
    in one plane do not count.
    """
    low, high = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    order = np.argsort(low[:, axis], kind="stable")
    return _sweep(mesh.vertices, mesh.facets, mesh.normals, low, high, order, axis, DEPTH_FRACTION * mesh.diagonal)


@njit(cache=True)
def _sweep(
    vertices: Floats, facets: Ints, normals: Floats, low: Floats, high: Floats, order: Ints, axis: int, depth_mm: float
) -> tuple[Ints, Floats]:
    second, third = (axis + 1) % 3, (axis + 2) % 3
    pairs = np.empty((16, 2), np.int64)
    places = np.empty((16, 3), np.float64)
    count = 0
    for i in range(order.shape[0]):
        f = order[i]
        for k in range(i + 1, order.shape[0]):
            g = order[k]
            if low[g, axis] > high[f, axis]:
                break
            if low[g, second] > high[f, second] or low[f, second] > high[g, second]:
                continue
            if low[g, third] > high[f, third] or low[f, third] > high[g, third]:
                continue
            shared = 0
            for a in range(3):
                for b in range(3):
                    if facets[f, a] == facets[g, b]:
                        shared += 1
            if shared >= 2:
                continue
            place = np.empty(3, np.float64)
            if not (
                _edges_pierce(vertices, facets, normals, f, g, depth_mm, place)
                or _edges_pierce(vertices, facets, normals, g, f, depth_mm, place)
            ):
                continue
            if count == pairs.shape[0]:
                pairs = np.concatenate((pairs, np.empty_like(pairs)))
                places = np.concatenate((places, np.empty_like(places)))
            pairs[count, 0], pairs[count, 1] = min(f, g), max(f, g)
            places[count] = place
            count += 1
    return pairs[:count], places[:count]


@njit(cache=True)
def _edges_pierce(
    vertices: Floats, facets: Ints, normals: Floats, f: int, g: int, depth_mm: float, place: Floats
) -> bool:
    """Whether an edge of facet f passes through facet g, deeper than depth_mm on both sides and within its rim."""
    n = normals[g]
    base = vertices[facets[g, 0]]
    for j in range(3):
        p = vertices[facets[f, j]]
        q = vertices[facets[f, (j + 1) % 3]]
        hp = (p[0] - base[0]) * n[0] + (p[1] - base[1]) * n[1] + (p[2] - base[2]) * n[2]
        hq = (q[0] - base[0]) * n[0] + (q[1] - base[1]) * n[1] + (q[2] - base[2]) * n[2]
        if not ((hp > depth_mm and hq < -depth_mm) or (hp < -depth_mm and hq > depth_mm)):
            continue
        t = hp / (hp - hq)
        for axis in range(3):
            place[axis] = p[axis] + t * (q[axis] - p[axis])
        inside = True
        for k in range(3):
            a = vertices[facets[g, k]]
            b = vertices[facets[g, (k + 1) % 3]]
            ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            rx, ry, rz = place[0] - a[0], place[1] - a[1], place[2] - a[2]
            # distance inward of the rim edge: (n x e) . r / |e|
            inward = (
                (n[1] * ez - n[2] * ey) * rx + (n[2] * ex - n[0] * ez) * ry + (n[0] * ey - n[1] * ex) * rz
            ) / np.sqrt(ex * ex + ey * ey + ez * ez)
            if inward < depth_mm:
                inside = False
                break
        if inside:
            return True
    return False
