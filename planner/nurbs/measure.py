"""How far a curve lies from points and from a polyline, both ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from planner.nurbs.curve import Curve
from planner.nurbs.sampling import divide_evenly

Floats = NDArray[np.float64]

_SAMPLES_PER_SPAN = 8  # a cubic piece between two contour points bends once or twice: its extremes lie between these
_NEIGHBOURS = 3  # nearest samples that are refined: where two branches pass close by, the nearest sample may mislead
_NEWTON_STEPS = 20


@dataclass(frozen=True)
class Deviation:
    """Largest distances between a curve and what it stands for, mm.

    curve_to_data : of any (sampled) point of the curve from the data
    data_to_curve : of any point of the data from the curve
    """

    curve_to_data: float
    data_to_curve: float

    @property
    def largest(self) -> float:
        """The larger of both ways, mm."""
        return max(self.curve_to_data, self.data_to_curve)


def closest_points(curve: Curve, points: ArrayLike) -> tuple[Floats, Floats]:
    """Parameter of, and distance to, the point of the curve nearest to each given point.

    points : (k, d) float, mm   Returns ((k,) float, (k,) float mm).
    Nearest samples from a k-d tree, then Newton on (C - P)·C' = 0 between the samples beside them.
    Source: Piegl & Tiller ch. 6.1.
    """
    targets = np.atleast_2d(np.asarray(points, dtype=np.float64))
    samples = divide_evenly(curve.breaks, np.full(len(curve.breaks) - 1, _SAMPLES_PER_SPAN, dtype=np.intp))
    _, nearest = cKDTree(curve.evaluate(samples)).query(targets, k=min(_NEIGHBOURS, len(samples)))
    index = np.asarray(nearest, dtype=np.intp).reshape(len(targets), -1)
    columns = index.shape[1]
    low = samples[np.maximum(index - 1, 0)].ravel()
    high = samples[np.minimum(index + 1, len(samples) - 1)].ravel()
    goal = np.repeat(targets, columns, axis=0)
    u = _newton(curve, goal, samples[index].ravel(), low, high)
    distance = np.linalg.norm(curve.evaluate(u) - goal, axis=1).reshape(-1, columns)
    best = np.argmin(distance, axis=1)
    rows = np.arange(len(targets))
    return u.reshape(-1, columns)[rows, best], distance[rows, best]


def _newton(curve: Curve, goal: Floats, u: Floats, low: Floats, high: Floats) -> Floats:
    best, shortest = u, np.linalg.norm(curve.evaluate(u) - goal, axis=1)
    for _ in range(_NEWTON_STEPS):
        point, first, second = curve.derivatives(u, 2)
        away = point - goal
        slope = np.einsum("ij,ij->i", away, first)
        bend = np.einsum("ij,ij->i", first, first)
        full = bend + np.einsum("ij,ij->i", away, second)
        step = slope / np.maximum(np.where(full > 0.0, full, bend), 1e-300)
        moved = np.clip(u - step, low, high)
        change = np.abs(moved - u)
        u = moved
        distance = np.linalg.norm(curve.evaluate(u) - goal, axis=1)
        closer = distance < shortest
        best, shortest = np.where(closer, u, best), np.where(closer, distance, shortest)
        if change.max(initial=0.0) <= 1e-14 * (curve.domain[1] - curve.domain[0]):
            break
    return best


def distances_to_polyline(points: ArrayLike, polyline: ArrayLike, *, closed: bool) -> Floats:
    """Distance of each point from the polyline: (k,) float, mm.

    points : (k, d) float, mm   polyline : (n, d) float, mm, n >= 2.
    Exact: sides are cut to even pieces of half-length h; a piece can be nearest only if its middle is within
    (best + h) of the point, and more candidates are tried until that is decided.
    """
    goal = np.atleast_2d(np.asarray(points, dtype=np.float64))
    path = np.asarray(polyline, dtype=np.float64)
    path = np.vstack([path, path[:1]]) if closed else path
    sides = np.linalg.norm(np.diff(path, axis=0), axis=1)
    piece = max(float(sides.sum()) / (4.0 * len(sides)), 1e-12)
    parts = np.maximum(np.ceil(sides / piece), 1).astype(np.intp)
    at = divide_evenly(np.arange(len(path), dtype=np.float64), parts)
    owner = np.repeat(np.arange(len(sides)), parts)
    share = at - np.append(owner, owner[-1])
    ends = path[np.append(owner, owner[-1])] + share[:, None] * np.diff(path, axis=0)[np.append(owner, owner[-1])]
    low, high = ends[:-1], ends[1:]
    half = 0.5 * float(np.linalg.norm(high - low, axis=1).max())
    tree = cKDTree(0.5 * (low + high))
    result = np.full(len(goal), np.inf)
    undecided, count = np.arange(len(goal)), min(8, len(low))
    while undecided.size:
        reach, index = tree.query(goal[undecided], k=count)
        reach, index = np.reshape(reach, (-1, count)), np.reshape(index, (-1, count))
        result[undecided] = _from_segments(goal[undecided][:, None, :], low[index], high[index]).min(axis=1)
        if count == len(low):
            break
        undecided = undecided[reach[:, -1] < result[undecided] + half]
        count = min(4 * count, len(low))
    return result


def _from_segments(points: Floats, low: Floats, high: Floats) -> Floats:
    chord = high - low
    length2 = np.maximum((chord**2).sum(axis=-1), 1e-300)
    along = np.clip(((points - low) * chord).sum(axis=-1) / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - low - along[..., None] * chord, axis=-1))


def deviation_from_polyline(curve: Curve, polyline: ArrayLike, *, closed: bool | None = None) -> Deviation:
    """Both ways between a curve and a polyline (its sides count, not only its points).

    polyline : (n, d) float, mm   closed : default, as the curve is.
    The curve is measured at 8 points per span, the polyline at its points and its sides' quarters.
    """
    path = np.asarray(polyline, dtype=np.float64)
    loop = curve.is_closed if closed is None else closed
    samples = divide_evenly(curve.breaks, np.full(len(curve.breaks) - 1, _SAMPLES_PER_SPAN, dtype=np.intp))
    outward = distances_to_polyline(curve.evaluate(samples), path, closed=loop)
    following = np.roll(path, -1, axis=0) if loop else path[1:]
    start = path if loop else path[:-1]
    quarters = [start + share * (following - start) for share in (0.25, 0.5, 0.75)]
    _, inward = closest_points(curve, np.vstack([path, *quarters]))
    return Deviation(float(outward.max()), float(inward.max()))


def deviation(curve: Curve, polyline: ArrayLike, *, closed: bool | None = None) -> float:
    """Largest distance between the curve and the polyline, both ways, mm (see `deviation_from_polyline`)."""
    return deviation_from_polyline(curve, polyline, closed=closed).largest


def deviation_from_points(curve: Curve, points: ArrayLike) -> float:
    """Largest distance of the points from the curve, mm. points : (k, d) float, mm."""
    return float(closest_points(curve, points)[1].max())
