"""What a layer is made of: its sections, their union, how far it rests on the layer below."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.slicing.cusp import ToleranceSide
from planner.slicing.section import Section
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]

SAME_MM = 1e-4
"""Sections nearer than this to each other count as one: a hundredth of what a five-axis machine holds."""
_INSIDE = 2e-6
"""Of the part's height: how far inside a layer its bottom and top sections are taken. Flat faces in 32-bit coordinates
are level only to 1e-6 of the part; a section taken in the face itself might fall on either side of it."""
_GRID_MM = 1e-6  # unions are made on this grid, so that nearly equal outlines leave no slivers


@dataclass(frozen=True)
class LayerRegion:
    """One layer of the part in its build frame, mm.

    bottom, middle, top : sections just above the lower plane, half-way, and just below the upper plane
    region : what the layer is built from, see `built_region`    side : where it may lie
    overlap_mm2, overhang_mm2 : paper Eq. 1: what of this layer's bottom rests on the layer below, and what does not
    """

    index: int
    z_bottom: float
    z_top: float
    bottom: Section
    middle: Section
    top: Section
    areas: tuple[MultiPolygon, MultiPolygon, MultiPolygon]
    region: MultiPolygon
    overlap_mm2: float
    overhang_mm2: float
    side: ToleranceSide = "outside"

    @property
    def height_mm(self) -> float:
        """Distance of the two planes."""
        return self.z_top - self.z_bottom

    @cached_property
    def is_upright(self) -> bool:
        """Whether the walls run along the build direction."""
        return is_same(self.areas[0], self.areas[1]) and is_same(self.areas[0], self.areas[2])


def is_same(first: MultiPolygon, second: MultiPolygon, tolerance_mm: float = SAME_MM) -> bool:
    """Whether the outlines of two regions lie within the tolerance of each other."""
    if first.is_empty or second.is_empty:
        return bool(first.is_empty and second.is_empty)
    if len(first.geoms) != len(second.geoms):
        return False
    if np.abs(np.subtract(first.bounds, second.bounds)).max() > tolerance_mm:
        return False
    return _is_near(first, second, tolerance_mm) and _is_near(second, first, tolerance_mm)


def _is_near(first: MultiPolygon, second: MultiPolygon, tolerance_mm: float) -> bool:
    """Whether all vertices of one outline lie within the tolerance of the other outline."""
    outline = second.boundary
    shapely.prepare(outline)
    return bool(shapely.dwithin(outline, shapely.points(shapely.get_coordinates(first)), tolerance_mm).all())


def united(areas: list[MultiPolygon]) -> MultiPolygon:
    """The union; one of the regions itself where they are the same or it holds all others."""
    filled = [area for area in areas if not area.is_empty]
    if not filled:
        return MultiPolygon()
    largest = max(filled, key=lambda area: area.area)
    if all(is_same(largest, area) for area in filled):
        return largest
    whole = shapely.union_all(filled, grid_size=_GRID_MM)
    if whole.area - largest.area <= SAME_MM * largest.length:
        return largest
    return MultiPolygon([part for part in shapely.get_parts(whole) if part.geom_type == "Polygon"])


def common(areas: list[MultiPolygon]) -> MultiPolygon:
    """What all regions cover; one of them itself where they are the same or all others hold it."""
    if not areas or any(area.is_empty for area in areas):
        return MultiPolygon()
    smallest = min(areas, key=lambda area: area.area)
    if all(is_same(smallest, area) for area in areas):
        return smallest
    shared = reduce(lambda first, second: shapely.intersection(first, second, grid_size=_GRID_MM), areas)
    if smallest.area - shared.area <= SAME_MM * smallest.length:
        return smallest
    return MultiPolygon([part for part in shapely.get_parts(shared) if part.geom_type == "Polygon"])


def built_region(areas: Sequence[MultiPolygon], side: ToleranceSide) -> MultiPolygon:
    """What a layer with upright walls is built from.

    areas : what its bottom, middle and top sections enclose, mm
    side : "outside" the part lies in the layer: the sections' union; "inside" the layer in the part: their intersection;
    "both": the middle section, half of the step on each side.
    """
    if side == "both":
        return areas[1]
    return united(list(areas)) if side == "outside" else common(list(areas))


Shapes = Callable[[list[Section]], list[MultiPolygon]]


def facet_shapes(sections: list[Section]) -> list[MultiPolygon]:
    """What each section's straight sides enclose, mm."""
    return [section.to_shapely() for section in sections]


def layer_regions(
    mesh: Mesh, levels: Floats, shapes_of: Shapes = facet_shapes, side: ToleranceSide = "outside"
) -> list[LayerRegion]:
    """The layers between neighbouring levels; all sections come from two calls of the slicer.

    mesh : in the build frame   levels : (n+1,) float, mm, increasing
    shapes_of : what sections enclose: their facets' sides, or curves that stand for them
    side : where upright walls may lie, see `built_region`. What is milled afterwards needs the union: there must be metal
    wherever the part is.
    """
    lower, upper = levels[:-1], levels[1:]
    inside = _INSIDE * float(levels[-1] - levels[0])
    above = slice_mesh(mesh, _planes(np.concatenate([lower + inside, 0.5 * (lower + upper)])), "above")
    below = slice_mesh(mesh, _planes(upper - inside), "below")
    count = len(lower)
    shapes = shapes_of([*above, *below])
    layers: list[LayerRegion] = []
    for i in range(count):
        areas = (shapes[i], shapes[count + i], shapes[2 * count + i])
        rests = areas[0].area if i == 0 else _shared_mm2(areas[0], layers[-1].areas[2])
        layers.append(
            LayerRegion(
                index=i,
                z_bottom=float(lower[i]),
                z_top=float(upper[i]),
                bottom=above[i],
                middle=above[count + i],
                top=below[i],
                areas=areas,
                region=built_region(areas, side),
                overlap_mm2=rests,
                overhang_mm2=max(areas[0].area - rests, 0.0),
                side=side,
            )
        )
    return layers


def _shared_mm2(first: MultiPolygon, second: MultiPolygon) -> float:
    """What two regions share, mm².  Sides that nearly coincide are put on a grid: without it the overlay may lose a region."""
    return float(shapely.intersection(first, second, grid_size=_GRID_MM).area)


def _planes(heights: Floats) -> Floats:
    planes = np.zeros((len(heights), 6))
    planes[:, 2], planes[:, 5] = heights, 1.0
    return planes
