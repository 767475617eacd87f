"""Layers handed out while the rest of the part is still being planned."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.plan import Contour, Layer, Operation, Wall
from planner.recipe import Recipe
from planner.slicing.contours import ContourStyle, layer_contours_many
from planner.slicing.regions import LayerRegion
from planner.slicing.walls import ruled_walls_many

Floats = NDArray[np.float64]

LOT = 8
"""Layers whose contours are fitted together: enough to share the fixed cost of a fit, few enough to be waited for."""


class Handout:
    """Takes layers with their operations, in the order in which they are made, and makes the Plan's layers of them.

    The first layer is made at once, the others in lots.
    part : in the frame of its layers   count : layers in all   on_layer : handed each layer   progress : told the share done
    placed : carries each layer to the frame and the number that it has in the Plan
    """

    def __init__(
        self,
        part: Mesh,
        recipe: Recipe,
        count: int,
        on_layer: Callable[[Layer], None] | None,
        progress: Callable[[float], None],
        placed: Callable[[Layer], Layer] = lambda layer: layer,
    ) -> None:
        self.part, self.count = part, count
        self.style = ContourStyle.from_recipe(recipe)
        self.on_layer, self.progress, self.placed = on_layer, progress, placed
        self.waiting: list[tuple[LayerRegion, tuple[Operation, ...]]] = []
        self.layers: list[Layer] = []

    def take(self, region: LayerRegion, operations: Iterable[Operation]) -> None:
        """A layer to which no operation will be added."""
        self.waiting.append((region, tuple(operations)))
        if not self.layers or len(self.waiting) >= LOT:
            self._hand_out()
        self.progress((len(self.layers) + len(self.waiting)) / self.count)

    def finish(self) -> list[Layer]:
        """All layers, after the last was taken."""
        self._hand_out()
        return self.layers

    def _hand_out(self) -> None:
        regions = [region for region, _ in self.waiting]
        outlines = layer_contours_many(regions, self.part, self.style)
        leaning = [region for region in regions if not region.is_upright]
        ruled = ruled_walls_many([(region.bottom, region.top) for region in leaning], self.part, self.style)
        walls_of = {region.index: walls for region, walls in zip(leaning, ruled, strict=True)}
        for (region, operations), contours in zip(self.waiting, outlines, strict=True):
            walls = walls_of[region.index] if region.index in walls_of else upright_walls(region, contours)
            layer = self.placed(layer_of(region, contours, walls, operations))
            self.layers.append(layer)
            if self.on_layer is not None:
                self.on_layer(layer)
        self.waiting = []


def upright_walls(region: LayerRegion, contours: Iterable[Contour]) -> tuple[Wall, ...]:
    """The walls of a layer along the build direction: its contours, and the same raised to its top."""
    raised = np.eye(4)
    raised[2, 3] = region.height_mm
    return tuple(Wall(contour.curve, contour.curve.transformed(raised)) for contour in contours)


def layer_of(
    region: LayerRegion, contours: tuple[Contour, ...], walls: tuple[Wall, ...], operations: Iterable[Operation]
) -> Layer:
    """The Layer of the Plan: planes, contours, walls, areas and what is done to it."""
    return Layer(
        index=region.index,
        bottom=np.array([0.0, 0.0, region.z_bottom, 0.0, 0.0, 1.0]),
        top=np.array([0.0, 0.0, region.z_top, 0.0, 0.0, 1.0]),
        contours=contours,
        walls=walls,
        overlap_mm2=region.overlap_mm2,
        overhang_mm2=region.overhang_mm2,
        operations=tuple(operations),
        overhang=outlines_of(region),
        thickness_mm=(region.height_mm, region.height_mm),
    )


def outlines_of(region: LayerRegion) -> tuple[Floats, ...]:
    """Closed outlines of what of a layer rests on nothing, (n, 3) float, mm, in its bottom plane; holes run clockwise."""
    rings: list[Floats] = []
    for piece in region.overhang.geoms:
        turned = shapely.geometry.polygon.orient(piece)
        for ring in (turned.exterior, *turned.interiors):
            xy = shapely.get_coordinates(ring)
            rings.append(np.column_stack([xy, np.full(len(xy), region.z_bottom)]))
    return tuple(rings)
