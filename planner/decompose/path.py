"""Planes that turn with a piece's centroidal axis, from its base to its end, so that no layer is too uneven (paper Fig. 17)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.decompose.centroidal import Cut, cuts_at
from planner.decompose.course import Course, Fork, Lost, course
from planner.errors import RecipeError
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.slicing.stations import path_stations

Floats = NDArray[np.float64]

_RATIO_MARGIN = 0.92  # of the allowed ratio: planes lie denser than the layers that are taken from them
_MAX_LAG = np.radians(30.0)  # of the planes behind or before the axis: a wall that leans so much holds by itself
_STRAIGHT = np.radians(2.0)  # of all turning: below it a piece does not bend
_SMOOTHING = 3  # passes of a binomial filter over the turning
_FITTING = 4  # rounds of cutting with the planes and turning them as their sections allow
_BASE_ROUGH = 1e-4  # of the diagonal: what cutting may leave below the base plane; the first plane goes down as far
_PAST_MM = 1e-6  # what the last plane lies past the end, so that rounding leaves no vertex beyond it


@dataclass(frozen=True, eq=False)
class AxisPath:
    """Planes for the layers of a piece that bends.

    planes : (k, 6) float   point on the axis (mm) and unit normal, from the base plane to the end, denser than layers
    axis : (m, 3) float, mm   centroidal axis   stretch : (k - 1, 2) float   least and greatest distance of neighbouring
    planes over the piece, relative to that on the axis   notes : one line each
    """

    planes: Floats
    axis: Floats
    stretch: Floats
    notes: tuple[str, ...]

    @property
    def bend_rad(self) -> float:
        """Sum of all turning from the first plane to the last, rad."""
        return float(_angles(self.planes[:-1, 3:], self.planes[1:, 3:]).sum())


@dataclass(frozen=True, eq=False)
class PathBreak:
    """Why planes cannot follow a piece's axis to its end.

    place : (3,) float, mm   where to cut it   direction : (3,) float   of the axis there   reason : one line
    """

    place: Floats
    direction: Floats
    reason: str


def axis_path(
    mesh: Mesh, base: Floats, *, layer_min_mm: float, layer_max_mm: float, max_ratio: float
) -> AxisPath | PathBreak:
    """Planes that turn with the centroidal axis of a closed piece that stands on a base plane, or where to cut it.

    base : (6,) float   point (mm) and unit normal, into the piece; the first plane is this one
    layer_min_mm, layer_max_mm : bounds of a layer's thickness   max_ratio : of the greatest to the least thickness in a layer
    The normal follows the axis as fast as the sections' reach lets it: a layer of thickness t on the axis is t (c ± κ r) thick at
    the distance r, with κ the turning per mm and c the cosine of the lag behind the axis. Starting at the base it may lag
    (a leaning piece), later no more than 30°. Where the end is flat the last plane lies in it if the turning allows, else past it.
    """
    found = course(mesh, base)
    if found is None:
        return PathBreak(base[:3].copy(), base[3:].copy(), f"the piece does not stand on its base at {place_text(base[:3])}")
    if isinstance(found, Fork):
        return PathBreak(found.place, base[3:].copy(), f"the piece branches at {place_text(found.place)}")
    if isinstance(found, Lost):
        reason = f"the axis turns too fast at {place_text(found.place)}: no sections stand square on it there"
        return PathBreak(found.place, found.direction, reason)
    ratio = 1.0 + (min(max_ratio, layer_max_mm / layer_min_mm) - 1.0) * _RATIO_MARGIN
    normals, notes = _turned(mesh, base, found, ratio)
    lag = _angles(normals, found.directions)
    late = lag > max(_MAX_LAG, float(lag[0]) + np.radians(5.0))
    if late.any():
        return _too_fast(found, normals, int(np.flatnonzero(late)[0]))
    return _checked(mesh, base, found, normals, ratio, notes)


def _turned(mesh: Mesh, base: Floats, found: Course, ratio: float) -> tuple[Floats, list[str]]:
    """Normals (k, 3) of the planes and notes: they follow the axis within what the sections' reach allows."""
    points, wanted = found.points, found.directions.copy()
    wanted[0] = base[3:]
    step = float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean())
    normals, notes = wanted, []
    for _ in range(_FITTING):
        allowed = _allowed_turn(cuts_at(mesh, np.hstack([points, normals])), points, normals, found.directions, ratio)
        allowed = allowed[:-1] * step
        ahead = _limited(wanted, allowed, base[3:])
        end = found.end_face[3:] if found.end_face is not None else wanted[-1]
        behind = _limited(wanted[::-1], allowed[::-1], end)[::-1]
        middle = _limited(_unit(ahead + behind), allowed, base[3:])
        closing = _limited(middle[::-1], allowed[::-1], end)[::-1]
        meets = bool(_angles(closing[:1], base[None, 3:])[0] < 1e-9)
        normals = _smoothed(closing if meets else middle)
    if found.end_face is not None and not meets:
        notes.append("the last layers end in a flat face that leans against them: the piece turns too late for it")
    return normals, notes


def _allowed_turn(
    cuts: list[Cut | None], points: Floats, normals: Floats, directions: Floats, ratio: float
) -> Floats:
    """(k,) float, rad/mm   Fastest turning at each plane: thickest (c + κ r-) over thinnest (c - κ r+) layer is the ratio.

    r+ and r- are the section's reach from the axis towards and away from where the normal turns to, c the cosine of its lag.
    """
    turning = np.gradient(normals, axis=0)
    speed = np.linalg.norm(turning, axis=1)
    allowed = np.zeros(len(points))
    for k, cut in enumerate(cuts):
        if cut is None:
            allowed[k] = allowed[k - 1] if k else 0.0
            continue
        away = cut.outline - points[k]
        cosine = max(float(normals[k] @ directions[k]), 0.1)
        if speed[k] < 1e-6:
            inner = outer = float(np.linalg.norm(away, axis=1).max())
        else:
            reach = away @ (turning[k] / speed[k])
            inner, outer = max(float(reach.max()), 0.0), max(float(-reach.min()), 0.0)
        allowed[k] = cosine * (ratio - 1.0) / max(outer + ratio * inner, 1e-9)
    return np.minimum(allowed, np.minimum(np.roll(allowed, 1), np.roll(allowed, -1))) if len(cuts) > 2 else allowed


def _limited(wanted: Floats, allowed: Floats, first: Floats) -> Floats:
    """(k, 3) float   Unit vectors from the first on that turn towards those wanted by the angle allowed between rows at most."""
    made = np.empty_like(wanted)
    made[0] = first
    for k in range(1, len(wanted)):
        angle = float(_angles(made[k - 1 : k], wanted[k : k + 1])[0])
        share = 1.0 if angle <= allowed[k - 1] else float(allowed[k - 1]) / angle
        made[k] = _between(made[k - 1], wanted[k], angle, share)
    return made


def _between(first: Floats, second: Floats, angle: float, share: float) -> Floats:
    """Unit vector on the great circle from the first to the second, which are an angle (rad) apart."""
    if angle < 1e-9 or share >= 1.0:
        return second
    return np.asarray((np.sin((1.0 - share) * angle) * first + np.sin(share * angle) * second) / np.sin(angle))


def _smoothed(normals: Floats) -> Floats:
    """Normals whose turning changes gently: binomial filter, both ends held."""
    made = normals.copy()
    for _ in range(_SMOOTHING):
        made[1:-1] = _unit(0.25 * made[:-2] + 0.5 * made[1:-1] + 0.25 * made[2:])
    return made


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _angles(first: Floats, second: Floats) -> Floats:
    """(k,) float, rad   Between rows of unit vectors, exact for small angles too."""
    apart, together = np.linalg.norm(first - second, axis=1), np.linalg.norm(first + second, axis=1)
    return np.asarray(2.0 * np.arctan2(apart, together))


def _too_fast(found: Course, normals: Floats, late: int) -> PathBreak:
    """Where the axis turns faster than the planes may: begin of the bend in which they fall behind."""
    turn = _angles(found.directions[:-1], found.directions[1:])
    sharp = turn > 0.5 * turn[max(late - 3, 0) : late + 4].max(initial=0.0)
    first = late
    while first > 0 and sharp[min(first - 1, len(sharp) - 1)]:
        first -= 1
    place = found.points[first] if first > 1 else found.points[late]
    lag = np.degrees(_angles(normals[late : late + 1], found.directions[late : late + 1])[0])
    reason = f"the axis turns too fast at {place_text(place)}: layers within bounds would stand {lag:.0f}° off it"
    return PathBreak(place.copy(), found.directions[first].copy(), reason)


def _checked(
    mesh: Mesh, base: Floats, found: Course, normals: Floats, ratio: float, notes: list[str]
) -> AxisPath | PathBreak:
    """The path, its ends laid against the piece, or why its planes cross in the piece."""
    planes = np.hstack([found.points, normals])
    planes[0] = base
    planes = _ended(mesh, planes, found)
    below = float(((mesh.vertices - base[:3]) @ base[3:]).min())
    if -_BASE_ROUGH * mesh.diagonal < below < 0.0:
        planes[0, :3] += below * base[3:]
    stretch, worst = _stretch(mesh, planes)
    if worst is not None and (stretch[worst, 0] <= 0.0 or stretch[worst, 1] > 1.1 * ratio * stretch[worst, 0]):
        place = found.points[min(worst, len(found.points) - 1)]
        reason = f"layers would be too uneven at {place_text(place)}: planes there turn too near to the piece"
        return PathBreak(place.copy(), found.directions[min(worst, len(found.points) - 1)].copy(), reason)
    try:
        path_stations(mesh, planes)
    except RecipeError as error:
        return _crossed(found, planes, error.message)
    return AxisPath(planes, found.points, stretch, tuple(notes))


def _ended(mesh: Mesh, planes: Floats, found: Course) -> Floats:
    """Planes, the last one at the end of the piece: in its flat face where it is parallel to it, else just past the end."""
    normal = planes[-1, 3:]
    beyond = (mesh.vertices - planes[-1, :3]) @ normal
    near = np.linalg.norm(mesh.vertices - planes[-1, :3], axis=1) < 4.0 * found.radius_mm[-1]
    reach = max(float(beyond[near].max(initial=0.0)), 0.0) + _PAST_MM
    moved = planes.copy()
    moved[-1, :3] += normal * reach
    return moved


def _stretch(mesh: Mesh, planes: Floats) -> tuple[Floats, int | None]:
    """Least and greatest distance of neighbouring planes over the piece, per mm of axis (k - 1, 2), and the most uneven row."""
    cuts = cuts_at(mesh, planes[:-1])
    stretch = np.ones((len(planes) - 1, 2))
    for k in range(len(planes) - 1):
        low, high = planes[k], planes[k + 1]
        way = max(float((high[:3] - low[:3]) @ low[3:]), 1e-9)
        gaps = []
        for cut, other, sign in ((cuts[k], high, -1.0), (cuts[k + 1] if k + 2 < len(planes) else None, low, 1.0)):
            if cut is not None:
                gaps.append(sign * ((cut.outline - other[:3]) @ other[3:]))
        if gaps:
            every = np.concatenate(gaps) / way
            stretch[k] = every.min(), every.max()
    uneven = stretch[:, 1] / np.maximum(stretch[:, 0], 1e-6)
    return stretch, int(np.argmax(uneven)) if len(uneven) else None


def _crossed(found: Course, planes: Floats, message: str) -> PathBreak:
    """Half-way along the turning: the piece bends round so far that its planes meet it again."""
    turned = np.concatenate([[0.0], np.cumsum(_angles(planes[:-1, 3:], planes[1:, 3:]))])
    half = int(np.clip(np.searchsorted(turned, 0.5 * turned[-1]), 1, len(turned) - 2))
    place = found.points[half]
    return PathBreak(place.copy(), found.directions[half].copy(), f"{message}; cut at {place_text(place)}")
