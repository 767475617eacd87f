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
    The nearest chord of a fine sample, then Newton on (C - P)·C' = 0 inside its knot span.
    Source: Piegl & Tiller ch. 6.1.
    """
    goal = np.atleast_2d(np.asarray(points, dtype=np.float64))
    samples = _samples(curve)
    ends = curve.evaluate(samples)
    chord, share = _nearest_piece(goal, ends[:-1], ends[1:])
    width = np.diff(samples)
    u = samples[chord] + share * width[chord]
    span = np.clip(np.searchsorted(curve.breaks, samples[chord], side="right") - 1, 0, len(curve.breaks) - 2)
    low = np.maximum(curve.breaks[span], samples[chord] - width[chord])
    high = np.minimum(curve.breaks[span + 1], samples[chord + 1] + width[chord])
    return _newton(curve, goal, u, low, high)


def _samples(curve: Curve) -> Floats:
    """Parameters, several per span and closer where a span is long: no chord is far longer than the mean."""
    edges = curve.breaks
    reach = np.linalg.norm(np.diff(curve.evaluate(edges), axis=0), axis=1)
    mean = max(float(reach.mean()), 1e-300)
    counts = np.ceil(_SAMPLES_PER_SPAN * np.maximum(reach / mean, 1.0)).astype(np.intp)
    return divide_evenly(edges, counts)


def _newton(curve: Curve, goal: Floats, u: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The best parameter between low and high, which lie in one span, and its distance."""
    inner = high - 1e-12 * (high - low)  # at the span's end itself the derivatives would be the next span's
    best, shortest = u, np.linalg.norm(curve.evaluate(u) - goal, axis=1)
    for _ in range(_NEWTON_STEPS):
        point, first, second = curve.derivatives(u, 2)
        away = point - goal
        slope = np.einsum("ij,ij->i", away, first)
        bend = np.einsum("ij,ij->i", first, first)
        full = bend + np.einsum("ij,ij->i", away, second)
        step = slope / np.maximum(np.where(full > 0.0, full, bend), 1e-300)
        moved = np.clip(u - step, low, inner)
        change = np.abs(moved - u)
        u = moved
        distance = np.linalg.norm(curve.evaluate(u) - goal, axis=1)
        closer = distance < shortest
        best, shortest = np.where(closer, u, best), np.where(closer, distance, shortest)
        if change.max(initial=0.0) <= 1e-14 * (curve.domain[1] - curve.domain[0]):
            break
    return best, shortest


def distances_to_polyline(points: ArrayLike, polyline: ArrayLike, *, closed: bool) -> Floats:
    """Distance of each point from the polyline: (k,) float, mm.

    points : (k, d) float, mm   polyline : (n, d) float, mm, n >= 2.   Exact.
    """
    goal = np.atleast_2d(np.asarray(points, dtype=np.float64))
    path = np.asarray(polyline, dtype=np.float64)
    path = np.vstack([path, path[:1]]) if closed else path
    side, share = _nearest_piece(goal, path[:-1], path[1:])
    foot = path[side] + share[:, None] * (path[side + 1] - path[side])
    return np.asarray(np.linalg.norm(goal - foot, axis=1))


def _nearest_piece(goal: Floats, low: Floats, high: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Index of the straight piece nearest to each point, and where on it (0 ... 1) the nearest point lies.

    Pieces are cut to lengths of at most 2h. One can be nearest only if its middle is within (best so far + h) of the
    point; more candidates from a k-d tree of the middles are tried until that is decided.
    """
    length = np.linalg.norm(high - low, axis=1)
    parts = np.maximum(np.ceil(4.0 * length / max(float(length.mean()), 1e-300)), 1).astype(np.intp)
    owner = np.repeat(np.arange(len(low)), parts)
    first = np.cumsum(parts) - parts
    middle_share = (np.arange(len(owner)) - first[owner] + 0.5) / parts[owner]
    half = 0.5 * float((length / parts).max())
    tree = cKDTree(low[owner] + middle_share[:, None] * (high - low)[owner])
    piece, share = np.zeros(len(goal), dtype=np.intp), np.zeros(len(goal))
    undecided, count = np.arange(len(goal)), min(8, len(owner))
    while undecided.size:
        reach, index = tree.query(goal[undecided], k=count)
        reach, index = np.reshape(reach, (-1, count)), owner[np.reshape(index, (-1, count))]
        along, distance = feet_on_segments(goal[undecided][:, None, :], low[index], high[index])
        best = np.argmin(distance, axis=1)
        rows = np.arange(len(undecided))
        piece[undecided], share[undecided] = index[rows, best], along[rows, best]
        if count == len(owner):
            break
        undecided = undecided[reach[:, -1] < distance[rows, best] + half]
        count = min(4 * count, len(owner))
    return piece, share


def feet_on_segments(points: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Where on each segment low-high (0 ... 1) the point nearest to `points` lies, and its distance: (...) float each.

    points, low, high : (..., d) float, mm, broadcast against each other.
    """
    chord = high - low
    length2 = np.maximum((chord**2).sum(axis=-1), 1e-300)
    along = np.clip(((points - low) * chord).sum(axis=-1) / length2, 0.0, 1.0)
    return along, np.linalg.norm(points - low - along[..., None] * chord, axis=-1)


def deviation_from_polyline(curve: Curve, polyline: ArrayLike, *, closed: bool | None = None) -> Deviation:
    """Both ways between a curve and a polyline (its sides count, not only its points).

    polyline : (n, d) float, mm   closed : default, as the curve is.
    The curve is measured at 8 points per span or more, the polyline at its points and its sides' quarters.
    """
    path = np.asarray(polyline, dtype=np.float64)
    loop = curve.is_closed if closed is None else closed
    outward = distances_to_polyline(curve.evaluate(_samples(curve)), path, closed=loop)
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
