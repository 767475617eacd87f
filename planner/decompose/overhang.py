"""What hangs along a direction, and whether a layer's overhang holds: the material's limits on what paper Eq. 1 gives."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from config.material import Deposition
from planner.mesh.mesh import Mesh
from planner.slicing.resting import Overhang, overhang

Floats = NDArray[np.float64]

__all__ = ["LEVEL_DEG", "Holds", "Overhang", "hanging_area", "overhang", "tilted_limit_deg", "verdict"]

LEVEL_DEG = 85.0
"""From the build direction: walls that lean more are undersides. They continue no wall of the layer below, so no tilt
of the head carries them on it."""
_ON_BASE_MM = 0.05  # facets within this of the base plane lie on it
_SLACK_MM = 0.02  # of a step between layers: sections are fitted curves, good to a fifth of the usual tolerance


class Holds(StrEnum):
    """How a layer stays up while it is deposited."""

    UPRIGHT = "upright"
    TILTED = "tilted"
    NOT = "not"


def tilted_limit_deg(facts: Deposition) -> float:
    """Lean of a wall from the layer's direction that holds with the head tilted along it: the material's, below level."""
    return float(min(facts.max_overhang_deg + facts.max_tilt_deg, LEVEL_DEG))


def verdict(layer: Overhang, height_mm: float, facts: Deposition) -> Holds:
    """Whether a layer's overhang holds: by itself, with the head along the side surface, or not.

    height_mm : of the layer. A wall leans by the arc tangent of the overhang's reach and the height; an underside
    may reach `max_unsupported_mm` beyond what carries it; what touches nothing does not hold.
    """
    if not layer.afloat.is_empty or layer.level_reach_mm > facts.max_unsupported_mm:
        return Holds.NOT
    if layer.reach_mm <= height_mm * np.tan(np.radians(facts.max_overhang_deg)) + _SLACK_MM:
        return Holds.UPRIGHT
    held = height_mm * np.tan(np.radians(tilted_limit_deg(facts))) + _SLACK_MM
    return Holds.TILTED if layer.reach_mm <= held else Holds.NOT


def hanging_area(
    mesh: Mesh, directions: ArrayLike, base_planes: ArrayLike | None = None, limit_deg: ArrayLike = 45.0
) -> Floats:
    """(k,) float, mm²   How much of a part looks down more than it holds, seen along each of k build directions.

    directions : (k, 3) float, unit   base_planes : (k, 6) float, a point (mm) and a normal each, on which it stands and
    below which nothing counts; None: the plane through its lowest point
    limit_deg : lean of a wall from the build direction that holds, one for all or (k,).
    Areas are projected along the direction. Nothing but facets is looked at: a point that begins in the air counts by the
    facets around it, so needles hang by less than they are.
    """
    along = np.atleast_2d(np.asarray(directions, dtype=np.float64))
    heights = mesh.vertices @ along.T
    if base_planes is None:
        used = np.unique(mesh.facets)
        floor = heights[used].min(axis=0)
    else:
        planes = np.atleast_2d(np.asarray(base_planes, dtype=np.float64))
        floor = np.einsum("ij,ij->i", planes[:, :3], along)
    looking = mesh.area_vectors @ along.T
    steep = -np.sin(np.radians(np.minimum(np.asarray(limit_deg, dtype=np.float64), LEVEL_DEG))) - 1e-9
    hangs = looking < steep * mesh.areas[:, None]
    rows, columns = np.nonzero(hangs)
    top = heights[mesh.facets[rows], columns[:, None]].max(axis=1)
    counted = top > floor[columns] + _ON_BASE_MM
    weights = -looking[rows, columns][counted]
    return np.bincount(columns[counted], weights=weights, minlength=len(along)).astype(np.float64)
