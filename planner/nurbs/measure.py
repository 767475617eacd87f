"""How far a curve lies from points and from a polyline, both ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.closest import closest_points
from planner.nurbs.curve import Curve
from planner.nurbs.sampling import divide_evenly

__all__ = [
    "Deviation", "closest_points", "deviation", "deviation_from_points", "deviation_from_polyline",
    "distances_to_polyline", "feet_on_segments",
]  # fmt: skip

Floats = NDArray[np.float64]

_SAMPLES = 8  # per piece or side, more where it is long: a cubic piece bends once or twice, its extremes lie between
_FINER = 8  # parts of a stretch beside a largest sample that are looked at next
_ROUNDS = 4  # 4**4 times finer: a smooth maximum is then known to 1e-6 of its height above the samples beside it
_NEAR = 0.5  # samples lower than this share of the highest are no maximum in hiding


@dataclass(frozen=True)
class Deviation:
    """Largest distances between a curve and what it stands for, mm.

    curve_to_data : of any point of the curve from the data
    data_to_curve : of any point of the data from the curve
    """

    curve_to_data: float
    data_to_curve: float

    @property
    def largest(self) -> float:
        """The larger of both ways, mm."""
        return max(self.curve_to_data, self.data_to_curve)


def distances_to_polyline(points: ArrayLike, polyline: ArrayLike, *, closed: bool) -> Floats:
    """Distance of each point from the polyline: (k,) float, mm.

    points : (k, d) float, mm   polyline : (n, d) float, mm, n >= 2 distinct.   Exact, by a tree of its sides.
    """
    goal = np.atleast_2d(np.asarray(points, dtype=np.float64))
    return closest_points(_as_curve(polyline, closed), goal)[1]


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

    polyline : (n, d) float, mm, n >= 2 distinct   closed : default, as the curve is.
    Each is sampled 8 times per piece or side and finer around its farthest samples; every distance is exact.
    """
    path = _as_curve(polyline, curve.is_closed if closed is None else closed)
    return Deviation(_farthest(curve, path), _farthest(path, curve))


def deviation(curve: Curve, polyline: ArrayLike, *, closed: bool | None = None) -> float:
    """Largest distance between the curve and the polyline, both ways, mm (see `deviation_from_polyline`)."""
    return deviation_from_polyline(curve, polyline, closed=closed).largest


def deviation_from_points(curve: Curve, points: ArrayLike) -> float:
    """Largest distance of the points from the curve, mm. points : (k, d) float, mm."""
    return float(closest_points(curve, points)[1].max())


def _as_curve(polyline: ArrayLike, closed: bool) -> Curve:
    """The polyline as a curve of degree 1, repeated points left out."""
    path = np.asarray(polyline, dtype=np.float64)
    path = path[np.append(True, np.any(path[1:] != path[:-1], axis=1))]
    while closed and len(path) > 1 and np.array_equal(path[0], path[-1]):
        path = path[:-1]
    return Curve.from_polyline(path, closed=closed)


def _farthest(curve: Curve, other: Curve) -> float:
    """The largest distance of any point of the curve from the other, mm."""

    def away(u: Floats) -> Floats:
        return closest_points(other, curve.evaluate(u))[1]

    return _maximum(away, _samples(curve))


def _samples(curve: Curve) -> Floats:
    """Parameters, several per span and closer where a span is long: no chord is far longer than the mean."""
    edges = curve.breaks
    reach = np.linalg.norm(np.diff(curve.evaluate(edges), axis=0), axis=1)
    mean = max(float(reach.mean()), 1e-300)
    counts = np.ceil(_SAMPLES * np.maximum(reach / mean, 1.0)).astype(np.intp)
    return divide_evenly(edges, counts)


def _maximum(height: Callable[[Floats], Floats], at: Floats) -> float:
    """The maximum of a function, by samples and finer ones around each of their peaks that may hold it.

    at : (k,) float, increasing   The peaks looked at are those that could rise to the highest if each rose by as much
    as it stands above its neighbours.
    """
    found = height(at)
    padded = np.concatenate([[-np.inf], found, [-np.inf]])
    peak = (found >= padded[:-2]) & (found >= padded[2:])
    beside = np.minimum(np.where(np.isfinite(padded[:-2]), padded[:-2], found),
                        np.where(np.isfinite(padded[2:]), padded[2:], found))  # fmt: skip
    best = float(found.max())
    rows = np.flatnonzero(peak & (found + (found - beside) >= best) & (found >= _NEAR * best))
    low, high = at[np.maximum(rows - 1, 0)], at[np.minimum(rows + 1, len(at) - 1)]
    for _ in range(_ROUNDS):
        grid = low[:, None] + (high - low)[:, None] * (np.arange(_FINER + 1) / _FINER)
        tops = height(grid.ravel()).reshape(grid.shape)
        best = max(best, float(tops.max(initial=0.0)))
        top, each = tops.argmax(axis=1), np.arange(len(low))
        low, high = grid[each, np.maximum(top - 1, 0)], grid[each, np.minimum(top + 1, _FINER)]
    return best
