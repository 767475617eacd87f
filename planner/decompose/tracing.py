"""From a chain of coarse fronts to the measured axis of one limb: square sections, carried on to its free ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.decompose.centroidal import Cut, cuts_at, lengths_along, marched, resampled, squared, tangents_of
from planner.decompose.course import end_face, run_out
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

_SPACING = 0.3  # of the radius, between sections
_MOST = 1.25  # of the fronts' area: a square section that is larger has run into another limb
_LEAST = 0.6  # of the fronts' area, which lean: a smaller section is a chip of the end, or one side of a hole
_CLEAR = 1.2  # radii from a free end, where fronts lean most: the axis there is marched
_CLEAR_SHARE = 0.35  # of the whole length, at most
_SECTIONS = 48  # of one limb at most


@dataclass(frozen=True, eq=False)
class Trace:
    """Axis of one limb.  points : (k, 3) float, mm   radii : (k,) float, mm, of the circle with the section's area"""

    points: Floats
    radii: Floats


def traced(mesh: Mesh, chain: Floats, area_mm2: Floats, opens: tuple[bool, bool]) -> Trace:
    """The measured axis along a chain of front centres (k, 3) with their areas (k,).

    opens : whether the first and the last end are free; the axis goes on there until it leaves the part
    """
    coarse = Trace(chain, np.sqrt(area_mm2 / np.pi))
    along = lengths_along(chain)
    radius = float(np.sqrt(np.median(area_mm2) / np.pi))
    if along[-1] <= 0.0:
        return coarse
    clear = min(_CLEAR * radius, _CLEAR_SHARE * float(along[-1]))
    low, high = (clear if opens[0] else 0.0), along[-1] - (clear if opens[1] else 0.0)
    count = int(np.clip(np.ceil((high - low) / (_SPACING * radius)), 5, _SECTIONS))
    step = float((high - low) / count)
    at = np.linspace(low + 0.5 * step, high - 0.5 * step, count)
    expected = np.interp(at, along, area_mm2)
    cuts, _ = squared(mesh, resampled(chain, at), radius, _MOST * expected)
    cuts = [cut if cut is not None and cut.area_mm2 > _LEAST * expected[k] else None for k, cut in enumerate(cuts)]
    rows = [k for k, cut in enumerate(cuts) if cut is not None]
    if len(rows) < 3:
        return _ended(mesh, coarse, opens, radius)
    return _ended(mesh, _filled(cuts, rows), opens, radius, step)


def _filled(cuts: list[Cut | None], rows: list[int]) -> Trace:
    """Centres and radii between the first and the last section that counts; those between go over straight."""
    found = [cut for cut in cuts if cut is not None]
    at = np.arange(rows[0], rows[-1] + 1)
    centres = np.array([cut.centre for cut in found])
    points = np.column_stack([np.interp(at, rows, centres[:, k]) for k in range(3)])
    return Trace(points, np.interp(at, rows, [cut.radius_mm for cut in found]))


def _ended(mesh: Mesh, trace: Trace, opens: tuple[bool, bool], radius_mm: float, step_mm: float | None = None) -> Trace:
    """The trace, marched on both ways while sections stay alike, and at its free ends straight until it leaves the part."""
    points, radii = trace.points, trace.radii
    for is_open in opens[::-1]:
        if step_mm is not None and len(points) >= 4:
            longer = marched(mesh, points, radius_mm, step_mm, lambda cut: False)
            points, radii = longer, np.concatenate([radii, np.full(len(longer) - len(points), radii[-1])])
        if is_open and len(points) >= 2:
            tail = tangents_of(points, radius_mm)[-1]
            cut = cuts_at(mesh, np.concatenate([points[-1], tail])[None, :])[0]
            face = end_face(mesh, points[-1], tail, radii[-1], cut.area_mm2 if cut else np.pi * radii[-1] ** 2)
            last = run_out(mesh, points[-1], tail, face)
            if np.linalg.norm(last - points[-1]) > 1e-6:
                points, radii = np.vstack([points, last]), np.append(radii, radii[-1])
        points, radii = points[::-1], radii[::-1]
    return Trace(points, radii)
