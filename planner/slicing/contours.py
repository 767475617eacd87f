"""The outline of a layer as NURBS curves, corners where the mesh has creases, and its deviation from the facets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.nurbs.curve import Curve
from planner.nurbs.densify import drop_collinear
from planner.nurbs.fit import interpolate_many
from planner.nurbs.measure import deviation
from planner.nurbs.rings import curves_from_region
from planner.plan import Contour
from planner.slicing.regions import LayerRegion, is_same
from planner.slicing.section import Section

Floats = NDArray[np.float64]

CREASE_DEG = 35.0
"""Edges of the mesh that bend more are creases: a dodecagon still reads as a circle, an octagon as itself."""
_COLLINEAR_MM = 1e-4  # points that only a facet's diagonal made lie this near to the line of their neighbours


def section_curves(section: Section, mesh: Mesh) -> list[tuple[Curve, float]]:
    """Each loop of a section as a curve in space and its deviation from the section, mm.

    mesh : the one that was cut. A point where facets meet at more than the crease angle is a corner.
    """
    if not section.loops:
        return []
    points, corners = [], []
    for loop in section.loops:
        kept, index = drop_collinear(loop.points, _COLLINEAR_MM, closed=True)
        normals = mesh.normals[loop.facets]
        bend = (normals * np.roll(normals, 1, axis=0)).sum(axis=1) < np.cos(np.radians(CREASE_DEG))
        points.append(kept)
        corners.append(_crease_corners(bend, index))
    curves = interpolate_many(points, closed=True, corners=corners)
    return [
        (curve, deviation(curve, loop.points, closed=True)) for curve, loop in zip(curves, section.loops, strict=True)
    ]


def _crease_corners(bend: NDArray[np.bool_], kept: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Corner flags of the kept points: a crease at a dropped point counts for the kept one before it."""
    flags = np.zeros(len(kept), dtype=bool)
    flags[(np.searchsorted(kept, np.flatnonzero(bend), side="right") - 1) % len(kept)] = True
    return flags


def layer_contours(layer: LayerRegion, mesh: Mesh) -> tuple[Contour, ...]:
    """The outline of what the layer is built from, at its lower plane (build frame, mm).

    Of one of its sections where that holds all others, with the mesh's own corners; else of their union.
    """
    for section, area in zip((layer.bottom, layer.top, layer.middle), layer.areas, strict=True):
        if not is_same(area, layer.region):
            continue
        lowered = np.eye(4)
        lowered[2, 3] = layer.z_bottom - section.origin[2]
        return tuple(
            Contour(curve.transformed(lowered), loop.is_hole, loop.parent, error)
            for (curve, error), loop in zip(section_curves(section, mesh), section.loops, strict=True)
        )
    lift = np.eye(4)
    lift[2, 3] = layer.z_bottom
    rings = curves_from_region(layer.region)
    outlines = [np.asarray(ring.coords) for part in layer.region.geoms for ring in (part.exterior, *part.interiors)]
    return tuple(
        Contour(
            ring.curve.transformed(lift),
            ring.is_hole,
            ring.parent,
            min(deviation(ring.curve, outline[:-1], closed=True) for outline in outlines),
        )
        for ring in rings
    )
