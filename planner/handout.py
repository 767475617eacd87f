"""Layers handed out while the rest of the part is still being planned."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from planner.mesh.mesh import Mesh
from planner.plan import Contour, Layer, Operation, Wall
from planner.recipe import Recipe
from planner.slicing.contours import ContourStyle, layer_contours_many
from planner.slicing.regions import LayerRegion
from planner.slicing.walls import ruled_walls_many

LOT = 8
"""Layers whose contours are fitted together: enough to share the fixed cost of a fit, few enough to be waited for."""


class Handout:
    """Takes layers with their operations, in the order in which they are made, and makes the Plan's layers of them.

    The first layer is made at once, the others in lots.
    part : in the build frame   count : layers in all   on_layer : handed each layer   progress : told the share done
    """

    def __init__(
        self,
        part: Mesh,
        recipe: Recipe,
        count: int,
        on_layer: Callable[[Layer], None] | None,
        progress: Callable[[float], None],
    ) -> None:
        self.part, self.count = part, count
        self.style = ContourStyle.from_recipe(recipe)
        self.on_layer, self.progress = on_layer, progress
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
            layer = layer_of(region, contours, walls, operations)
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
    )
