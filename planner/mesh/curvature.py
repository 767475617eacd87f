"""How the surface that the facets stand for bends at each facet: the curvature tensor from the normals of its corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

_SLIVER = 1e-6
"""Breadth of a facet, as a share of its length, below which its edges tell nothing across it: rounding of 32-bit STLs."""


def facet_curvatures(mesh: Mesh, normals: ArrayLike) -> Floats:
    """Symmetric curvature tensor K of each facet: v·K·v is the normal curvature along a unit vector v of its plane.

    normals : (m, 3, 3) float   unit normal at each corner of each facet, as from `planner.mesh.crease.corner_normals`
    Returns (m, 3, 3) float, 1/mm, > 0 where the body is convex; K·n = 0. Facets without area have K = 0.

    Along each edge e the normal turns by K·e: the tensor is the least-squares fit to the three edges, exact where the
    corner normals are those of a sphere or a cylinder. In the principal frame of the edges its three unknowns part.
    Raises InputError if the normals have another shape.
    Source: Rusinkiewicz, "Estimating curvatures and their derivatives on triangle meshes", 3DPVT 2004, section 3.
    """
    corner = np.asarray(normals, dtype=np.float64)
    if corner.shape != (len(mesh.facets), 3, 3):
        raise InputError(f"corner normals must be ({len(mesh.facets)}, 3, 3), not {corner.shape}", "see corner_normals")
    edges = np.roll(mesh.corners, -1, axis=1) - mesh.corners
    turns = np.roll(corner, -1, axis=1) - corner
    along, across = _edge_frames(edges, mesh.normals)
    a, b = np.einsum("mij,mj->mi", edges, along), np.einsum("mij,mj->mi", edges, across)
    turn_a, turn_b = np.einsum("mij,mj->mi", turns, along), np.einsum("mij,mj->mi", turns, across)
    length, breadth = (a**2).sum(axis=1), (b**2).sum(axis=1)
    is_broad = breadth > _SLIVER**2 * length
    k_aa = _share((a * turn_a).sum(axis=1), length, is_broad)
    k_bb = _share((b * turn_b).sum(axis=1), breadth, is_broad)
    k_ab = _share((b * turn_a + a * turn_b).sum(axis=1), length + breadth, is_broad)
    mixed = along[:, :, None] * across[:, None, :]
    return np.asarray(
        k_aa * along[:, :, None] * along[:, None, :]
        + k_ab * (mixed + mixed.transpose(0, 2, 1))
        + k_bb * across[:, :, None] * across[:, None, :]
    )


def normal_curvatures(tensors: Floats, directions: Floats) -> Floats:
    """v·K·v per facet.  tensors : (m, 3, 3) float, 1/mm;  directions : (m, 3) float, unit.  Returns (m,) float, 1/mm."""
    return np.asarray(np.einsum("mi,mij,mj->m", directions, tensors, directions))


def _share(amount: Floats, whole: Floats, where: NDArray[np.bool_]) -> Floats:
    """amount / whole as (m, 1, 1) float, 0 elsewhere."""
    return np.divide(amount, whole, out=np.zeros_like(amount), where=where)[:, None, None]


def _edge_frames(edges: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Unit vectors (m, 3) in the plane of each facet along which the edges spread most and least."""
    longest = edges[np.arange(len(edges)), np.argmax((edges**2).sum(axis=2), axis=1)]
    norm = np.linalg.norm(longest, axis=1, keepdims=True)
    u = np.divide(longest, norm, out=np.zeros_like(longest), where=norm > 0.0)
    v = np.cross(normals, u)
    p, q = np.einsum("mij,mj->mi", edges, u), np.einsum("mij,mj->mi", edges, v)
    angle = 0.5 * np.arctan2(2.0 * (p * q).sum(axis=1), (p**2).sum(axis=1) - (q**2).sum(axis=1))[:, None]
    along = np.cos(angle) * u + np.sin(angle) * v
    return along, np.cross(normals, along)
