"""Bodies whose walls are known in closed form, for the tests of matching."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.matching import LayerWalls, divided_walls, layer_walls
from planner.mesh.mesh import Mesh
from planner.slicing import Section, slice_mesh

Floats = NDArray[np.float64]


def loft(outline: Callable[[float], Floats], heights: Floats) -> Mesh:
    """The body between outlines (n, 2), the same number of points at every height, counter-clockwise; flat ends."""
    rings = [np.column_stack([outline(float(z)), np.full(len(outline(float(z))), z)]) for z in heights]
    count, rows = len(rings[0]), len(rings)
    vertices = np.vstack([*rings, [rings[0].mean(axis=0)], [rings[-1].mean(axis=0)]])
    k = np.arange(count)
    n = np.roll(k, -1)
    facets = []
    for row in range(rows - 1):
        low, high = row * count, (row + 1) * count
        facets.append(np.column_stack([low + k, low + n, high + n]))
        facets.append(np.column_stack([low + k, high + n, high + k]))
    last = (rows - 1) * count
    facets.append(np.column_stack([n, k, np.full(count, rows * count)]))
    facets.append(np.column_stack([last + k, last + n, np.full(count, rows * count + 1)]))
    return Mesh(vertices, np.vstack(facets))


def circle(radius: float, count: int = 96, centre: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """(count, 2): points of a circle, counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.asarray(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def square(side: float, count: int = 96, angle: float = 0.0) -> Floats:
    """(count, 2): points evenly round a square, a corner first; count a multiple of 4."""
    per = count // 4
    corners = 0.5 * side * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    share = (np.arange(per) / per)[:, None]
    points = np.vstack([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.asarray(points @ turn)


def united(*bodies: trimesh.Trimesh) -> Mesh:
    """The union of closed bodies."""
    return Mesh.from_trimesh(trimesh.boolean.union(list(bodies), engine="manifold"))


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    """The box between two corners."""
    return trimesh.creation.box(bounds=[low, high])


def level(height: float) -> Floats:
    """The plane z = height."""
    return np.array([0.0, 0.0, height, 0.0, 0.0, 1.0])


def between(mesh: Mesh, low: Floats | float, high: Floats | float) -> tuple[Section, Section]:
    """The sections of a layer: of two planes (6,) or heights."""
    planes = [level(plane) if isinstance(plane, float) else plane for plane in (low, high)]
    return slice_mesh(mesh, planes[0], "above")[0], slice_mesh(mesh, planes[1], "below")[0]


def walls_between(mesh: Mesh, low: Floats | float, high: Floats | float) -> LayerWalls:
    """The walls between two planes or heights."""
    return layer_walls(mesh, *between(mesh, low, high))


def divided_between(mesh: Mesh, low: float, high: float) -> tuple[LayerWalls, ...]:
    """The same with planes put in between where the surface asks."""
    return divided_walls(mesh, *between(mesh, low, high))


def area_at(walls: LayerWalls, share: float) -> float:
    """Area, mm², that the rings of a layer between level planes enclose at a share of its height."""
    total = 0.0
    for wall in walls.walls:
        u = np.linspace(0.0, 1.0, 4001)[:-1]
        points = wall.surface.evaluate(u, share)
        x, y = points[:, 0], points[:, 1]
        total += 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    return total
