"""Walls of any layers of a mesh, built as they will be and measured, many in one go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.matching.deviation import WallDeviation, wall_deviation
from planner.matching.layer import SURFACE_STYLE, stack_walls
from planner.matching.walls import LayerWalls
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.slicing.contours import ContourStyle
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MeasuredWalls:
    """The walls of one layer and how far they lie from the mesh, both ways."""

    walls: LayerWalls
    deviation: WallDeviation


def measured_walls(
    mesh: Mesh,
    lower: Floats,
    upper: Floats,
    *,
    style: ContourStyle = SURFACE_STYLE,
    tree: FacetTree | None = None,
) -> list[MeasuredWalls]:
    """The ruled walls of layers that need not follow each other.

    lower, upper : (k, 6) float   the planes of each layer, a point (mm) and a unit normal   tree : of the mesh
    Raises as `slice_mesh` and `stack_walls`.
    """
    if not len(lower):
        return []
    known = tree or FacetTree(mesh)
    pairs = list(zip(slice_mesh(mesh, lower, "above"), slice_mesh(mesh, upper, "below"), strict=True))
    return [MeasuredWalls(walls, wall_deviation(walls, mesh, known)) for walls in stack_walls(mesh, pairs, style=style)]
