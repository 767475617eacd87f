"""Parts whose centroidal axis is known: sweeps of a circle along a curve, limbs of cylinders, and rough copies of them."""

from __future__ import annotations

from collections.abc import Sequence

import manifold3d
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]


def swept(points: ArrayLike, radius_mm: ArrayLike, around: int = 48, ends: ArrayLike | None = None) -> Mesh:
    """A tube filled along a polyline (k, 3): a circle (one radius or one a point) square on it, carried without twist;
    ends : (2, 3), directions at its ends."""
    way = np.asarray(points, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radius_mm, dtype=np.float64), (len(way),))
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    along = CubicSpline(lengths, way)(lengths, 1) if len(way) > 3 else np.gradient(way, axis=0)
    if ends is not None:
        along[[0, -1]] = ends
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along[0], np.eye(3)[int(np.argmin(np.abs(along[0])))])
    rings, turn = [], np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    for centre, axis, radius in zip(way, along, radii, strict=True):
        side = side - axis * (side @ axis)
        side /= np.linalg.norm(side)
        other = np.cross(axis, side)
        rings.append(centre + radius * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other))
    vertices = np.vstack([*rings, way[:1], way[-1:]])
    i = np.arange(around)
    j = (i + 1) % around
    facets = [np.column_stack([np.full(around, len(vertices) - 2), j, i])]
    for k in range(len(way) - 1):
        a, b = k * around, (k + 1) * around
        facets += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    last = (len(way) - 1) * around
    facets.append(np.column_stack([np.full(around, len(vertices) - 1), last + i, last + j]))
    return Mesh(vertices, np.vstack(facets))


def arc(radius_mm: float, turn_deg: float = 90.0, steps: int = 40) -> Floats:
    """(k, 3) float, mm   From the origin upward, bending towards +x about an axis along y."""
    turn = np.radians(np.linspace(0.0, turn_deg, steps + 1))
    return np.column_stack([radius_mm * (1.0 - np.cos(turn)), np.zeros(len(turn)), radius_mm * np.sin(turn)])


def bend(radius_mm: float, radius: float, turn_deg: float = 90.0, steps: int = 40) -> Mesh:
    """Part of a torus from the base plane z = 0 on."""
    turn = np.radians(turn_deg)
    return swept(arc(radius_mm, turn_deg, steps), radius, ends=[(0, 0, 1), (np.sin(turn), 0, np.cos(turn))])


def straight(start: ArrayLike, end: ArrayLike, radius_mm: float, around: int = 48) -> Mesh:
    """A cylinder between two points."""
    return swept(np.array([start, end], dtype=np.float64), radius_mm, around)


def solid(mesh: Mesh) -> manifold3d.Manifold:
    """The mesh for booleans."""
    made = manifold3d.Manifold(
        manifold3d.Mesh64(vert_properties=np.array(mesh.vertices), tri_verts=mesh.facets.astype(np.uint64))
    )
    assert made.status() == manifold3d.Error.NoError
    return made


def meshed(body: manifold3d.Manifold) -> Mesh:
    """Back to a mesh."""
    out = body.to_mesh64()
    return Mesh(np.asarray(out.vert_properties)[:, :3], np.asarray(out.tri_verts).astype(np.int64))


def united(parts: Sequence[Mesh]) -> Mesh:
    """One body of several."""
    body = solid(parts[0])
    for part in parts[1:]:
        body = body + solid(part)
    return meshed(body)


def without(part: Mesh, taken: Sequence[Mesh]) -> Mesh:
    """The part less some bodies."""
    body = solid(part)
    for other in taken:
        body = body - solid(other)
    return meshed(body)


def boxed(low: ArrayLike, high: ArrayLike) -> Mesh:
    """A box between two corners."""
    size = np.asarray(high, dtype=np.float64) - np.asarray(low, dtype=np.float64)
    return meshed(manifold3d.Manifold.cube(size.tolist()).translate(np.asarray(low, dtype=np.float64).tolist()))


def finer(mesh: Mesh, length_mm: float) -> Mesh:
    """The same surface in smaller facets."""
    return meshed(solid(mesh).refine_to_length(length_mm))


def rough(mesh: Mesh, depth_mm: float, seed: int = 1) -> Mesh:
    """Every vertex moved by a little."""
    shift = np.random.default_rng(seed).normal(0.0, depth_mm, mesh.vertices.shape)
    return Mesh(mesh.vertices + shift, mesh.facets)


def above(mesh: Mesh, plane: ArrayLike) -> list[Mesh]:
    """Bodies of what lies on the side of a plane's normal, by their centres' x."""
    values = np.asarray(plane, dtype=np.float64)
    upper, _ = solid(mesh).split_by_plane(values[3:].tolist(), float(values[:3] @ values[3:]))
    return sorted((meshed(body) for body in upper.decompose()), key=lambda part: float(part.vertices[:, 0].mean()))
