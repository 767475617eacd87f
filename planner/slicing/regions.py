"""What a layer is made of: its sections, their union, how far it rests on the layer below."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.slicing.cusp import ToleranceSide
from planner.slicing.plane_regions import SAME_MM, common, is_same, united
from planner.slicing.resting import Overhang, overhang
from planner.slicing.section import Section
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]

__all__ = [
    "SAME_MM",
    "LayerRegion",
    "Shapes",
    "built_region",
    "common",
    "facet_shapes",
    "is_same",
    "layer_regions",
    "united",
]

_INSIDE = 2e-6
"""Of the part's height: how far inside a layer its bottom and top sections are taken. Flat faces in 32-bit coordinates
are level only to 1e-6 of the part; a section taken in the face itself might fall on either side of it."""


@dataclass(frozen=True)
class LayerRegion:
    """One layer of the part in its build frame, mm.

    bottom, middle, top : sections just above the lower plane, half-way, and just below the upper plane
    region : what the layer is built from, see `built_region`    side : where it may lie
    rests : paper Eq. 1: what of this layer as it is built rests on the layer below as that is built, and what does not
    """

    index: int
    z_bottom: float
    z_top: float
    bottom: Section
    middle: Section
    top: Section
    areas: tuple[MultiPolygon, MultiPolygon, MultiPolygon]
    region: MultiPolygon
    rests: Overhang
    side: ToleranceSide = "outside"

    @property
    def height_mm(self) -> float:
        """Distance of the two planes."""
        return self.z_top - self.z_bottom

    @property
    def overlap(self) -> MultiPolygon:
        """What rests on the layer below, in the xy of the layer's bottom plane, mm."""
        return self.rests.overlap

    @property
    def overhang(self) -> MultiPolygon:
        """What does not, mm."""
        return self.rests.overhang

    @property
    def overlap_mm2(self) -> float:
        """Area of the overlap, mm²."""
        return float(self.rests.overlap.area)

    @property
    def overhang_mm2(self) -> float:
        """Area of the overhang, mm²."""
        return float(self.rests.overhang.area)

    @property
    def unsupported_mm(self) -> float:
        """Longest way along the side surface from what carries the layer to its edge, mm; 0 without overhang."""
        return self.rests.unsupported_mm

    @cached_property
    def is_upright(self) -> bool:
        """Whether the walls run along the build direction."""
        return is_same(self.areas[0], self.areas[1]) and is_same(self.areas[0], self.areas[2])


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
        built = built_region(areas, side)
        height = float(upper[i] - lower[i])
        rests = Overhang(built) if i == 0 else overhang(built, layers[-1].region, height, areas[0])
        layers.append(
            LayerRegion(
                index=i,
                z_bottom=float(lower[i]),
                z_top=float(upper[i]),
                bottom=above[i],
                middle=above[count + i],
                top=below[i],
                areas=areas,
                region=built,
                rests=rests,
                side=side,
            )
        )
    return layers


def _planes(heights: Floats) -> Floats:
    planes = np.zeros((len(heights), 6))
    planes[:, 2], planes[:, 5] = heights, 1.0
    return planes
