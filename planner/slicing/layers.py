"""The levels between which layers lie: cusp rule and process window, with flat faces kept exactly."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.errors import PlanningError
from planner.mesh.mesh import Mesh
from planner.slicing.confirm import Confirmed, Wanted
from planner.slicing.contours import ContourStyle
from planner.slicing.cusp import LayerRule, ToleranceSide
from planner.slicing.thickness import confirmed_layers, layer_heights

Floats = NDArray[np.float64]

_FLAT = math.cos(math.radians(0.5))  # facets this near to horizontal make a level
_LEAST_FACE_MM2 = 0.05  # smaller faces are specks of the mesh, not faces of the part
_SAME_MM = 1e-3  # faces nearer than this are one, but for the mesh's rounding
_ROUNDING = 1e-3  # of a layer: a part that much higher than a whole number of layers gets no layer more
MAX_LAYERS = 20_000


def flat_levels(mesh: Mesh) -> Floats:
    """Heights of the horizontal faces, lowest and highest point included, increasing: (k,) float, mm."""
    is_flat = np.abs(mesh.normals[:, 2]) >= _FLAT
    heights = np.round(mesh.centroids[is_flat, 2], 6)
    levels, group = np.unique(heights, return_inverse=True)
    area = np.bincount(group.reshape(-1), weights=mesh.areas[is_flat], minlength=len(levels))
    return np.unique(np.concatenate([levels[area >= _LEAST_FACE_MM2], np.round(mesh.bounds[:, 2], 9)]))


def even_levels(mesh: Mesh, height_mm: float) -> tuple[Floats, list[str]]:
    """Levels at most height_mm apart (but for a thousandth, rounding of the mesh), evenly spread between the flat faces.

    Returns ((n+1,) float mm, findings). A face nearer than a tenth of a layer to the level below is not met exactly.
    """
    faces, findings = flat_levels(mesh), []
    kept = [faces[0]]
    for level in faces[1:-1]:
        apart = min(level - kept[-1], faces[-1] - level)
        if apart < 0.1 * height_mm:
            if apart > _SAME_MM:
                findings.append(
                    f"the flat face at z {level:.3f} mm lies too near to another one and gets no level of its own"
                )
        else:
            kept.append(level)
    kept.append(faces[-1])
    levels = [kept[0]]
    for low, high in pairwise(kept):
        parts = max(1, math.ceil((high - low) / height_mm - _ROUNDING))
        levels.extend(low + (high - low) * (np.arange(parts) + 1) / parts)
    return np.array(levels), findings


def layer_levels(
    mesh: Mesh,
    cusp_mm: float,
    min_mm: float,
    max_mm: float,
    *,
    rule: LayerRule = "facet",
    side: ToleranceSide = "both",
    crease_deg: float = 35.0,
    style: ContourStyle | None = None,
) -> tuple[Floats, list[str]]:
    """Levels of all layers of a mesh in its build frame: (n+1,) float mm from the lowest to the highest point, findings.

    min_mm == max_mm : even layers of at most that height; else the rule for layers between the bounds, and one finding
    if a measured wall lies farther from the mesh than the cusp.  style : of the contours of ruled walls.
    Raises PlanningError if there would be more layers than a plan can hold.
    """
    height = float(mesh.bounds[1, 2] - mesh.bounds[0, 2])
    if height / max_mm > MAX_LAYERS:
        raise PlanningError(
            f"{height / max_mm:.0f} layers of {max_mm:g} mm for a part {height:g} mm high, at most {MAX_LAYERS}",
            "check the units of the mesh",
        )
    if min_mm >= max_mm:
        return even_levels(mesh, max_mm)
    up = np.array([0.0, 0.0, 1.0])
    if rule == "facet":
        return layer_heights(mesh, up, cusp_mm, min_mm, max_mm), []
    wanted = Wanted(cusp_mm, min_mm, max_mm, rule, side, crease_deg, style)
    found = confirmed_layers(mesh, up, wanted)
    return found.stations, _beyond(found, wanted)


def _beyond(found: Confirmed, wanted: Wanted) -> list[str]:
    """One finding for the layers whose walls the bounds keep from the cusp, one for those whose contours do."""
    findings = []
    most = wanted.cusp_mm * (1.0 + 1e-9)
    by_rim = (found.deviation_mm > most) & (found.share <= 1.0)
    off = (found.deviation_mm > most) & ~by_rim
    if off.any():
        worst = int(np.argmax(np.where(off, found.deviation_mm, 0.0)))
        findings.append(
            f"{int(off.sum())} of {len(off)} layers cannot be thin enough for the cusp of {wanted.cusp_mm:g} mm: their "
            f"{wanted.rule} walls lie up to {found.deviation_mm[worst]:.3g} mm from the mesh, most between z "
            f"{found.stations[worst]:.2f} and {found.stations[worst + 1]:.2f} mm"
        )
    if by_rim.any():
        worst = int(np.argmax(np.where(by_rim, found.deviation_mm, 0.0)))
        findings.append(
            f"{int(by_rim.sum())} of {len(off)} layers follow the smooth surface, which bulges up to "
            f"{found.deviation_mm[worst]:.3g} mm over the mesh's facets, near z {found.stations[worst]:.2f} mm, more than the cusp "
            f"of {wanted.cusp_mm:g} mm: give a finer mesh, a larger cusp or fit = facets"
        )
    return findings
