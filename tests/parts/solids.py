"""Solids to build parts of: boxes, bars, revolved and swept profiles, joined by exact booleans; the same input gives the same mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from manifold3d import CrossSection, Manifold
from numpy.typing import ArrayLike, NDArray

from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Profile = Sequence[tuple[float, float]]


def box(low: Sequence[float], high: Sequence[float]) -> Manifold:
    """Axis-parallel box.  low, high : (3,) float, mm"""
    size = np.subtract(high, low)
    return Manifold.cube([float(value) for value in size]).translate([float(value) for value in low])


def bar(start: ArrayLike, end: ArrayLike, radius: float, segments: int) -> Manifold:
    """Round bar between two points, its ends flat and square to it.  start, end : (3,) float, mm"""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    upright = Manifold.cylinder(length, radius, circular_segments=segments)
    return upright.transform(np.column_stack([frame_along((b - a) / length), a]))


def ball(centre: ArrayLike, radius: float, segments: int) -> Manifold:
    """Ball.  centre : (3,) float, mm"""
    return Manifold.sphere(radius, circular_segments=segments).translate([float(value) for value in np.asarray(centre)])


def frame_along(direction: Floats) -> Floats:
    """(3, 3) float   rotation whose z is the direction; x lies in the plane of direction and z where there is one."""
    side = np.cross([0.0, 0.0, 1.0], direction)
    length = float(np.linalg.norm(side))
    if length < 1e-12:
        return np.diag([1.0, np.sign(direction[2]), np.sign(direction[2])])
    y = side / length
    return np.column_stack([np.cross(y, direction), y, direction])


def revolved(profile: Profile, segments: int, degrees: float = 360.0) -> Manifold:
    """Closed profile turned about z.  profile : (r, z) of its corners, mm, counter-clockwise"""
    return CrossSection([list(profile)]).revolve(segments, degrees)


def twisted(width: float, thickness: float, length: float, degrees: float, steps: int) -> Manifold:
    """Blade that grows along x from the origin, turning about it: at x = 0 it stands upright (width along z).

    steps : sections along its length; between them it is ruled
    """
    section = CrossSection.square([width, thickness], center=True)
    grown = section.extrude(length, steps, degrees)
    return grown.transform(np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]]))


def mesh_from(solid: Manifold) -> Mesh:
    """The solid's surface, vertices and facets in an order that depends on their places alone."""
    made = solid.to_mesh64()
    vertices = np.asarray(made.vert_properties, dtype=np.float64)[:, :3]
    facets = np.asarray(made.tri_verts, dtype=np.int64)
    order = np.lexsort(vertices.T[::-1])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    named = rank[facets]
    first = np.argmin(named, axis=1)
    turned = np.take_along_axis(named, (first[:, None] + np.arange(3)) % 3, axis=1)
    return Mesh(vertices[order], turned[np.lexsort(turned.T[::-1])])
