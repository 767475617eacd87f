"""Contours and ruled walls of layers that turn, for the plan: NURBS in the build frame, as for level layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from planner.matching import stack_walls
from planner.matching.branching import swept_curve
from planner.matching.layer import SURFACE_STYLE
from planner.mesh.mesh import Mesh
from planner.nurbs.rings import curves_from_region
from planner.nurbs.ruled import RuledSurface
from planner.plan import Contour, Wall
from planner.recipe import Recipe
from planner.slicing.contours import REGION_MM, ContourStyle, section_curves_many, single_section
from planner.slicing.regions import built_region
from planner.slicing.section import Section
from planner.slicing.turning import TurnedLayer, seen_along_z

_POINT, _STRETCH = 1e-5, 1e-3
"""Of a contour's length: a piece shorter than the first is a point, one longer than the second is none."""
_STEP_MM = 0.25  # between the points at which a contour put together of sections is measured


def plan_outlines(
    mesh: Mesh, layers: Sequence[TurnedLayer], recipe: Recipe
) -> list[tuple[tuple[Contour, ...], tuple[Wall, ...]]]:
    """Contours (in the bottom plane) and walls (bottom to top) of each layer, build frame, mm.

    mesh : the piece that the layers were cut from. Where a layer is built from one of its sections, the contour is that
    section's own curve seen along the layer's z; else it is put together of the sections. Walls as `turned_walls`.
    """
    style = ContourStyle.from_recipe(recipe)
    chosen = [single_section(layer.region) for layer in layers]
    own = iter(section_curves_many([section for section in chosen if section is not None], mesh, style))
    walls = turned_walls(mesh, [(layer.region.bottom, layer.region.top) for layer in layers], style)
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


def turned_walls(
    mesh: Mesh, pairs: Sequence[tuple[Section, Section]], style: ContourStyle = SURFACE_STYLE
) -> list[tuple[Wall, ...]]:
    """Ruled walls between a bottom and a top section each, whose planes need not be parallel; build frame, mm.

    None where contours do not correspond one to one, or where a corner of one faces a stretch of the other: no one ruling
    leaves it.   Source: paper Eq. 19, V.
    """
    found: list[tuple[Wall, ...]] = [()] * len(pairs)
    fitting = [k for k, (low, high) in enumerate(pairs) if low.loops and len(low.loops) == len(high.loops)]
    for k, made in zip(fitting, stack_walls(mesh, [pairs[k] for k in fitting], style=style), strict=True):
        if not made.notes and not any(wall.how == "swept" or _has_fan(wall.surface) for wall in made.walls):
            found[k] = tuple(Wall(w.surface.curve0, w.surface.curve1, w.twist_max_rad) for w in made.walls)
    return found


def _has_fan(surface: RuledSurface) -> bool:
    """Whether a point of one contour faces a stretch of the other."""
    breaks = surface.curve0.breaks
    shares = []
    for curve in (surface.curve0, surface.curve1):
        chords = np.linalg.norm(np.diff(curve.evaluate(breaks), axis=0), axis=1)
        shares.append(chords / max(float(chords.sum()), 1e-12))
    return bool(((np.minimum(*shares) <= _POINT) & (np.maximum(*shares) >= _STRETCH)).any())


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
