"""Where the planes of layers lie that turn with a piece: as thick as bounds and cusp allow on every side of it at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.errors import PlanningError, RecipeError
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.recipe import Recipe
from planner.slicing.confirm import Confirmation, Wanted
from planner.slicing.contours import ContourStyle
from planner.slicing.critical import LEVEL_FRACTION
from planner.slicing.section import Section, checked_planes
from planner.slicing.slicer import slice_mesh
from planner.slicing.stations import Stations, path_stations, planes_on
from planner.slicing.thickness import divide_span

Floats = NDArray[np.float64]

_BEYOND_MM = 0.02  # by which the way of planes is carried on at both ends, so that faces in its end planes lie within
_PROBE_MM = 0.5  # between the sections at which the planes' distances are taken
_LEAST_FACE_MM2 = 0.05  # smaller level faces are specks of the mesh
_ON_MM = 1e-3  # a boundary this near to an end plane of the way is that plane
_CUT = "cut the piece there, or set axis_layers = never"


class NoRoomError(PlanningError):
    """Layers of the rule's thickness do not fit between two planes that must be; even ones may."""


@dataclass(frozen=True)
class Way:
    """A way of planes through a piece, with how far neighbouring planes are apart.

    path : (p, 6) float   planes, the way's own and one beyond each end   own : its own
    at : (m,) float   stations from the piece's first to its last point
    least, centre, most : (m,) float, mm per unit of station   rate at which the plane moves along its normal at each:
    the least and the greatest over the section, and at its centroid
    nearest : (m, 3) float, mm   the section's point where the planes lie closest
    """

    path: Floats
    own: Floats
    at: Floats
    least: Floats
    centre: Floats
    most: Floats
    nearest: Floats

    def reached(self, rate: Floats) -> Floats:
        """(m,) float   Integral of a rate over stations, from the first on."""
        return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(self.at))])

    def planes(self, stations: Floats) -> Floats:
        """(k, 6) float   Planes at stations (k,); the way's own end planes where they are meant."""
        planes = planes_on(self.path, stations)
        for k, row in ((0, self.own[0]), (-1, self.own[-1])):
            if abs((planes[k, :3] - row[:3]) @ row[3:]) <= _ON_MM and planes[k, 3:] @ row[3:] > 1.0 - 1e-9:
                planes[k] = row
        return planes


@dataclass(frozen=True)
class TurnedPlanes:
    """Bounding planes of layers, (k + 1, 6), those half-way between them, (k, 6), and one line for each thing found."""

    bounding: Floats
    middle: Floats
    findings: tuple[str, ...]


def turned_planes(
    mesh: Mesh, path: Floats, settings: Settings, recipe: Recipe, within: float = 1.0, *, is_even: bool = False
) -> TurnedPlanes:
    """The planes between which layers lie along a way of planes.

    mesh : closed piece   path : (p, 6) float, mm, unit normals, from its base plane to its end or past it
    within : share of the greatest thickness that is used   is_even : as thick as the bounds allow, whatever the cusp.
    The thickness lies within the material's bounds on every side of the piece, its ratio within one layer below
    max_layer_ratio. A fixed layer height holds at the section's centroid, at most.
    Raises PlanningError, one line with the place, where that cannot be: the piece should have been cut there.
    """
    way, along = _way_through(mesh, checked_planes(path))
    _refuse_turn(way, settings)
    greatest = within * settings.material.deposition.layer_height_mm.max
    if recipe.layer_height_mm is not None:
        rate = np.maximum(way.centre / recipe.layer_height_mm, way.most / greatest)
        stations, findings = _even(mesh, way, along, rate)
    elif is_even:
        stations, findings = _even(mesh, way, along, way.most / greatest)
    else:
        stations, findings = _by_cusp(mesh, way, along, settings, greatest)
    middle = planes_on(way.path, 0.5 * (stations[1:] + stations[:-1]))
    return TurnedPlanes(way.planes(stations), middle, tuple(findings))


def _way_through(mesh: Mesh, rows: Floats) -> tuple[Way, Stations]:
    """The way with the distances of its planes, and the piece along it.  Raises PlanningError if planes cross in it."""
    first, last = rows[:1].copy(), rows[-1:].copy()
    first[:, :3] -= _BEYOND_MM * first[:, 3:]
    last[:, :3] += _BEYOND_MM * last[:, 3:]
    path = np.vstack([first, rows, last])
    try:
        along = path_stations(mesh, path)
    except RecipeError as error:
        raise PlanningError(f"layers that turn: {error.message}", _CUT) from None
    steps = np.maximum(np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1), 1e-9)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    ends = np.interp([along.low.min(), along.high.max()], np.arange(len(path)), reached)
    count = max(4, int(np.ceil((ends[1] - ends[0]) / _PROBE_MM)))
    at = np.asarray(np.interp(np.linspace(ends[0], ends[1], count + 1), reached, np.arange(len(path))))
    at[0], at[-1] = along.low.min(), along.high.max()
    return _measured(mesh, path, rows, at), along


def _measured(mesh: Mesh, path: Floats, own: Floats, at: Floats) -> Way:
    """The way with the distances of its planes over the piece's sections at stations."""
    probes = at.copy()
    probes[0], probes[-1] = at[0] + 0.01 * (at[1] - at[0]), at[-1] - 0.01 * (at[-1] - at[-2])
    planes, step = planes_on(path, probes), 1e-4
    before, after = planes_on(path, probes - step), planes_on(path, probes + step)
    rows = np.empty((len(at), 3))
    nearest = np.empty((len(at), 3))
    for k, section in enumerate(slice_mesh(mesh, planes)):
        points = np.vstack([_centroid(section), *(loop.points for loop in section.loops)])
        arm = points - 0.5 * (after[k, :3] + before[k, :3])
        moved, turned = (after[k, :3] - before[k, :3]) @ planes[k, 3:], after[k, 3:] - before[k, 3:]
        rate = (moved - arm @ turned) / (2.0 * step)
        rows[k] = rate.min(), rate[0], rate.max()
        nearest[k] = points[int(np.argmin(rate))]
    return Way(path, own, at, rows[:, 0], rows[:, 1], rows[:, 2], nearest)


def _centroid(section: Section) -> Floats:
    """(1, 3) float, mm   Centre of a section's material; the plane's point where there is none."""
    point = section.to_shapely().centroid
    return section.lift([[point.x, point.y]]) if section.loops else section.origin[None]


def _refuse_turn(way: Way, settings: Settings) -> None:
    """Raise PlanningError where planes lie so much closer on one side that no layer keeps the bounds and the ratio."""
    facts = settings.material.deposition
    allowed = min(facts.max_layer_ratio, facts.layer_height_mm.max / facts.layer_height_mm.min)
    ratio = np.where(way.least > 0.0, way.most / np.where(way.least > 0.0, way.least, 1.0), np.inf)
    worst = int(np.argmax(ratio))
    if ratio[worst] <= allowed:
        return
    how = "whose planes cross" if np.isinf(ratio[worst]) else f"{ratio[worst]:.2f} times as thick opposite"
    raise PlanningError(
        f"the piece bends too fast at {place_text(way.nearest[worst])} for layers that turn with it: {how}, "
        f"{settings.material.name} allows {allowed:.3g} times",
        _CUT,
    )


def _breaks(mesh: Mesh, along: Stations, least: float, reached: Callable[[Floats], Floats]) -> tuple[Floats, list[str]]:
    """Stations of the piece's ends and of level faces between them, and those that get no boundary of their own.

    least : mm, between boundaries   reached : stations to mm.
    """
    low, high = float(along.low.min()), float(along.high.max())
    touch = LEVEL_FRACTION * (high - low)
    level = (along.high - along.low <= touch) & (mesh.areas > 0.0)
    places, group = np.unique(np.round(along.middle[level] / touch), return_inverse=True)
    area = np.bincount(group.reshape(-1), weights=mesh.areas[level], minlength=len(places))
    kept, findings = [low], []
    for place in (places[area >= _LEAST_FACE_MM2] * touch).tolist():
        gaps = np.abs(np.diff(reached(np.array([kept[-1], place, high]))))
        if min(place - kept[-1], high - place) <= 2.0 * touch:
            continue
        if gaps.min() < least:
            findings.append(f"a flat face {gaps.min():.2f} mm from another boundary gets no layer boundary of its own")
        else:
            kept.append(place)
    return np.array([*kept, high]), findings


def _even(mesh: Mesh, way: Way, along: Stations, rate: Floats) -> tuple[Floats, list[str]]:
    """Stations of even layers between level faces.  rate : (m,) float, layers per unit of station."""
    layers = way.reached(rate)
    breaks, findings = _breaks(mesh, along, 0.5, lambda at: np.interp(at, way.at, layers))
    stations = [breaks[:1]]
    for span in pairwise(np.interp(breaks, way.at, layers).tolist()):
        count = max(1, int(np.ceil(span[1] - span[0] - 1e-6)))
        stations.append(np.interp(np.linspace(*span, count + 1)[1:], layers, way.at))
    return np.concatenate(stations), findings


def _by_cusp(mesh: Mesh, way: Way, along: Stations, settings: Settings, greatest: float) -> tuple[Floats, list[str]]:
    """Stations of layers as thick as the recipe's rule allows; thickness counts where the planes lie farthest apart."""
    recipe = settings.recipe
    reached = way.reached(way.most)
    thin = settings.layer_min_mm * float((way.most / way.least).max())
    least = min(thin, greatest)
    outside = _in_mm(way, along, reached)
    breaks, findings = _breaks(mesh, outside, least, lambda at: at)
    touch = LEVEL_FRACTION * float(reached[-1])
    if recipe.layer_rule == "facet":
        marks = _facet_marks(mesh, outside, recipe.cusp_mm, (least, greatest), breaks, touch)
    else:
        wanted = Wanted(
            recipe.cusp_mm, least, greatest, recipe.layer_rule, recipe.tolerance_side, recipe.crease_deg,
            ContourStyle.from_recipe(recipe),
        )  # fmt: skip
        marks = Confirmation(mesh, outside, breaks, wanted, touch).run().stations
    return np.interp(marks, reached, way.at), findings


def _in_mm(way: Way, along: Stations, reached: Floats) -> Stations:
    """The piece along the way with stations in mm on the side where the planes lie farthest apart.  reached : (m,) mm."""

    def marks(stations: Floats) -> Floats:
        return np.asarray(np.interp(stations, way.at, reached))

    per_station = np.interp(along.middle, way.at, way.most)
    return Stations(
        marks(along.vertex), marks(along.low), marks(along.high), marks(along.middle), along.direction,
        along.rate / per_station, lambda at: planes_on(way.path, np.interp(at, reached, way.at)),
    )  # fmt: skip


def _facet_marks(
    mesh: Mesh, along: Stations, cusp_mm: float, bounds: tuple[float, float], breaks: Floats, touch: float
) -> Floats:
    """Boundaries, mm, as thick as flat facets allow (paper Eq. 14: d = cusp / |n·b|).  bounds : mm, least and greatest.

    Raises NoRoomError where level faces leave no room for layers within the bounds.
    """
    slope = np.abs(np.einsum("ij,ij->i", mesh.normals, along.direction))
    here = np.divide(cusp_mm, slope, out=np.full(len(slope), np.inf), where=slope > 0.0)
    allowed = np.clip(here / np.maximum(along.rate, 1e-6), *bounds)
    allowed[along.high - along.low <= touch] = bounds[1]
    order = np.argsort(along.low, kind="stable")
    low, high, allowed = (np.ascontiguousarray(values[order]) for values in (along.low, along.high, allowed))
    marks = [breaks[:1]]
    for bottom, top in pairwise(breaks.tolist()):
        inner = divide_span(low, high, allowed, bottom, top, *bounds, touch)
        if not len(inner):
            place = along.planes(np.array([0.5 * (bottom + top)]))[0, :3]
            raise NoRoomError(
                f"{top - bottom:.3g} mm of the piece near {place_text(place)} cannot be divided into layers that turn and are "
                f"{bounds[0]:.3g} to {bounds[1]:.3g} mm thick on the outside of the bend",
                _CUT,
            )
        marks.append(inner[1:])
    return np.concatenate(marks)
