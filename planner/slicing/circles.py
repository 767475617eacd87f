"""The thickest layers that the circles of curvature of all facets in a slab allow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.crease import corner_normals
from planner.mesh.curvature import facet_curvatures, normal_curvatures
from planner.mesh.mesh import Mesh
from planner.slicing.cusp import circle_thickness
from planner.slicing.stations import Stations

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Circles:
    """The circle of curvature of each facet in the plane of build direction and normal; facets sorted by low.

    low, high, middle : (m,) float   stations of its corners and its centre   rate : (m,) float, mm per station
    sigma : (m,) float   n·b, signed     rho_mm : (m,) float, inf for flat ones     convex : (m,) bool
    level : (m,) bool    facets that lie in a plane of the way: their cusp is in no wall
    """

    low: Floats
    high: Floats
    middle: Floats
    rate: Floats
    sigma: Floats
    rho_mm: Floats
    convex: NDArray[np.bool_]
    level: NDArray[np.bool_]


def facet_circles(mesh: Mesh, stations: Stations, crease_deg: float, touch: float) -> Circles:
    """Circles of all facets.  touch : rise, in stations, up to which a facet is level."""
    tensors = facet_curvatures(mesh, corner_normals(mesh, crease_deg))
    sigma = np.einsum("ij,ij->i", mesh.normals, stations.direction)
    uphill = stations.direction - sigma[:, None] * mesh.normals
    length = np.linalg.norm(uphill, axis=1)
    flat = length < 1e-9
    kappa = normal_curvatures(tensors, uphill / np.where(flat, 1.0, length)[:, None])
    kappa[flat] = 0.0
    rho = np.divide(1.0, np.abs(kappa), out=np.full(len(kappa), np.inf), where=np.abs(kappa) > 1e-12)
    level = (stations.high - stations.low <= touch) | (mesh.areas == 0.0)
    order = np.argsort(stations.low, kind="stable")
    return Circles(
        *(
            np.ascontiguousarray(values[order])
            for values in (stations.low, stations.high, stations.middle, stations.rate, sigma, rho, kappa >= 0.0, level)
        )
    )  # fmt: skip


def thickest_boundaries(
    circles: Circles,
    span: tuple[float, float],
    bounds_mm: tuple[float, float],
    scale: tuple[Floats, Floats],
    delta_mm: float,
    codes: tuple[int, int],
    touch: float,
) -> Floats:
    """Stations of the thickest layers from the bottom of the span upwards; the last reaches its top or lies above it.

    bounds_mm : least and greatest thickness      scale : stations (s,) ascending and what the allowed thickness is
    multiplied by there (s,), linear between       codes : rule and side as in `planner.slicing.cusp`
    touch : overlap, in stations, that does not count.
    """
    return np.asarray(
        _thickest(
            circles.low, circles.high, circles.middle, circles.rate, circles.sigma, circles.rho_mm, circles.convex,
            circles.level, span[0], span[1], bounds_mm[0], bounds_mm[1], scale[0], scale[1], delta_mm, codes[0], codes[1],
            touch,
        )
    )  # fmt: skip


@njit(cache=True)
def _thickest(
    low: Floats, high: Floats, middle: Floats, rate: Floats, sigma: Floats, rho: Floats, convex: NDArray[np.bool_],
    level: NDArray[np.bool_], bottom: float, top: float, min_mm: float, max_mm: float, scale_from: Floats,
    scale: Floats, delta: float, rule: int, side: int, touch: float,
) -> Floats:  # pragma: no cover  # fmt: skip
    """See `thickest_boundaries`: greedy from below; facets that the layer may meet are kept in a list."""
    slowest = np.inf
    for f in range(rate.shape[0]):
        slowest = min(slowest, rate[f])
    found = [bottom]
    active = np.empty(low.shape[0], np.int64)
    count, following, z = 0, 0, bottom
    while z < top - touch:
        kept = 0
        for i in range(count):
            if high[active[i]] > z + touch:
                active[kept] = active[i]
                kept += 1
        count = kept
        while following < low.shape[0] and low[following] < z + max_mm / slowest:
            if high[following] > z + touch and not level[following]:
                active[count] = following
                count += 1
            following += 1
        share = np.interp(z, scale_from, scale)
        best = max_mm / slowest if count == 0 else np.inf
        for i in range(count):
            f = active[i]
            if low[f] >= z + best:
                continue
            limit = _limit(
                low[f] - z, (middle[f] - z) * rate[f], sigma[f], rho[f], convex[f], delta, rule, side, rate[f]
            )
            best = min(best, max(min(limit * share, max_mm), min_mm) / rate[f])
        z += best
        found.append(z)
    return np.array(found)


@njit(cache=True)
def _limit(
    before: float, up_mm: float, sigma: float, rho: float, convex: bool, delta: float, rule: int, side: int, rate: float
) -> float:  # pragma: no cover
    """Thickness, mm, that one facet allows a layer whose bottom lies up_mm under its centre.

    before : stations from the layer's bottom to the facet's lowest point. A flat facet that begins higher may be left to
    the next layer; a bent one is followed down its circle to the layer's bottom, but not past the circle's equator.
    """
    if not rho < 1e6 * delta:
        flat = circle_thickness(sigma, np.inf, convex, delta, rule, side)
        return max(flat, before * rate)
    height = rho * sigma if convex else -rho * sigma  # of the facet's centre over the centre of its circle
    start = height - up_mm
    if up_mm > 0.0 and height > 0.0:
        start = max(start, 0.0)
    start = min(max(start, -rho), rho)
    waits = start - (height - up_mm)  # the circle begins that far above the layer's bottom
    slope = start / rho if convex else -start / rho
    if math.isnan(slope):
        return np.inf
    thickness = circle_thickness(slope, rho, convex, delta, rule, side)
    if start + thickness >= rho * (1.0 - 1e-9):
        thickness += delta  # the circle has ended; what comes after it, if anything, may differ by that much
    return max(waits, 0.0) + thickness
