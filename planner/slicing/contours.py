"""Sections as NURBS curves along the smooth surface or along the facets, with what they measure from both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.errors import InputError
from planner.mesh.mesh import Mesh
from planner.mesh.patch import distances_to_patches
from planner.mesh.smooth import STORED, SmoothSurface, smooth_surface
from planner.nurbs.curve import Curve
from planner.nurbs.densify import densify, drop_collinear
from planner.nurbs.fit import interpolate_many
from planner.nurbs.rings import curves_from_region
from planner.nurbs.sampling import divide_evenly
from planner.plan import Contour
from planner.recipe import Recipe
from planner.slicing.chain import chain_of
from planner.slicing.doubt import doubtful
from planner.slicing.nearness import nearest_sides
from planner.slicing.nodes import Outline, node_kinds
from planner.slicing.regions import LayerRegion, built_region, is_same
from planner.slicing.section import Section

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CREASE_DEG = 35.0
"""Edges of the mesh that bend more are creases: a dodecagon still reads as a circle, an octagon as itself."""
REGION_MM = 5e-4  # chord error of regions made of curves: a hundredth of a finish pass's allowance
_COLLINEAR_MM = 1e-6  # points that only a facet's diagonal made lie this near to the line of their neighbours
LOT_POINTS = 50_000  # of sections that are fitted or measured together: enough to share the fixed cost, 100 MB
_SAMPLES_PER_SIDE = 8  # a cubic piece bends once or twice: its extremes lie between these
_LONG_SIDES, _SAMPLES_BEYOND = 4, 2  # a piece past more sides than this bends little at each: so many are enough


@dataclass(frozen=True)
class ContourStyle:
    """How contours are made: the recipe's fit, handles, crease_deg and fit_epsilon_mm."""

    fit: Literal["surface", "facets"] = "surface"
    handles: Literal["curvature", "speed"] = "curvature"
    crease_deg: float = CREASE_DEG
    epsilon_mm: float = 0.5

    @classmethod
    def from_recipe(cls, recipe: Recipe) -> ContourStyle:
        """The style that a recipe asks for."""
        return cls(recipe.fit, recipe.handles, recipe.crease_deg, recipe.fit_epsilon_mm)


@dataclass(frozen=True, eq=False)
class SectionCurve:
    """One loop of a section as a curve in space.

    deviation_mm : largest distance between the curve and the loop's sides, both ways, measured at 8 points per side,
        and at 2 where a piece of the curve runs along more than 16
    smooth_deviation_mm : largest distance, across the curve in its plane, from the curved PN triangles over the facets
        that it runs along, measured at the same points between the nodes; NaN for fit = "facets"
    """

    curve: Curve
    deviation_mm: float
    smooth_deviation_mm: float


_FITTED: WeakKeyDictionary[Section, dict[ContourStyle, list[Curve]]] = WeakKeyDictionary()
_DOUBTED: WeakKeyDictionary[Section, dict[ContourStyle, int]] = WeakKeyDictionary()


def fitted_curves(sections: Sequence[Section], mesh: Mesh, style: ContourStyle = ContourStyle()) -> list[list[Curve]]:
    """Every loop of every section as a curve, as `section_curves_many`, but not measured.

    Fitted in lots of LOT_POINTS points, and kept as long as their section is. With fit = "surface", a contour that lies
    farther from its loop than the facets along it can stand for (`doubtful`) is the loop itself instead.
    Raises as `section_curves_many`.
    """
    if style.fit not in ("surface", "facets"):
        raise InputError(f"fit is {style.fit!r}", 'choose "surface" or "facets"')
    new = [section for section in dict.fromkeys(sections) if style not in _FITTED.get(section, {})]
    for lot in lots(new):
        outline = Outline.of(lot)
        made: Iterator[tuple[Curve, bool]] = iter(())
        if len(outline.loop):
            made = _along(outline, smooth_surface(mesh, style.crease_deg), style)
        for section in lot:
            own = [next(made) for _ in section.loops]
            _FITTED.setdefault(section, {})[style] = [curve for curve, _ in own]
            _DOUBTED.setdefault(section, {})[style] = sum(is_doubted for _, is_doubted in own)
    return [_FITTED[section][style] for section in sections]


def doubted(sections: Sequence[Section], style: ContourStyle = ContourStyle()) -> int:
    """How many contours of the sections follow the facets although fit = "surface", of those fitted so far."""
    return sum(_DOUBTED.get(section, {}).get(style, 0) for section in dict.fromkeys(sections))


def _along(outline: Outline, surface: SmoothSurface, style: ContourStyle) -> Iterator[tuple[Curve, bool]]:
    """A curve for each loop, and whether it follows the facets because the smooth surface is in doubt."""
    if style.fit == "facets":
        for curve in _along_facets(outline, surface, style):
            yield curve, False
        return
    curves = _along_surface(outline, surface, style)
    doubts = doubtful(curves, outline, surface)
    instead = iter(_polygons(outline, np.flatnonzero(doubts)))
    for curve, is_doubted in zip(curves, doubts.tolist(), strict=True):
        yield (next(instead), True) if is_doubted else (curve, False)


def lots(sections: Sequence[Section]) -> Iterator[list[Section]]:
    """The sections in order, in lots of about LOT_POINTS points: what is worked on at once takes 1 to 2 kB a point."""
    lot: list[Section] = []
    points = 0
    for section in sections:
        lot.append(section)
        points += sum(len(loop.points) for loop in section.loops)
        if points >= LOT_POINTS:
            yield lot
            lot, points = [], 0
    if lot:
        yield lot


def section_curves_many(
    sections: Sequence[Section], mesh: Mesh, style: ContourStyle = ContourStyle()
) -> list[list[SectionCurve]]:
    """Every loop of every section as a curve, all fitted and measured at once; one list per section, as its loops.

    mesh : the one that was cut. Where the contour crosses a crease it has a corner.
    fit = "surface": slice points are lifted onto the smooth surface that the facets stand for (`lifted_nodes`), those
    that only the diagonal of a plane face made are dropped, directions are the surface's; a contour that this leads
    farther from its loop than four times what its facets can rise (`doubtful`) is the loop itself. fit = "facets": the
    loop's own sides, densified to epsilon_mm (paper Eqs. 12, 13).
    Raises InputError for an unknown fit; FitError as `interpolate_many`.
    """
    curves = fitted_curves(sections, mesh, style)
    found: list[list[SectionCurve]] = []
    for lot in lots(sections):
        outline = Outline.of(lot)
        if not len(outline.loop):
            found += [[] for _ in lot]
            continue
        own = curves[len(found) : len(found) + len(lot)]
        surface = smooth_surface(mesh, style.crease_deg)
        errors = measured([curve for made in own for curve in made], outline, surface, style.fit == "surface")
        rows = zip(*(column.tolist() for column in errors), strict=True)
        found += [[SectionCurve(curve, *next(rows)) for curve in made] for made in own]
    return found


def section_curves(section: Section, mesh: Mesh, style: ContourStyle = ContourStyle()) -> list[tuple[Curve, float]]:
    """Each loop of one section as a curve in space and its deviation from the section, mm (`section_curves_many`)."""
    return [(found.curve, found.deviation_mm) for found in section_curves_many([section], mesh, style)[0]]


def _along_surface(outline: Outline, surface: SmoothSurface, style: ContourStyle) -> list[Curve]:
    chain = chain_of(outline, surface)
    parts = [slice(first, last) for first, last in pairwise(chain.start.tolist())]
    return interpolate_many(
        [chain.points[part] for part in parts],
        closed=True,
        corners=[chain.corners[part] for part in parts],
        tangents=[chain.tangents[part] for part in parts],
        handles=style.handles,
        arc_tolerance_mm=arc_tolerance_mm(surface.mesh),
    )


def arc_tolerance_mm(mesh: Mesh) -> float:
    """How near to one circle or line the nodes of an exact arc or line lie: the rounding of stored coordinates, mm."""
    return 2.0 * STORED * float(max(np.abs(mesh.bounds).max(), mesh.diagonal))


def _polygons(outline: Outline, loops: Ints) -> list[Curve]:
    """The sides of some loops as they are, a corner at every point that bends.  loops : (k,) int64"""
    ends = zip(outline.start[loops].tolist(), outline.start[loops + 1].tolist(), strict=True)
    kept = [drop_collinear(outline.points[first:last], _COLLINEAR_MM, closed=True)[0] for first, last in ends]
    return interpolate_many(kept, closed=True, corners=[np.ones(len(points), dtype=bool) for points in kept])


def _along_facets(outline: Outline, surface: SmoothSurface, style: ContourStyle) -> list[Curve]:
    is_corner = node_kinds(outline, surface)[0]
    points, corners = [], []
    for first, last in pairwise(outline.start.tolist()):
        kept, index = drop_collinear(outline.points[first:last], _COLLINEAR_MM, closed=True)
        sides = np.linalg.norm(np.roll(kept, -1, axis=0) - kept, axis=1)
        parts = np.maximum(np.ceil(sides / style.epsilon_mm), 1).astype(np.intp)
        place = np.cumsum(parts) - parts
        bend = np.flatnonzero(is_corner[first:last])
        points.append(densify(kept, style.epsilon_mm, closed=True))
        corners.append(place[(np.searchsorted(index, bend, side="right") - 1) % len(index)])
    return interpolate_many(points, closed=True, corners=corners, handles=style.handles)


def measured(
    curves: Sequence[Curve], outline: Outline, surface: SmoothSurface, is_smooth: bool
) -> tuple[Floats, Floats]:
    """Largest distance of each curve from its loop, both ways, and from the patches over its facets: (k,), (k,) mm.

    The second is NaN unless is_smooth. See `SectionCurve` for what is measured.
    """
    sides = np.linalg.norm(outline.points[outline.after] - outline.points, axis=1)
    samples = [
        curve.evaluate(_sample(curve, float(sides[first:last].mean())))[:-1]
        for curve, (first, last) in zip(curves, pairwise(outline.start.tolist()), strict=True)
    ]
    start = np.concatenate([[0], np.cumsum([len(points) for points in samples])])
    points = np.concatenate(samples)
    outward, side = nearest_sides(points, start, outline.points, outline.start)
    following = outline.points[outline.after]
    probes = np.stack(
        [outline.points + share * (following - outline.points) for share in (0.0, 0.25, 0.5, 0.75)], axis=1
    )
    inward, _ = nearest_sides(probes.reshape(-1, 3), 4 * outline.start, points, start)
    largest = np.maximum(np.maximum.reduceat(outward, start[:-1]), np.maximum.reduceat(inward, 4 * outline.start[:-1]))
    if not is_smooth:
        return largest, np.full(len(largest), np.nan)
    plane = outline.normal[side]
    normal = surface.mesh.normals[outline.facets[side]]
    across = normal - np.einsum("nd,nd->n", normal, plane)[:, None] * plane
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    away = distances_to_patches(surface, points, outline.facets[side], across)
    return largest, np.fmax.reduceat(away, start[:-1])


def _sample(curve: Curve, side_mm: float) -> Floats:
    """Parameters, 8 per knot span and more where a span is longer than the loop's mean side: (k,) float."""
    edges = curve.breaks
    reach = np.linalg.norm(np.diff(curve.evaluate(edges), axis=0), axis=1)
    sides = reach / max(side_mm, 1e-300)
    counts = np.ceil(np.maximum(_SAMPLES_PER_SIDE * np.clip(sides, 1.0, _LONG_SIDES), _SAMPLES_BEYOND * sides))
    return divide_evenly(edges, counts.astype(np.intp))


def region_of(section: Section, curves: Sequence[Curve]) -> MultiPolygon:
    """What the curves of a section enclose, in the section's plane coordinates (mm), within REGION_MM of them.

    curves : of the section's loops, in their order.
    """
    return nested_region(section, [section.flatten(curve.evaluate(curve.sample(REGION_MM)))[:-1] for curve in curves])


def nested_region(section: Section, rings: Sequence[Floats]) -> MultiPolygon:
    """What rings that stand for a section's loops enclose, mm.  rings : (n, 2) float, mm, each, in the loops' order."""
    holes: dict[int, list[Floats]] = {}
    for loop, ring in zip(section.loops, rings, strict=True):
        if loop.is_hole:
            holes.setdefault(loop.parent, []).append(ring)
    parts = [
        shapely.Polygon(ring, holes.get(number, []))
        for number, (loop, ring) in enumerate(zip(section.loops, rings, strict=True))
        if not loop.is_hole
    ]
    whole = MultiPolygon(parts)
    if whole.is_valid:
        return whole
    made = shapely.union_all([shapely.make_valid(part, method="structure", keep_collapsed=False) for part in parts])
    return MultiPolygon([part for part in shapely.get_parts(made) if part.geom_type == "Polygon"])


def layer_contours(layer: LayerRegion, mesh: Mesh, style: ContourStyle = ContourStyle()) -> tuple[Contour, ...]:
    """The outline of what one layer is built from (`layer_contours_many`)."""
    return layer_contours_many([layer], mesh, style)[0]


def layer_contours_many(
    layers: Sequence[LayerRegion], mesh: Mesh, style: ContourStyle = ContourStyle()
) -> list[tuple[Contour, ...]]:
    """The outlines of what each layer is built from, at its lower plane (build frame, mm).

    Of one of its sections where the layer is built from it, with the mesh's own corners; else of what they make together.
    """
    chosen = [single_section(layer) for layer in layers]
    curves = section_curves_many([section for section in chosen if section is not None], mesh, style)
    following = iter(curves)
    found: list[tuple[Contour, ...]] = []
    for layer, section in zip(layers, chosen, strict=True):
        if section is None:
            found.append(_combined_contours(layer, mesh, style))
            continue
        lowered = np.eye(4)
        lowered[2, 3] = layer.z_bottom - section.origin[2]
        found.append(
            tuple(
                Contour(
                    item.curve.transformed(lowered),
                    loop.is_hole,
                    loop.parent,
                    item.deviation_mm,
                    item.smooth_deviation_mm,
                )
                for item, loop in zip(next(following), section.loops, strict=True)
            )
        )
    return found


def single_section(layer: LayerRegion) -> Section | None:
    """The one of a layer's sections that its region is; None if the region is put together from several."""
    for section, area in zip((layer.bottom, layer.middle, layer.top), layer.areas, strict=True):
        if is_same(area, layer.region):
            return section
    return None


def _combined_contours(layer: LayerRegion, mesh: Mesh, style: ContourStyle) -> tuple[Contour, ...]:
    """Contours of what a layer is built from, the union or the intersection of its sections.

    Their deviation from the facets is the distance of their points from the outline of the polygons put together so; that
    from the smooth surface is an upper bound: the distance from that of the curves, the curves' own, REGION_MM.
    """
    lift = np.eye(4)
    lift[2, 3] = layer.z_bottom
    sections = [layer.bottom, layer.middle, layer.top]
    facets = built_region([section.to_shapely() for section in sections], layer.side).boundary
    smooth, own = None, float("nan")
    if style.fit == "surface":
        found = section_curves_many(sections, mesh, style)
        smooth = built_region(
            [
                region_of(section, [item.curve for item in curves])
                for section, curves in zip(sections, found, strict=True)
            ],
            layer.side,
        ).boundary
        own = max((item.smooth_deviation_mm for curves in found for item in curves), default=0.0) + REGION_MM
    made = []
    for ring in curves_from_region(layer.region):
        points = shapely.points(ring.curve.evaluate(_sample(ring.curve, np.inf))[:-1, :2])
        outward = float(shapely.distance(facets, points).max())
        off = own if smooth is None else own + float(shapely.distance(smooth, points).max())
        made.append(Contour(ring.curve.transformed(lift), ring.is_hole, ring.parent, outward, off))
    return tuple(made)
