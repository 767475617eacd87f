"""Where one member of a part meets another: connected lines of edges that bend inwards, and planes through their ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_BEND_DEG = 20.0  # edges that bend inwards by less belong to smooth walls
_RISE = 1e-5  # of the part's size, by which a facet must rise over its neighbour
_LEAST_WIDTH = 3e-5  # of the part's size: thinner facets have no direction of their own in 32-bit coordinates
_TOGETHER = 0.01  # of the part's size: ends of inward edges that are nearer belong to one seam
_MOST_SEAMS = 24  # the longest; parts with more are told apart by these
_STRAIGHT = 1e-3  # of its length: a seam that leaves its line by less has no plane of its own


@dataclass(frozen=True, eq=False)
class Seam:
    """A connected line of inward edges.

    points : (k, 3) float, mm   normal : (3,) float, unit, of the plane through it; None where it is straight
    """

    points: Floats
    normal: Floats | None


def seams(mesh: Mesh) -> list[Seam]:
    """The longest seams of a closed mesh, longest first; seams of one length by place."""
    tail, head = _inward_edges(mesh)
    if not len(tail):
        return []
    used, local = np.unique(np.concatenate([tail, head]), return_inverse=True)
    start, end = np.split(local.reshape(-1), 2)
    near = cKDTree(mesh.vertices[used]).query_pairs(_TOGETHER * mesh.diagonal, output_type="ndarray").astype(np.int64)
    first, second = np.concatenate([start, near[:, 0]]), np.concatenate([end, near[:, 1]])
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(used), len(used)))
    count, label = connected_components(graph, directed=False)
    lengths = np.linalg.norm(mesh.vertices[tail] - mesh.vertices[head], axis=1)
    length = np.bincount(label[start], weights=lengths, minlength=count)
    found = [(round(float(length[n]), 3), mesh.vertices[used[label == n]]) for n in range(count)]
    found.sort(key=lambda seam: (-seam[0], tuple(np.round(seam[1].mean(axis=0), 3).tolist())))
    return [Seam(points, _normal(points)) for _, points in found[:_MOST_SEAMS]]


def _inward_edges(mesh: Mesh) -> tuple[Ints, Ints]:
    """Both ends of the edges that bend inwards, each edge once: (k,) int each."""
    mate = mesh.across.reshape(-1, 3).astype(np.int64)
    own = np.arange(3 * len(mesh.facets)).reshape(-1, 3)
    row, slot = np.nonzero(mate > own)
    other = mate[row, slot]
    normal, across = mesh.normals[row], mesh.normals[other // 3]
    bends = (normal * across).sum(axis=1) < np.cos(np.radians(_BEND_DEG))
    opposite = mesh.vertices[mesh.facets[other // 3, (other % 3 + 2) % 3]]
    rises = ((opposite - mesh.vertices[mesh.facets[row, slot]]) * normal).sum(axis=1) > _RISE * mesh.diagonal
    longest = np.linalg.norm(np.roll(mesh.corners, -1, axis=1) - mesh.corners, axis=2).max(axis=1)
    is_broad = 2.0 * mesh.areas > _LEAST_WIDTH * mesh.diagonal * longest
    kept = bends & rises & is_broad[row] & is_broad[other // 3]
    return mesh.facets[row, slot][kept], mesh.facets[row, (slot + 1) % 3][kept]


def _normal(points: Floats) -> Floats | None:
    centred = points - points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    if len(sizes) < 3 or sizes[1] <= _STRAIGHT * sizes[0]:
        return None
    normal: Floats = axes[2]
    lead = int(np.argmax(np.abs(np.round(normal, 6))))
    return np.asarray(normal * np.sign(normal[lead]))
