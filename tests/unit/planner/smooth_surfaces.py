"""Meshes of known surfaces, and how far points in a plane lie from the true section."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.mesh.weld import unique_vertices
from planner.slicing import slice_mesh
from planner.slicing.section import Loop, Section

Floats = NDArray[np.float64]
Field = Callable[[Floats], Floats]

RADIUS, RING, TUBE, HEIGHT = 20.0, 20.0, 8.0, 30.0  # mm: sphere, cylinder and cone; torus; cylinder and cone
_STEP = 1e-5  # mm, of the central differences
SHARES = np.array([0.031, 0.11, 0.23, 0.37, 0.5, 0.613, 0.77, 0.97])
"""Of the mesh's extent along the direction, where it is cut: near both ends, and through the middle."""
DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "upright": (0.0, 0.0, 1.0),
    "30 degrees": (0.5, 0.0, 0.75**0.5),
    "tilted": (1.0, 2.0, 3.0),
    "steep": (0.3, -0.7, 0.2),
    "lying": (1.0, 0.0, 0.0),
}


@dataclass(frozen=True)
class Shape:
    """A mesh and the signed distance field (to first order) of the surface that it stands for."""

    mesh: Mesh
    field: Field


def grid(point: Callable[[float, float], tuple[float, float, float]], around: int, rows: int, is_ring: bool) -> Mesh:
    """Quads split by diagonals over (angle, 0 … 1); a ring closes the second way too."""
    lines = rows if is_ring else rows + 1
    angle = 2.0 * np.pi * np.arange(around) / around
    vertices = np.array([point(float(u), j / rows) for j in range(lines) for u in angle])
    facets = []
    for j in range(rows):
        for i in range(around):
            a, b = j * around + i, j * around + (i + 1) % around
            d, c = ((j + 1) % lines) * around + i, ((j + 1) % lines) * around + (i + 1) % around
            facets += [(a, b, c), (a, c, d)]
    merged, number = unique_vertices(np.round(vertices, 12))
    corners = number[np.array(facets)]
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    return Mesh(merged, corners[whole])


def capped(mesh: Mesh, heights: tuple[float, ...]) -> Mesh:
    """The mesh with its open rims closed by fans around points of the axis at these heights, mm."""
    facets = [tuple(facet) for facet in mesh.facets.tolist()]
    for f, k in np.argwhere(mesh.adjacency < 0):
        a, b = int(mesh.facets[f, k]), int(mesh.facets[f, (k + 1) % 3])
        nearest = int(np.argmin([abs(z - mesh.vertices[a, 2]) for z in heights]))
        facets.append((b, a, len(mesh.vertices) + nearest))
    centres = np.array([(0.0, 0.0, z) for z in heights])
    return Mesh(np.vstack([mesh.vertices, centres]), np.array(facets))


def sphere_of_meridians(around: int = 48, rows: int = 24) -> Shape:
    """A UV sphere."""

    def point(u: float, v: float) -> tuple[float, float, float]:
        ring = RADIUS * np.sin(np.pi * v)
        return ring * np.cos(u), ring * np.sin(u), -RADIUS * np.cos(np.pi * v)

    return Shape(grid(point, around, rows, False), lambda p: np.linalg.norm(p, axis=1) - RADIUS)


def icosphere(subdivisions: int) -> Shape:
    """An icosahedron refined on the sphere."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions, radius=RADIUS)
    return Shape(Mesh.from_trimesh(made), lambda p: np.linalg.norm(p, axis=1) - RADIUS)


def torus(around: int = 48, rows: int = 24) -> Shape:
    """A ring with so many facets around the axis and around the tube."""

    def point(u: float, v: float) -> tuple[float, float, float]:
        out = RING + TUBE * np.cos(2.0 * np.pi * v)
        return out * np.cos(u), out * np.sin(u), TUBE * np.sin(2.0 * np.pi * v)

    return Shape(grid(point, around, rows, True), lambda p: np.hypot(np.hypot(p[:, 0], p[:, 1]) - RING, p[:, 2]) - TUBE)


def cylinder(rows: int = 1) -> Shape:
    """48 sides, each cut by diagonals, with both caps."""
    wall = grid(lambda u, v: (RADIUS * np.cos(u), RADIUS * np.sin(u), HEIGHT * v), 48, rows, False)
    return Shape(
        capped(wall, (0.0, HEIGHT)),
        lambda p: np.maximum(np.hypot(p[:, 0], p[:, 1]) - RADIUS, np.abs(p[:, 2] - 0.5 * HEIGHT) - 0.5 * HEIGHT),
    )


def cone(rows: int = 1) -> Shape:
    """48 sides, with its base."""
    wall = grid(lambda u, v: (RADIUS * (1 - v) * np.cos(u), RADIUS * (1 - v) * np.sin(u), HEIGHT * v), 48, rows, False)
    slant = float(np.hypot(RADIUS, HEIGHT))

    def field(p: Floats) -> Floats:
        side = (np.hypot(p[:, 0], p[:, 1]) - RADIUS * (1.0 - p[:, 2] / HEIGHT)) * HEIGHT / slant
        return np.maximum(side, -p[:, 2])

    return Shape(capped(wall, (0.0,)), field)


SHAPES: dict[str, Callable[[], Shape]] = {
    "sphere UV 48x24": sphere_of_meridians,
    "icosphere 3": lambda: icosphere(3),
    "icosphere 4": lambda: icosphere(4),
    "torus 48x24": torus,
    "cylinder 48": cylinder,
    "cylinder 48 in 7 rows": lambda: cylinder(7),
    "cone 48": cone,
    "cone 48 in 5 rows": lambda: cone(5),
}


def prism(outline: Floats, height: float = 10.0) -> Mesh:
    """A star-shaped outline (n, 2), mm, counter-clockwise about the origin, between z = 0 and the height."""
    count = len(outline)
    low = np.column_stack([outline, np.zeros(count)])
    vertices = np.vstack([low, low + np.array([0.0, 0.0, height]), [[0.0, 0.0, 0.0], [0.0, 0.0, height]]])
    facets = []
    for i in range(count):
        j = (i + 1) % count
        facets += [(i, j, count + j), (i, count + j, count + i)]
        facets += [(j, i, 2 * count), (count + i, count + j, 2 * count + 1)]
    return Mesh(vertices, np.array(facets))


def gear_outline(teeth: int = 12, root_mm: float = 16.0, tip_mm: float = 20.0) -> Floats:
    """Straight flanks: four corners a tooth; (4 · teeth, 2) float, mm."""
    step = 2.0 * np.pi / teeth
    angle = (np.arange(teeth)[:, None] * step + np.array([0.0, 0.15, 0.35, 0.5]) * step).ravel()
    radius = np.tile([root_mm, tip_mm, tip_mm, root_mm], teeth)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def direction(name: str) -> Floats:
    """Unit vector of DIRECTIONS."""
    vector = np.array(DIRECTIONS[name])
    return np.asarray(vector / np.linalg.norm(vector))


def sections_across(mesh: Mesh, normal: Floats) -> list[Section]:
    """The mesh cut at SHARES of its extent along the normal."""
    height = mesh.vertices @ normal
    levels = height.min() + (height.max() - height.min()) * SHARES
    return slice_mesh(mesh, np.array([np.concatenate([level * normal, normal]) for level in levels]))


def in_plane_distance(field: Field, points: Floats, normal: Floats) -> Floats:
    """Distance of points from the true section within their plane, to first order: (n,) float, mm."""
    return np.asarray(np.abs(field(points)) / _slope(field, points, normal)[1])


def true_points(field: Field, points: Floats, normal: Floats) -> Floats:
    """The points moved within their plane onto the true section, by Newton: (n, 3) float, mm."""
    moved = points.copy()
    for _ in range(8):
        slope, size = _slope(field, moved, normal)
        moved = moved - (field(moved) / size**2)[:, None] * slope
    return moved


def _slope(field: Field, points: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Gradient of the field within the plane (n, 3), and its length (n,), at least 0.001."""
    slope = np.stack(
        [(field(points + _STEP * e) - field(points - _STEP * e)) / (2.0 * _STEP) for e in np.eye(3)], axis=1
    )
    slope -= (slope @ normal)[:, None] * normal
    return slope, np.maximum(np.linalg.norm(slope, axis=1), 1e-3)


def along(loop: Loop, steps: int) -> Floats:
    """Points along the sides of a loop: (steps · n, 3) float, mm."""
    sides = np.roll(loop.points, -1, axis=0) - loop.points
    return np.concatenate([loop.points + share * sides for share in np.arange(steps) / steps])
