"""Where a mesh passes through itself: sweep along one axis, then edges against facets."""

from __future__ import annotations

import numpy as np
from numba import njit

from planner.mesh.facets import boxes_of
from planner.mesh.mesh import Floats, Ints, Mesh

DEPTH_FRACTION = 2e-6
"""How deep an edge must pierce a facet, as a fraction of the part's diagonal, to count: 30 times the rounding of
32-bit coordinates (6e-8), so that what only touches is not reported, and 0.1 micrometre on a part of 50 mm."""
MAX_COMPARISONS = 1_000_000_000
"""Boxes compared before the check is given up (about two seconds); a ball of a million facets needs a fiftieth."""
_MAX_STRIPS = 4096


def crossing_facets(mesh: Mesh) -> tuple[Ints, Floats, bool]:
    """Pairs of facets that pass through each other, by sweeping along one axis in strips across another.

    Returns (k, 2) int64 facets, (k, 3) float mm, a point of each crossing, and whether the check was completed.
    Facets that share an edge, touch, or lie in one plane do not count.
    """
    low, high = boxes_of(mesh.vertices, mesh.facets)
    width = (high - low).mean(axis=0) + 1e-300
    across, along, _ = np.argsort(-mesh.size / width, kind="stable").tolist()
    count = int(np.clip(mesh.size[across] / (2.0 * width[across]), 1, _MAX_STRIPS))
    step = mesh.size[across] / count + 1e-300
    first = np.clip(((low[:, across] - mesh.bounds[0, across]) / step).astype(np.int64), 0, count - 1)
    last = np.clip(((high[:, across] - mesh.bounds[0, across]) / step).astype(np.int64), 0, count - 1)
    order = np.argsort(low[:, along], kind="stable")
    start, items = _strips(order, first, last, count)
    depth_mm = DEPTH_FRACTION * mesh.diagonal
    pairs, places, comparisons = _sweep(
        mesh.vertices, mesh.facets, mesh.normals, low, high, start, items, first, along, depth_mm
    )
    return pairs, places, comparisons <= MAX_COMPARISONS


@njit(cache=True)
def _strips(order: Ints, first: Ints, last: Ints, count: int) -> tuple[Ints, Ints]:
    """Facets of each strip, in the order given: items[start[s] : start[s + 1]]."""
    start = np.zeros(count + 1, np.int64)
    for f in order:
        for s in range(first[f], last[f] + 1):
            start[s + 1] += 1
    for s in range(count):
        start[s + 1] += start[s]
    slot = start[:-1].copy()
    items = np.empty(start[-1], np.int64)
    for f in order:
        for s in range(first[f], last[f] + 1):
            items[slot[s]] = f
            slot[s] += 1
    return start, items


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
def _sweep(
    vertices: Floats,
    facets: Ints,
    normals: Floats,
    low: Floats,
    high: Floats,
    start: Ints,
    items: Ints,
    first: Ints,
    along: int,
    depth_mm: float,
) -> tuple[Ints, Floats, int]:
    """Crossing pairs, their places and how many boxes were compared; gives up above MAX_COMPARISONS.

    A pair that meets in several strips counts in the first strip that holds both.
    """
    pairs = np.empty((16, 2), np.int64)
    places = np.empty((16, 3), np.float64)
    place = np.empty(3, np.float64)
    count = 0
    comparisons = 0
    for s in range(start.shape[0] - 1):
        for i in range(start[s], start[s + 1]):
            f = items[i]
            for k in range(i + 1, start[s + 1]):
                g = items[k]
                if low[g, along] > high[f, along]:
                    break
                comparisons += 1
                if _boxes_apart(low, high, f, g) or max(first[f], first[g]) != s or _shared_corners(facets, f, g) >= 2:
                    continue
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
        if comparisons > MAX_COMPARISONS:
            break
    return pairs[:count], places[:count], comparisons


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
