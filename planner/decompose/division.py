"""Division of a part into pieces: each with a base on what stands before it, a direction and a place in the order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.decompose.axis import axis_graph, straight_axis
from planner.decompose.direction import build_direction, build_frame
from planner.decompose.pieces import Division, Piece
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.recipe import Recipe

Floats = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def divide(mesh: Mesh, recipe: Recipe, settings: Settings) -> Division:
    """The pieces of a part in the order of building.

    mesh : part frame, mm, closed.  Raises RecipeError if the build direction asked for has no length.
    """
    direction, chosen = build_direction(mesh, recipe)
    build_from_part = build_frame(mesh, direction, recipe.turn_deg)
    part = mesh.transformed(build_from_part)
    axis, radii = straight_axis(part, _UP)
    whole = Piece("1", part, -1, _UP, base_area(part, _UP), axis)
    return Division(build_from_part, (whole,), axis_graph(axis, radii), findings=tuple(chosen))


def base_area(mesh: Mesh, base: Floats) -> float:
    """Area, mm², of the facets that lie in a base plane (point and direction, (6,)) and look against it."""
    flat = np.abs((mesh.corners - base[:3]) @ base[3:]).max(axis=1) <= 1e-6 * mesh.diagonal
    return float(mesh.areas[flat & (mesh.normals @ base[3:] < -0.99)].sum())
