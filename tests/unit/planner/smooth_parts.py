"""Meshes of parts with fillets, waves and ellipses, and the signed distance fields (to first order) they stand for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.mesh.weld import unique_vertices
from tests.unit.planner.smooth_surfaces import Shape, capped, grid, prism

Floats = NDArray[np.float64]


def revolved(radii: Callable[[Floats], Floats], height: float, around: int, rows: int) -> Shape:
    """A body of revolution of radii(0 … 1) between z = 0 and height, with plane ends."""

    def point(u: float, v: float) -> tuple[float, float, float]:
        ring = float(radii(np.array([v]))[0])
        return ring * np.cos(u), ring * np.sin(u), height * v

    def field(p: Floats) -> Floats:
        share, step = p[:, 2] / height, 1e-6
        slope = (radii(share + step) - radii(share - step)) / (2.0 * step * height)
        side = (np.hypot(p[:, 0], p[:, 1]) - radii(share)) / np.hypot(1.0, slope)
        return np.asarray(np.maximum(side, np.maximum(-p[:, 2], p[:, 2] - height)))

    return Shape(capped(grid(point, around, rows, False), (0.0, height)), field)


def vase(around: int, rows: int) -> Shape:
    """A waist and a belly."""
    return revolved(lambda v: 15.0 + 5.0 * np.sin(8.0 * v) + 2.0 * v, 60.0, around, rows)


def hyperboloid(around: int, rows: int) -> Shape:
    """One sheet, waist 8 mm."""
    return revolved(lambda v: 8.0 * np.hypot(1.0, (40.0 * v - 20.0) / 12.0), 40.0, around, rows)


def ellipsoid(around: int, rows: int) -> Shape:
    """Half axes 30, 20 and 10 mm, by meridians."""
    axes = np.array([30.0, 20.0, 10.0])

    def point(u: float, v: float) -> tuple[float, float, float]:
        x, y, z = axes * (np.sin(np.pi * v) * np.cos(u), np.sin(np.pi * v) * np.sin(u), -np.cos(np.pi * v))
        return float(x), float(y), float(z)

    def field(p: Floats) -> Floats:
        scaled = p / axes
        size = np.linalg.norm(scaled, axis=1)
        return np.asarray((size - 1.0) * size / np.linalg.norm(scaled / axes, axis=1))

    return Shape(grid(point, around, rows, False), field)


def round_ellipsoid(subdivisions: int) -> Shape:
    """The same from an icosphere: no vertex like another."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0).apply_scale((30.0, 20.0, 10.0))
    return Shape(Mesh.from_trimesh(made), ellipsoid(4, 4).field)


def filleted_cylinder(around: int, steps: int) -> Shape:
    """R 20, 40 mm high, edges rounded with 3 mm in so many steps; one row of long strips between."""
    outer, fillet, height = 20.0, 3.0, 40.0
    turn = np.linspace(0.0, 0.5 * np.pi, steps + 1)
    low = np.column_stack([outer - fillet + fillet * np.sin(turn), fillet - fillet * np.cos(turn)])
    profile = np.vstack([low, low[::-1] * (1.0, -1.0) + (0.0, height)])

    def point(u: float, v: float) -> tuple[float, float, float]:
        ring, z = profile[round(v * (len(profile) - 1))]
        return ring * np.cos(u), ring * np.sin(u), z

    def field(p: Floats) -> Floats:
        a = np.hypot(p[:, 0], p[:, 1]) - (outer - fillet)
        b = np.abs(p[:, 2] - 0.5 * height) - (0.5 * height - fillet)
        return np.asarray(np.hypot(np.maximum(a, 0), np.maximum(b, 0)) + np.minimum(np.maximum(a, b), 0) - fillet)

    return Shape(capped(grid(point, around, len(profile) - 1, False), (0.0, height)), field)


def rounded_box(steps: int) -> Shape:
    """24 x 18 x 12 mm, edges and corners rounded with 4 mm in so many steps: a sphere whose octants stand apart."""
    half, fillet = np.array([12.0, 9.0, 6.0]), 4.0
    quarter = np.linspace(0.0, 0.5 * np.pi, steps + 1)
    u = np.concatenate([quarter + 0.5 * np.pi * k for k in range(4)])
    side = np.repeat([[1, 1], [-1, 1], [-1, -1], [1, -1]], steps + 1, axis=0)
    v, end = np.concatenate([quarter, quarter + 0.5 * np.pi]), np.repeat([-1, 1], steps + 1)

    def point(angle: float, share: float) -> tuple[float, float, float]:
        i, j = round(angle / (2.0 * np.pi) * len(u)) % len(u), round(share * (len(v) - 1))
        ring = fillet * np.sin(v[j])
        x, y = (half[:2] - fillet) * side[i] + ring * np.array([np.cos(u[i]), np.sin(u[i])])
        return float(x), float(y), float(end[j] * (half[2] - fillet) - fillet * np.cos(v[j]))

    def field(p: Floats) -> Floats:
        q = np.abs(p) - (half - fillet)
        return np.asarray(np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - fillet)

    wall = capped(grid(point, len(u), len(v) - 1, False), (-half[2], half[2]))
    vertices, number = unique_vertices(np.round(wall.vertices, 12))
    corners = number[wall.facets]
    return Shape(Mesh(vertices, corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]), field)


def stadium(steps: int) -> Shape:
    """A prism over two half circles of 4 mm joined by straight sides of 20 mm."""
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, steps + 1)
    right = np.column_stack([10.0 + 4.0 * np.cos(turn), 4.0 * np.sin(turn)])

    def field(p: Floats) -> Floats:
        side = np.hypot(np.maximum(np.abs(p[:, 0]) - 10.0, 0.0), p[:, 1]) - 4.0
        return np.asarray(np.maximum(side, np.abs(p[:, 2] - 5.0) - 5.0))

    return Shape(prism(np.vstack([right, -right])), field)
