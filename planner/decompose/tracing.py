"""From a chain of coarse fronts to the measured axis of one limb: square sections, carried on to its free ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from planner.decompose.centroidal import Cut, cuts_at, lengths_along, marched, resampled, squared, tangents_of
from planner.decompose.course import end_face, run_out
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

_SPACING = 0.3  # of the radius, between sections
_MOST = 1.25  # of the fronts' area: a square section that is larger has run into another limb
_LEAST = 0.6  # of the fronts' area, which lean: a smaller section is a chip of the end, or one side of a hole
_ASTRAY = 0.5  # of the radius: a centroid farther from all fronts' centres is that of something else
_ALIKE = 1.1  # the same for level fronts, which do not lean
_FLARE = 1.25  # of the radius farther on: a wider section at a root belongs to what the limb sticks out of
_KINK_COS = float(np.cos(np.radians(25.0)))  # an axis that turns more between two sections at a root is not yet the limb's
_CLEAR = 1.2  # radii from a free end, where fronts lean most: the axis there is marched
_CLEAR_SHARE = 0.35  # of the whole length, at most
_SECTIONS = 48  # of one limb at most


_LEVELS = 16  # sections of a block

End = Literal["free", "root", "joined", "branching"]
"""What an axis meets at its end: nothing, the thing that its limb sticks out of, another axis that goes on, or several."""


@dataclass(frozen=True, eq=False)
class Trace:
    """Axis of one limb.  points : (k, 3) float, mm   radii : (k,) float, mm, of the circle with the section's area"""

    points: Floats
    radii: Floats


def traced(mesh: Mesh, chain: Floats, area_mm2: Floats, ends: tuple[End, End]) -> Trace:
    """The measured axis along a chain of front centres (k, 3) with their areas (k,).

    ends : of its first and last point, as `End`: from a free end the axis goes on until it leaves the part, at a root while its
    sections stay alike, where it is joined it stays
    """
    coarse = Trace(chain, np.sqrt(area_mm2 / np.pi))
    along = lengths_along(chain)
    radius = float(np.sqrt(np.median(area_mm2) / np.pi))
    if along[-1] <= 0.0:
        return coarse
    clear = min(_CLEAR * radius, _CLEAR_SHARE * float(along[-1]))
    kept = {"free": clear, "branching": 0.5 * clear}
    low, high = kept.get(ends[0], 0.0), along[-1] - kept.get(ends[1], 0.0)
    count = int(np.clip(np.ceil((high - low) / (_SPACING * radius)), 5, _SECTIONS))
    step = float((high - low) / count)
    at = np.linspace(low + 0.5 * step, high - 0.5 * step, count)
    expected = np.interp(at, along, area_mm2)
    cuts, _ = squared(mesh, resampled(chain, at), radius, _MOST * expected)
    cuts = [cut if cut is not None and _belongs(cut, chain, float(expected[k])) else None for k, cut in enumerate(cuts)]
    rows = [k for k, cut in enumerate(cuts) if cut is not None]
    if len(rows) < 3:
        return _ended(mesh, coarse, ends, radius)
    found = _filled(cuts, rows)
    if ends[0] == "root":
        found = _without_flare(found)
    for _ in range(2):
        found, ends, rows = _turned(found), (ends[1], ends[0]), [count - 1 - row for row in rows[::-1]]
        if ends[1] == "joined":
            found = _lengthened(found, step, count - 1 - rows[-1], radius)
    return _ended(mesh, found, ends, radius, step)


def _belongs(cut: Cut, chain: Floats, expected_mm2: float) -> bool:
    """Whether a section is about as large as the fronts there and its centroid lies near theirs."""
    apart = float(np.linalg.norm(chain - cut.centre, axis=1).min())
    return cut.area_mm2 > _LEAST * expected_mm2 and apart < _ASTRAY * np.sqrt(expected_mm2 / np.pi)


def _filled(cuts: list[Cut | None], rows: list[int]) -> Trace:
    """Centres and radii between the first and the last section that counts; those between go over straight."""
    found = [cut for cut in cuts if cut is not None]
    at = np.arange(rows[0], rows[-1] + 1)
    centres = np.array([cut.centre for cut in found])
    points = np.column_stack([np.interp(at, rows, centres[:, k]) for k in range(3)])
    return Trace(points, np.interp(at, rows, [cut.radius_mm for cut in found]))


def _without_flare(trace: Trace) -> Trace:
    """The trace from where it is as thin and as straight as farther on."""
    ways = np.diff(trace.points, axis=0)
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
    first = 0
    for k in range(len(ways) - 4):
        wide = trace.radii[k] > _FLARE * float(np.median(trace.radii[k + 1 : k + 7]))
        if wide or float(ways[k] @ ways[k + 1]) < _KINK_COS:
            first = k + 1
    first = min(first, len(trace.points) // 2)
    return Trace(trace.points[first:], trace.radii[first:])


def _turned(trace: Trace) -> Trace:
    """The same from its last point to its first."""
    return Trace(trace.points[::-1], trace.radii[::-1])


def _lengthened(trace: Trace, step_mm: float, count: int, radius_mm: float) -> Trace:
    """The trace carried on straight by so many steps and a half, to where another axis goes on."""
    tail = tangents_of(trace.points, radius_mm)[-1]
    more = trace.points[-1] + (np.arange(count + 1) + 0.5)[:, None] * step_mm * tail
    return Trace(np.vstack([trace.points, more]), np.append(trace.radii, np.full(count + 1, trace.radii[-1])))


def _ended(mesh: Mesh, trace: Trace, ends: tuple[End, End], radius_mm: float, step_mm: float | None = None) -> Trace:
    """The trace, marched on both ways while sections stay alike, and at its free ends straight until it leaves the part."""
    points, radii = trace.points, trace.radii
    for end in ends[::-1]:
        if end in ("free", "root") and step_mm is not None and len(points) >= 4:
            points, areas = marched(mesh, points, radius_mm, step_mm, lambda cut: False)
            radii = np.concatenate([radii, np.sqrt(areas / np.pi)])
        if end == "free" and len(points) >= 2:
            tail = tangents_of(points, radius_mm)[-1]
            cut = cuts_at(mesh, np.concatenate([points[-1], tail])[None, :])[0]
            face = end_face(mesh, points[-1], tail, cut) if cut else None
            last = run_out(mesh, points[-1], tail, face, cut.outer_mm if cut else 1.5 * float(radii[-1]))
            if np.linalg.norm(last - points[-1]) > 1e-6:
                points, radii = np.vstack([points, last]), np.append(radii, _radius_on(points, radii, last))
        points, radii = points[::-1], radii[::-1]
    return Trace(points, radii)


def _radius_on(points: Floats, radii: Floats, last: Floats) -> float:
    """Radius at a point past the last one, by the slope of the last few."""
    few = min(4, len(points))
    run = float(np.linalg.norm(points[-1] - points[-few]))
    slope = (radii[-1] - radii[-few]) / run if run > 0.0 else 0.0
    return float(np.clip(radii[-1] + slope * np.linalg.norm(last - points[-1]), 0.5 * radii[-1], 1.5 * radii[-1]))


def traced_level(mesh: Mesh, chain: Floats, area_mm2: Floats, axis: Floats, opens: tuple[bool, bool]) -> Trace:
    """The axis of a block along a unit direction: centroids of sections square on it, the fronts' own where limbs join."""
    rows = np.unique(np.linspace(0, len(chain) - 1, _LEVELS).round().astype(np.int64))
    points, radii = chain[rows].copy(), np.sqrt(area_mm2[rows] / np.pi)
    for k, cut in enumerate(cuts_at(mesh, np.hstack([points, np.broadcast_to(axis, points.shape)]))):
        if cut is not None and 1.0 / _ALIKE < cut.area_mm2 / area_mm2[rows[k]] < _ALIKE:
            points[k], radii[k] = cut.centre, cut.radius_mm
    reach = 2.0 * float(np.abs(np.diff(chain @ axis)).max(initial=0.0))
    for is_open, way in ((opens[1], axis), (opens[0], -axis)):
        if is_open:
            cut = cuts_at(mesh, np.concatenate([points[-1], way])[None, :])[0]
            face = end_face(mesh, points[-1], way, cut) if cut else None
            last = run_out(mesh, points[-1], way, face, cut.outer_mm if cut else 1.5 * float(radii[-1]))
            last = points[-1] + way * min(float((last - points[-1]) @ way), reach)
            points, radii = np.vstack([points, last]), np.append(radii, radii[-1])
        points, radii = points[::-1], radii[::-1]
    return Trace(points, radii)
