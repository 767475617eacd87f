"""Heights of the layers along a build direction or a way of planes: as thick as the cusp allows, flat faces hit exactly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.errors import PlanningError, RecipeError
from planner.mesh.crease import crease_edges
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.slicing.confirm import Confirmation, Confirmed, Wanted
from planner.slicing.critical import LEVEL_FRACTION, critical_heights, critical_stations
from planner.slicing.cusp import LayerRule, ToleranceSide, allowed_thickness
from planner.slicing.stations import Stations, path_stations, straight_stations

__all__ = [
    "allowed_thickness",
    "confirmed_layers",
    "critical_heights",
    "layer_cusps",
    "layer_heights",
    "layer_planes",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def layer_heights(
    mesh: Mesh,
    direction: ArrayLike,
    cusp_mm: float,
    min_mm: float,
    max_mm: float,
    *,
    rule: LayerRule = "facet",
    side: ToleranceSide = "both",
    crease_deg: float = 35.0,
) -> Floats:
    """Boundaries of the layers along a build direction b.

    direction : (3,) float, any length;  cusp_mm : allowed cusp δ;  min_mm, max_mm : bounds of a layer's thickness
    rule, side : as in `planner.slicing.cusp.allowed_thickness`;  crease_deg : edges that bend more are meant sharp
    Returns (k + 1,) float, mm, ascending heights b·p; the first and last are the part's extent along b.

    A facet with outward normal n allows d = δ/|n·b|, a layer the least of all facets in the slab that it spans
    (equation of the flat facet's cusp C = d|n·b|, paper Eq. 14), but not less than min_mm and not more than max_mm.
    Level faces are boundaries; of several within δ of each other the largest is. Where even thicknesses within the
    bounds cannot follow the rule between two level faces, the bounds win: `layer_cusps` tells the cusp that results.
    The rules "extruded" and "ruled" bend with the surface and are measured: see `confirmed_layers`.
    Raises RecipeError for a direction or bounds that are none; PlanningError, with the place, if the distance of two
    level faces cannot be divided into layers of min_mm to max_mm.
    """
    if rule != "facet":
        wanted = Wanted(cusp_mm, min_mm, max_mm, rule, side, crease_deg)
        return confirmed_layers(mesh, direction, wanted).stations
    axis = _checked(direction, cusp_mm, min_mm, max_mm)
    low, high, allowed = _facet_limits(mesh, axis, cusp_mm, min_mm, max_mm)
    order = np.argsort(low, kind="stable")
    low, high, allowed = low[order], high[order], allowed[order]
    breaks = _break_heights(mesh, axis, cusp_mm, min_mm)
    touch = LEVEL_FRACTION * float(breaks[-1] - breaks[0])
    heights = [breaks[:1]]
    for bottom, top in pairwise(breaks):
        inner = divide_span(low, high, allowed, float(bottom), float(top), min_mm, max_mm, touch)
        if not len(inner):
            _refuse_span(mesh, axis, float(bottom), float(top), min_mm, max_mm)
        heights.append(inner[1:])
    return np.concatenate(heights)


def confirmed_layers(mesh: Mesh, direction: ArrayLike, wanted: Wanted) -> Confirmed:
    """Boundaries along a direction whose extruded or ruled walls were measured, and what was measured.

    Estimated from the circles of curvature of all facets (paper Eqs. 15-18, 20), then measured and corrected until every
    wall lies within the cusp of the mesh and no layer is thinner than it needs to be, within the bounds. Boundaries are
    also where outlines begin, end, join or part and, for ruled walls, where a level edge is sharp, unless that is nearer
    than min_mm to a boundary already there. Raises as `layer_heights` does.
    """
    axis = _checked(direction, wanted.cusp_mm, wanted.min_mm, wanted.max_mm)
    allowed_thickness(0.0, 1.0, True, wanted.cusp_mm, wanted.rule, wanted.side)
    breaks = _break_heights(mesh, axis, wanted.cusp_mm, wanted.min_mm)
    for bottom, top in pairwise(breaks.tolist()):
        if not _is_divisible(
            top - bottom, wanted.min_mm, wanted.max_mm, LEVEL_FRACTION * float(breaks[-1] - breaks[0])
        ):
            _refuse_span(mesh, axis, bottom, top, wanted.min_mm, wanted.max_mm)
    stations = straight_stations(mesh, axis)
    breaks = _with_changes(mesh, stations, breaks, wanted, wanted.min_mm)
    touch = LEVEL_FRACTION * float(breaks[-1] - breaks[0])
    return Confirmation(mesh, stations, breaks, wanted, touch).run()


def layer_planes(
    mesh: Mesh,
    path: ArrayLike,
    cusp_mm: float,
    min_mm: float,
    max_mm: float,
    *,
    rule: LayerRule = "extruded",
    side: ToleranceSide = "both",
    crease_deg: float = 35.0,
) -> Floats:
    """Bounding planes of the layers along a way of planes that may turn: neighbouring planes need not be parallel.

    path : (p, 6) float   a point (mm) and a unit normal each, from below the part to above it; between two of them one
    goes over into the other (`planes_on`).   The rest as for `layer_heights`; thickness counts, facet by facet, along the normal of
    the plane through the facet, so that the layer is thickest where the planes are farthest apart.
    Returns (k + 1, 6) float: the planes of the path between which the layers lie; the first and last touch the part.
    Raises RecipeError if the path misses the part or its planes cross in it; else as `layer_heights`.
    """
    _checked((0.0, 0.0, 1.0), cusp_mm, min_mm, max_mm)
    allowed_thickness(0.0, 1.0, True, cusp_mm, rule, side)
    stations = path_stations(mesh, path)
    wanted = Wanted(cusp_mm, min_mm, max_mm, rule, side, crease_deg)
    ends = np.array([stations.low.min(), stations.high.max()])
    breaks = _with_changes(mesh, stations, ends, wanted, min_mm / float(stations.rate.min()))
    touch = LEVEL_FRACTION * float(ends[1] - ends[0])
    return stations.planes(Confirmation(mesh, stations, breaks, wanted, touch).run().stations)


def _with_changes(mesh: Mesh, stations: Stations, breaks: Floats, wanted: Wanted, least: float) -> Floats:
    """Breaks, and between them the stations where the outline changes its kind, none nearer than least to another."""
    found = [critical_stations(mesh, stations.vertex)]
    if wanted.rule == "ruled":
        ends = stations.vertex[mesh.facets]
        following = np.roll(ends, -1, axis=1)
        level = np.abs(following - ends) <= LEVEL_FRACTION * float(breaks[-1] - breaks[0])
        found.append(ends[level & crease_edges(mesh, wanted.crease_deg)])
    kept = breaks.tolist()
    for station in np.unique(np.concatenate(found)).tolist():
        if min(abs(station - other) for other in kept) >= least:
            kept.append(station)
    return np.sort(np.array(kept))


def _is_divisible(span: float, min_mm: float, max_mm: float, touch: float) -> bool:
    """Whether some number of layers of min_mm to max_mm makes up the span."""
    count = max(int(np.floor((span + touch) / min_mm)), 1)
    return bool(min_mm - touch <= span / count <= max_mm + touch)


def layer_cusps(mesh: Mesh, direction: ArrayLike, heights: ArrayLike) -> Floats:
    """Largest cusp d|n·b| of the facets in each layer, mm; level faces have none.

    heights : (k + 1,) float, mm, as from `layer_heights`.  Returns (k,) float.  Raises RecipeError for a bad direction.
    """
    axis = _checked(direction, 1.0, 1.0, 1.0)
    levels = np.asarray(heights, dtype=np.float64)
    touch = LEVEL_FRACTION * float(levels[-1] - levels[0])
    along = mesh.vertices @ axis
    low, high = along[mesh.facets].min(axis=1), along[mesh.facets].max(axis=1)
    slope = np.where(high - low <= touch, 0.0, np.abs(mesh.normals @ axis))
    order = np.argsort(low, kind="stable")
    steepest = slab_minimum(low[order], high[order], -slope[order], levels, touch)
    return np.asarray(np.maximum(-steepest, 0.0) * np.diff(levels))


def _checked(direction: ArrayLike, cusp_mm: float, min_mm: float, max_mm: float) -> Floats:
    """The unit build direction.  Raises RecipeError if it or the numbers make no sense."""
    axis = np.asarray(direction, dtype=np.float64)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not np.linalg.norm(axis) > 0.0:
        raise RecipeError(f"the build direction {direction!r} is no direction", "give three numbers, not all zero")
    if not (cusp_mm > 0.0 and 0.0 < min_mm <= max_mm and np.isfinite([cusp_mm, max_mm]).all()):
        raise RecipeError(
            f"layers need a cusp above 0 and 0 < least <= greatest thickness, not {cusp_mm}, {min_mm}, {max_mm} mm",
            "correct the recipe or the material",
        )
    return np.asarray(axis / np.linalg.norm(axis))


def _facet_limits(
    mesh: Mesh, axis: Floats, cusp_mm: float, min_mm: float, max_mm: float
) -> tuple[Floats, Floats, Floats]:
    """Lowest and highest point of each facet along the axis and the thickness that it allows, mm, (m,) each."""
    along = mesh.vertices @ axis
    corners = along[mesh.facets]
    low, high = corners.min(axis=1), corners.max(axis=1)
    slope = np.abs(mesh.normals @ axis)
    rule = np.divide(cusp_mm, slope, out=np.full(len(slope), np.inf), where=slope > 0.0)
    level = high - low <= LEVEL_FRACTION * (along.max() - along.min())
    return low, high, np.where(level, max_mm, np.clip(rule, min_mm, max_mm))


def _break_heights(mesh: Mesh, axis: Floats, cusp_mm: float, min_mm: float) -> Floats:
    """Ascending heights of the part's ends and of the level faces between them, mm.

    Faces nearer to each other than the least layer and the cusp count as one, at the height of the largest of them.
    """
    along = mesh.vertices @ axis
    used = along[mesh.facets]
    bottom, top = float(used.min()), float(used.max())
    rise = used.max(axis=1) - used.min(axis=1)
    level = (rise <= LEVEL_FRACTION * (top - bottom)) & (mesh.areas > 0.0)
    together = max(min(cusp_mm, min_mm), LEVEL_FRACTION * (top - bottom))
    heights, group = np.unique(used.mean(axis=1)[level], return_inverse=True)
    area = np.bincount(group.reshape(-1), weights=mesh.areas[level], minlength=len(heights))
    inner = (heights > bottom + together) & (heights < top - together)
    heights, area = heights[inner], area[inner]
    breaks, i = [bottom], 0
    while i < len(heights):
        j = int(np.searchsorted(heights, heights[i] + together, side="right"))
        breaks.append(float(heights[i + int(np.argmax(area[i:j]))]))
        i = j
    return np.array([*breaks, top])


def divide_span(
    low: Floats, high: Floats, allowed: Floats, bottom: float, top: float, min_mm: float, max_mm: float, touch: float
) -> Floats:
    """Boundaries from bottom to top, both included, or none if the bounds cannot hold.

    low, high, allowed : (m,) float, mm, facets sorted by low;  touch : overlap (mm) that does not count
    First the thickest layers from below, drawn together evenly if that keeps every limit; else the topmost layers
    are thinned to min_mm as far as needed (a layer may always be min_mm thick); else equal layers within the bounds.
    """
    span = top - bottom
    slack = 1e-9 * max_mm  # rounding of sums of heights
    greedy = thickest_layers(low, high, allowed, bottom, top, max_mm, touch)
    even = bottom + (greedy - bottom) * (span / (greedy[-1] - bottom))
    even[-1] = top
    limits = np.minimum(slab_minimum(low, high, allowed, even, touch), max_mm)
    thickness = np.diff(even)
    if (thickness <= limits + slack).all() and (thickness >= min_mm - slack).all():
        return np.asarray(even)
    pushed = greedy.copy()
    pushed[-1] = top
    for i in range(len(pushed) - 2, 0, -1):
        pushed[i] = min(pushed[i], pushed[i + 1] - min_mm)
    if pushed[1] - pushed[0] >= min_mm - slack:
        return np.asarray(pushed)
    count = max(int(np.floor((span + slack) / min_mm)), 1)
    each = span / count
    if min_mm - touch <= each <= max_mm + touch:
        return np.linspace(bottom, top, count + 1)
    return np.empty(0)


@njit(cache=True)
def thickest_layers(
    low: Floats, high: Floats, allowed: Floats, bottom: float, top: float, max_mm: float, touch: float
) -> Floats:
    """Boundaries of the thickest layers from bottom upwards; the last one reaches top or lies above it.

    A facet bounds the layer from z by max(allowed, low - z): either the layer keeps to it or ends below it.
    low, high, allowed : (m,) float, mm, facets sorted by low
    """
    heights = [bottom]
    active = np.empty(low.shape[0], np.int64)
    count = 0
    following = 0
    z = bottom
    while z < top - 1e-9 * max_mm:
        kept = 0
        for i in range(count):
            if high[active[i]] > z + touch:
                active[kept] = active[i]
                kept += 1
        count = kept
        while following < low.shape[0] and low[following] < z + max_mm - touch:
            if high[following] > z + touch:
                active[count] = following
                count += 1
            following += 1
        thickness = max_mm
        for i in range(count):
            limit = max(allowed[active[i]], low[active[i]] + touch - z)
            thickness = min(thickness, limit)
        z += thickness
        heights.append(z)
    return np.array(heights)


@njit(cache=True)
def slab_minimum(low: Floats, high: Floats, value: Floats, heights: Floats, touch: float) -> Floats:
    """Least value of the facets in each slab, inf where there are none.

    low, high, value : (m,) float, facets sorted by low;  heights : (k + 1,) float, mm, ascending.  Returns (k,) float.
    """
    least = np.full(heights.shape[0] - 1, np.inf)
    for f in range(low.shape[0]):
        k = max(np.searchsorted(heights, low[f], side="right") - 1, 0)
        while k < least.shape[0] and heights[k] < high[f] - touch:
            if low[f] < heights[k + 1] - touch:
                least[k] = min(least[k], value[f])
            k += 1
    return least


def _refuse_span(mesh: Mesh, axis: Floats, bottom: float, top: float, min_mm: float, max_mm: float) -> None:
    """Raise PlanningError: from bottom to top (mm along the axis) no division fits."""
    middle = mesh.centroids @ axis
    place = mesh.centroids[int(np.argmin(np.abs(middle - top)))]
    raise PlanningError(
        f"{top - bottom:.4g} mm between the level faces at {bottom:.4g} and {top:.4g} mm along the build direction, "
        f"near {place_text(place)}, cannot be divided into layers of {min_mm:g} to {max_mm:g} mm",
        "choose another build direction, wider layer bounds or a larger cusp",
    )
