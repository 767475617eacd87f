"""Contours and ruled walls of layers that turn, for the plan: NURBS in the build frame, as for level layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from planner.matching.branching import swept_curve
from planner.mesh.mesh import Mesh
from planner.nurbs.rings import curves_from_region
from planner.plan import Contour, Wall
from planner.recipe import Recipe
from planner.slicing.contours import REGION_MM, ContourStyle, section_curves_many
from planner.slicing.plane_regions import is_same
from planner.slicing.regions import built_region
from planner.slicing.section import Section
from planner.slicing.turning import TurnedLayer, seen_along_z
from planner.slicing.walls import ruled_walls_many

_STEP_MM = 0.25  # between the points at which a contour put together of sections is measured


def plan_outlines(
    mesh: Mesh, layers: Sequence[TurnedLayer], recipe: Recipe
) -> list[tuple[tuple[Contour, ...], tuple[Wall, ...]]]:
    """Contours (in the bottom plane) and walls (bottom to top) of each layer, build frame, mm.

    mesh : the piece that the layers were cut from. Where a layer is built from one of its sections, the contour is that
    section's own curve seen along the layer's z; else it is put together of the sections. Walls as `ruled_walls_many`.
    """
    style = ContourStyle.from_recipe(recipe)
    chosen = [_single(layer) for layer in layers]
    own = iter(section_curves_many([section for section in chosen if section is not None], mesh, style))
    walls = ruled_walls_many([(layer.region.bottom, layer.region.top) for layer in layers], mesh, style)
    found = []
    for layer, section, sides in zip(layers, chosen, walls, strict=True):
        if section is None:
            found.append((_put_together(layer, mesh, style), sides))
            continue
        normal = layer.bottom[3:]
        contours = tuple(
            Contour(
                swept_curve(item.curve, layer.bottom, normal),
                loop.is_hole,
                loop.parent,
                item.deviation_mm,
                item.smooth_deviation_mm,
            )
            for item, loop in zip(next(own), section.loops, strict=True)
        )
        found.append((contours, sides))
    return found


def _single(layer: TurnedLayer) -> Section | None:
    """The section that a layer is built from; None if it is built from several."""
    region = layer.region
    for section, area in zip((region.bottom, region.middle, region.top), region.areas, strict=True):
        if is_same(area, region.region):
            return section
    return None


def _put_together(layer: TurnedLayer, mesh: Mesh, style: ContourStyle) -> tuple[Contour, ...]:
    """Contours of what several sections make, seen along the layer's z.

    Their deviation from the facets is the distance of their points from the outline of the polygons put together so; that
    from the smooth surface is an upper bound: the curves' own, the distance from the outline that they make, REGION_MM.
    """
    region = layer.region
    sections = [region.bottom, region.middle, region.top]
    polygons = [
        seen_along_z(section, [loop.points for loop in section.loops], layer.build_from_layer) for section in sections
    ]
    facets = built_region(polygons, region.side).boundary
    own = float("nan")
    if style.fit == "surface":
        curves = section_curves_many(sections, mesh, style)
        own = max((item.smooth_deviation_mm for made in curves for item in made), default=0.0) + REGION_MM
    smooth = region.region.boundary
    made = []
    for ring in curves_from_region(region.region):
        places = np.linspace(*ring.curve.domain, max(50, int(ring.curve.length / _STEP_MM)))
        points = shapely.points(ring.curve.evaluate(places)[:, :2])
        outward = float(shapely.distance(facets, points).max())
        off = own + float(shapely.distance(smooth, points).max())
        made.append(Contour(ring.curve.transformed(layer.build_from_layer), ring.is_hole, ring.parent, outward, off))
    return tuple(made)
