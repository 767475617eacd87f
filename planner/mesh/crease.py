"""Where a mesh is meant to be sharp, and the normals of the smooth surface that its facets stand for elsewhere."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.mesh.ridge import ridge_edges

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
Weighting = Literal["sphere", "angle", "area"]

_SHORTEST = 0.005
"""Edges shorter than this share of the longest one around their fan count as that long: splinters get no weight."""


def edge_bends(mesh: Mesh) -> Floats:
    """Angle between the facets on both sides of each edge: (m, 3) float, rad, 0 … pi.

    Edge k of facet f runs from its vertex k to k + 1. 0 beside facets without area, pi at edges without a mate.
    """
    mate = mesh.half_edge_mates.reshape(-1, 3)
    across = np.where(mesh.adjacency >= 0, mate // 3, -1)
    own = mesh.normals[:, None, :]
    other = mesh.normals[np.maximum(across, 0)]
    angle = 2.0 * np.arctan2(np.linalg.norm(own - other, axis=2), np.linalg.norm(own + other, axis=2))
    has_area = mesh.areas > 0.0
    angle[~has_area[:, None] | ~has_area[np.maximum(across, 0)]] = 0.0
    angle[across < 0] = np.pi
    return np.asarray(angle)


def crease_edges(mesh: Mesh, crease_deg: float) -> Flags:
    """Which edges are creases: (m, 3) bool, edge k of facet f runs from its vertex k to k + 1.

    A crease bends more than crease_deg, or more than the surface beside it (`ridge.ridge_edges`), or has no facet on its
    other side. Both half-edges of an edge agree.
    """
    bends = edge_bends(mesh)
    crease_rad = float(np.radians(crease_deg))
    return np.asarray((bends > crease_rad) | ridge_edges(mesh, bends, crease_rad))


def corner_normals(mesh: Mesh, crease_deg: float, weighting: Weighting = "sphere") -> Floats:
    """Unit normal of the smooth surface at every corner of every facet: (m, 3, 3) float; zero where nothing has area.

    Corners of one vertex that reach each other over edges that bend at most crease_deg share one normal: the weighted
    mean of their facets' normals. weighting : "sphere" sin(angle) / (product of both edges' lengths), exact for every
    mesh with its vertices on a sphere; "angle" at the corner; "area" of the facet.
    Source: N. Max, Weights for computing vertex normals from facet normals, J. Graphics Tools 4 (1999).
    """
    fan = smooth_fans(mesh, crease_edges(mesh, crease_deg))
    weighted = mesh.normals[:, None, :] * _corner_weights(mesh, fan, weighting)[:, :, None]
    return fan_means(fan, weighted)


def fan_means(fan: Ints, weighted: Floats) -> Floats:
    """Unit sum of weighted normals per fan, handed back to every corner: (m, 3, 3) float.

    fan : (m, 3) int64 from `smooth_fans`;  weighted : (m, 3, 3) float, normal times weight of each corner.
    """
    total = np.empty((int(fan.max(initial=-1)) + 1, 3))
    for axis in range(3):
        total[:, axis] = np.bincount(fan.ravel(), weights=weighted[:, :, axis].ravel(), minlength=len(total))
    length = np.linalg.norm(total, axis=1)[:, None]
    unit = np.divide(total, length, out=np.zeros_like(total), where=length > 0.0)
    return np.asarray(unit[fan])


def smooth_fans(mesh: Mesh, creases: Flags) -> Ints:
    """Number of the fan of each corner: (m, 3) int64. Corners of one vertex joined by edges that are no creases.

    creases : (m, 3) bool from `crease_edges`.
    """
    mate = np.where((mesh.adjacency >= 0) & ~creases, mesh.half_edge_mates.reshape(-1, 3), -1)
    return np.asarray(_join_corners(mate.ravel())).reshape(-1, 3)


@njit(cache=True)
def _join_corners(mate: Ints) -> Ints:  # pragma: no cover
    """Fan of each corner 3f + k, numbered from 0 in order of first appearance.  mate : (3m,) int64, -1: not joined."""
    parent = np.arange(mate.size)
    for h in range(mate.size):
        g = mate[h]
        if g < 0 or g < h:
            continue
        after_h, after_g = h // 3 * 3 + (h + 1) % 3, g // 3 * 3 + (g + 1) % 3
        for a, b in ((h, after_g), (after_h, g)):
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if a < b:
                parent[b] = a
            else:
                parent[a] = b
    number = np.empty(mate.size, np.int64)
    count = 0
    for c in range(mate.size):
        root = c
        while parent[root] != root:
            root = parent[root]
        if root == c:
            number[c] = count
            count += 1
        else:
            number[c] = number[root]
    return number


def _corner_weights(mesh: Mesh, fan: Ints, weighting: Weighting) -> Floats:
    """(m, 3) float: how much each facet counts at each of its corners. Raises ValueError for another weighting."""
    if weighting == "area":
        return np.asarray(np.repeat(mesh.areas[:, None], 3, axis=1))
    edges = np.roll(mesh.corners, -1, axis=1) - mesh.corners
    length = np.linalg.norm(edges, axis=2)
    incoming = np.roll(edges, 1, axis=1)
    if weighting == "angle":
        cosine = -np.einsum("mkd,mkd->mk", edges, incoming)
        return np.asarray(np.arctan2(2.0 * mesh.areas[:, None], cosine))
    if weighting != "sphere":
        raise ValueError(f"weighting is {weighting!r}, not 'sphere', 'angle' or 'area'")
    before = np.roll(length, 1, axis=1)
    longest = np.full(int(fan.max(initial=-1)) + 1, 1e-75)
    np.maximum.at(longest, fan.ravel(), np.maximum(length, before).ravel())
    least = _SHORTEST * longest[fan]
    return np.asarray(2.0 * mesh.areas[:, None] / (np.maximum(length, least) * np.maximum(before, least)) ** 2)
