"""The build direction of a part that leaves it open: little overhang, a broad base, few layers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.decompose.corners import used_vertices
from planner.errors import RecipeError
from planner.mesh.mesh import Mesh
from planner.recipe import Recipe
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]

_OVERHANG_DEG = 45.0
"""Faces that look down more than this from the horizontal direction of a wall count as overhang."""
_FACET_CANDIDATES = 8  # largest flat faces that may lie on the substrate, besides the six axes
_STEPS = 10_000  # of a normal's coordinate from 0 to 1: facets that differ by less are one flat face
_WIDTH = 2 * _STEPS + 1
_BASE_MM = 0.05  # faces within this height of the lowest point lie on the substrate
_WEIGHTS = {"overhang": 1.0, "height": 0.3, "base": 0.5}
"""Of overhanging area, height and missing base, each relative to the part's size. Overhang costs most: it falls away;
the base holds the part while it is milled; height costs time only."""


def build_direction(mesh: Mesh, recipe: Recipe) -> tuple[Floats, list[str]]:
    """The unit build direction in the part frame, and what was decided.  Raises RecipeError if it has no length."""
    if recipe.build_direction == "auto":
        return best_direction(mesh)
    return asked_direction(recipe.build_direction, "build_direction"), []


def build_directions(mesh: Mesh, recipe: Recipe) -> list[Floats]:
    """Unit directions, part frame, of which the first piece's will be one.  Raises RecipeError if the one asked for has no length."""
    if recipe.build_direction == "auto":
        return candidate_directions(mesh)
    return [asked_direction(recipe.build_direction, "build_direction")]


def asked_direction(asked: tuple[float, float, float], name: str) -> Floats:
    """(3,) float   A recipe's direction as a unit vector.  name : of its field.  Raises RecipeError if it has no length."""
    vector = np.array(asked, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise RecipeError(f"{name}: asked (0, 0, 0), it needs a length", 'give a vector or "auto"')
    return vector / length


def build_frame(mesh: Mesh, direction: Floats, turn_deg: float = 0.0) -> Floats:
    """(4, 4) float   build_from_part: z along the direction, the box's centre at x = y = 0, its lowest point at z = 0.

    turn_deg : counter-clockwise about z.
    """
    rotation = plane_frame(np.concatenate([np.zeros(3), direction]))[1:]
    if turn_deg:
        cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    turned = mesh.vertices[used_vertices(mesh)] @ rotation.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    build_from_part = np.eye(4)
    build_from_part[:3, :3] = rotation
    build_from_part[:3, 3] = -np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])
    return build_from_part


def best_direction(mesh: Mesh) -> tuple[Floats, list[str]]:
    """The best of the six axes and of the largest flat faces laid down: (3,) float unit vector, and a finding that says so."""
    candidates = candidate_directions(mesh)
    scores = np.array([direction_score(mesh, candidate) for candidate in candidates])
    best = candidates[int(np.argmin(np.round(scores, 9)))]
    text = ", ".join(f"{value:.4g}" for value in best + 0.0)
    return best, [f"build direction chosen: ({text}), the best of {len(candidates)} by overhang, base and height"]


def direction_score(mesh: Mesh, direction: Floats) -> float:
    """What building along a unit direction costs, 0 (a prism on its base) and up; smaller is better."""
    along = mesh.vertices[mesh.facets] @ direction
    low, high = float(along.min()), float(along.max())
    facing = mesh.normals @ direction
    on_base = (along.max(axis=1) <= low + _BASE_MM) & (facing < -0.99)
    hangs = (facing < -np.sin(np.radians(_OVERHANG_DEG))) & ~on_base
    overhang = float((mesh.areas[hangs] * -facing[hangs]).sum())
    shadow = 0.5 * float((mesh.areas * np.abs(facing)).sum())
    base = float(mesh.areas[on_base].sum())
    return (
        _WEIGHTS["overhang"] * overhang / max(shadow, 1e-12)
        + _WEIGHTS["height"] * (high - low) / mesh.diagonal
        + _WEIGHTS["base"] * (1.0 - min(base / max(shadow, 1e-12), 1.0))
    )


def candidate_directions(mesh: Mesh) -> list[Floats]:
    """+z first (it wins a tie), the other axes, then the directions away from the largest flat faces."""
    axes = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=np.float64)
    steps = np.rint(mesh.normals * _STEPS).astype(np.int64) + _STEPS
    names, group = np.unique(steps @ [_WIDTH**2, _WIDTH, 1], return_inverse=True)
    normals = (np.column_stack([names // _WIDTH**2, names // _WIDTH % _WIDTH, names % _WIDTH]) - _STEPS) / _STEPS
    areas = np.bincount(group.reshape(-1), weights=mesh.areas, minlength=len(normals))
    found = [axis for axis in axes]
    for number in np.argsort(-areas, kind="stable")[:_FACET_CANDIDATES]:
        length = float(np.linalg.norm(normals[number]))
        if length < 0.5:
            continue
        down = normals[number] / length
        if all(np.abs(-down - other).max() > 1e-3 for other in found):
            found.append(-down)
    return found
