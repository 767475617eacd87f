"""Adding and dropping contour points: the paper's densification, and points that only facet diagonals made."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


def densify(points: ArrayLike, spacing_mm: float, *, closed: bool) -> Floats:
    """The contour with points added on its sides until none is longer than the spacing.

    points : (n, d) float, mm   Returns (m, d) float, the given points among them.
    The added points are collinear: a curve through them follows the facets, not the surface they stand for.
    Raises ValueError if the spacing is not positive.
    Source: paper Eqs. 12, 13 as corrected: n = ceil(L / spacing) by each side's own length, i = 1 ... n-1.
    """
    if not spacing_mm > 0.0:
        raise ValueError(f"the spacing must be positive, not {spacing_mm:g} mm")
    path = np.asarray(points, dtype=np.float64)
    sides = (np.roll(path, -1, axis=0) if closed else path[1:]) - (path if closed else path[:-1])
    parts = np.maximum(np.ceil(np.linalg.norm(sides, axis=1) / spacing_mm), 1).astype(np.intp)
    step = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    from_point = np.repeat(np.arange(len(sides)), parts)
    dense = path[from_point] + (step / parts[from_point])[:, None] * sides[from_point]
    return dense if closed else np.vstack([dense, path[-1:]])


def drop_collinear(points: ArrayLike, tolerance_mm: float, *, closed: bool) -> tuple[Floats, Indices]:
    """The contour without points that lie on the straight line between their neighbours.

    A run of several goes only if all of it lies within the tolerance of the line between the points that stay; a
    point where the contour turns back stays. Two points (closed: three) always stay.
    points : (n, d) float, mm   Returns (kept points (k, d), their indices (k,) int, increasing).
    """
    path = np.asarray(points, dtype=np.float64)
    count = len(path)
    if count <= (3 if closed else 2):
        return path, np.arange(count)
    before, after = path - np.roll(path, 1, axis=0), np.roll(path, -1, axis=0) - path
    away = _distance_from_chord(np.zeros_like(path), before, before + after)
    stays = (away > tolerance_mm) | (np.einsum("ij,ij->i", before, after) <= 0.0)
    if not closed:
        stays[[0, -1]] = True
    else:
        _seed(path, stays)
    while True:
        anchors = np.flatnonzero(stays)
        gap = np.searchsorted(anchors, np.arange(count), side="right") - 1
        low, high = anchors[gap], anchors[(gap + 1) % len(anchors)]
        distance = np.where(stays, 0.0, _distance_from_chord(path[low], path, path[high]))
        if distance.max() <= tolerance_mm:
            return path[anchors], anchors
        farthest = np.lexsort((distance, gap % len(anchors)))
        ends = np.flatnonzero(np.diff(gap[farthest] % len(anchors), append=-1))
        worst = farthest[ends]
        stays[worst[distance[worst] > tolerance_mm]] = True


def _seed(path: Floats, stays: NDArray[np.bool_]) -> None:
    """Make sure that a closed contour keeps three points that span it."""
    if stays.sum() >= 3:
        return
    first = int(np.flatnonzero(stays)[0]) if stays.any() else 0
    opposite = int(np.argmax(np.linalg.norm(path - path[first], axis=1)))
    widest = int(np.argmax(_distance_from_chord(path[first], path, path[opposite])))
    stays[[first, opposite, widest]] = True


def _distance_from_chord(low: Floats, points: Floats, high: Floats) -> Floats:
    """Distance of points from the segments low-high, broadcast over (n, d)."""
    chord = high - low
    length2 = np.maximum((chord**2).sum(axis=-1), 1e-300)
    away = points - low
    along = np.clip((away * chord).sum(axis=-1) / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - along[..., None] * chord, axis=-1))
