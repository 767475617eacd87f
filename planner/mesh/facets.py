"""Kernels over the facets of a mesh: area vectors, centroids, boxes, and which are flat or collapsed."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@njit(cache=True)
def area_vectors_of(vertices: Floats, facets: Ints) -> Floats:
    """(m, 3) float, mm²: outward normal times area of each facet.  vertices : (n, 3) float mm;  facets : (m, 3)."""
    result = np.empty((facets.shape[0], 3), np.float64)
    for f in range(facets.shape[0]):
        a, b, c = facets[f, 0], facets[f, 1], facets[f, 2]
        px, py, pz = (vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2])
        qx, qy, qz = (vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2])
        result[f, 0] = 0.5 * (py * qz - pz * qy)
        result[f, 1] = 0.5 * (pz * qx - px * qz)
        result[f, 2] = 0.5 * (px * qy - py * qx)
    return result


@njit(cache=True)
def lengths_of(vectors: Floats) -> Floats:
    """(n,) float: length of each row of vectors (n, 3)."""
    result = np.empty(vectors.shape[0], np.float64)
    for i in range(vectors.shape[0]):
        result[i] = np.sqrt(vectors[i, 0] ** 2 + vectors[i, 1] ** 2 + vectors[i, 2] ** 2)
    return result


@njit(cache=True)
def centroids_of(vertices: Floats, facets: Ints) -> Floats:
    """(m, 3) float, mm: mean of each facet's corners.  vertices : (n, 3) float mm;  facets : (m, 3)."""
    result = np.empty((facets.shape[0], 3), np.float64)
    for f in range(facets.shape[0]):
        for axis in range(3):
            total = vertices[facets[f, 0], axis] + vertices[facets[f, 1], axis] + vertices[facets[f, 2], axis]
            result[f, axis] = total / 3.0
    return result


@njit(cache=True)
def boxes_of(vertices: Floats, facets: Ints) -> tuple[Floats, Floats]:
    """Lowest and highest corner, (m, 3) float mm each, of the box around every facet."""
    low = np.empty((facets.shape[0], 3), np.float64)
    high = np.empty((facets.shape[0], 3), np.float64)
    for f in range(facets.shape[0]):
        for axis in range(3):
            a, b, c = vertices[facets[f, 0], axis], vertices[facets[f, 1], axis], vertices[facets[f, 2], axis]
            low[f, axis] = min(a, min(b, c))
            high[f, axis] = max(a, max(b, c))
    return low, high


@njit(cache=True)
def bounds_of(vertices: Floats, facets: Ints) -> Floats:
    """(2, 3) float, mm: the box around all facets, of which there is at least one; unused vertices do not count."""
    result = np.empty((2, 3), np.float64)
    result[0] = vertices[facets[0, 0]]
    result[1] = result[0]
    for f in range(facets.shape[0]):
        for j in range(3):
            for axis in range(3):
                value = vertices[facets[f, j], axis]
                result[0, axis] = min(result[0, axis], value)
                result[1, axis] = max(result[1, axis], value)
    return result


@njit(cache=True)
def flat_mask(vertices: Floats, facets: Ints, least_height_mm: float) -> Flags:
    """(m,) bool: facets whose height over their longest edge is at most least_height_mm."""
    result = np.empty(facets.shape[0], np.bool_)
    vectors = area_vectors_of(vertices, facets)
    for f in range(facets.shape[0]):
        longest = 0.0
        for j in range(3):
            a, b = facets[f, j], facets[f, j + 1 if j < 2 else 0]
            squared = 0.0
            for axis in range(3):
                squared += (vertices[b, axis] - vertices[a, axis]) ** 2
            longest = max(longest, squared)
        doubled = 4.0 * (vectors[f, 0] ** 2 + vectors[f, 1] ** 2 + vectors[f, 2] ** 2)
        result[f] = doubled <= least_height_mm**2 * longest
    return result


@njit(cache=True)
def collapsed_mask(facets: Ints) -> Flags:
    """(m,) bool: facets that name a vertex twice."""
    result = np.empty(facets.shape[0], np.bool_)
    for f in range(facets.shape[0]):
        a, b, c = facets[f, 0], facets[f, 1], facets[f, 2]
        result[f] = a == b or b == c or c == a
    return result


@njit(cache=True)
def pieces_of(across: NDArray[np.int32]) -> tuple[Ints, int]:
    """Connected surfaces: (m,) int64 number of each facet's, in order of first facet, and how many there are.

    across : (3m,) int32, the half-edge on the other side of each, -1 where there is none
    """
    count = across.shape[0] // 3
    piece = np.full(count, -1, np.int64)
    stack = np.empty(count, np.int32)
    pieces = 0
    for first in range(count):
        if piece[first] >= 0:
            continue
        piece[first] = pieces
        stack[0] = first
        top = 1
        while top > 0:
            top -= 1
            f = stack[top]
            for h in range(3 * f, 3 * f + 3):
                g = across[h] // 3
                if across[h] >= 0 and piece[g] < 0:
                    piece[g] = pieces
                    stack[top] = g
                    top += 1
        pieces += 1
    return piece, pieces
