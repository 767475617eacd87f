"""How far two closed surfaces lie from each other, both ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SPACING_FRACTION = 1.0 / 100.0
"""Of the smaller diagonal: how far apart samples on a facet are at most, up to MOST_PARTS in a side."""
MOST_PARTS = 24
"""Parts of a facet's side at most."""


@dataclass(frozen=True)
class ModelDeviation:
    """Distances between a model and the mesh that it stands for, mm.

    max_mm : greatest of both ways     mean_mm, p99_mm : of both ways together, weighted by area
    model_to_mesh_mm, mesh_to_model_mm : the greatest of each way
    volume_error : (model - mesh) / mesh     samples : points measured
    place : (3,) float, mm, where the greatest was found
    """

    max_mm: float
    mean_mm: float
    p99_mm: float
    model_to_mesh_mm: float
    mesh_to_model_mm: float
    volume_error: float
    samples: int
    place: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Distances:
    """Of samples of one mesh from another: points (n, 3) mm, facets (n,), areas they stand for (n,) mm², distance (n,) mm."""

    points: Floats
    facets: Ints
    areas: Floats
    distance_mm: Floats


def distances_between(source: Mesh, target: Mesh, tree: FacetTree | None = None) -> Distances:
    """Exact distances of samples of one mesh, vertices among them, from another.

    Every facet is sampled on an even lattice that holds its corners.  tree : of the target, if there is one already.
    """
    spacing = SPACING_FRACTION * min(source.diagonal, target.diagonal)
    points, facets, areas = lattice(source.corners, source.areas, spacing, MOST_PARTS)
    return Distances(points, facets, areas, (tree or FacetTree(target)).nearest(points)[0])


def two_way(model: Mesh, mesh: Mesh, tree: FacetTree | None = None) -> ModelDeviation:
    """The deviation of a model from the mesh.  tree : of the mesh, if there is one already.

    Distances are exact at the samples; between them they are greater by less than half the samples' spacing.
    """
    ways = (distances_between(model, mesh, tree), distances_between(mesh, model))
    distance = np.concatenate([way.distance_mm for way in ways])
    areas = np.concatenate([way.areas for way in ways])
    order = np.argsort(distance, kind="stable")
    covered = np.cumsum(areas[order])
    rank = int(np.searchsorted(covered, 0.99 * covered[-1]))
    worst = int(np.argmax(distance))
    x, y, z = np.concatenate([way.points for way in ways])[worst].tolist()
    return ModelDeviation(
        max_mm=float(distance[worst]),
        mean_mm=float((distance * areas).sum() / areas.sum()),
        p99_mm=float(distance[order[min(rank, len(order) - 1)]]),
        model_to_mesh_mm=float(ways[0].distance_mm.max()),
        mesh_to_model_mm=float(ways[1].distance_mm.max()),
        volume_error=float(model.volume / mesh.volume - 1.0),
        samples=len(distance),
        place=(x, y, z),
    )


@njit(cache=True)
def lattice(
    corners: Floats, area: Floats, spacing: float, most: int
) -> tuple[Floats, Ints, Floats]:  # pragma: no cover
    """Points (n, 3) on an even lattice of each triangle, its number and the area that it stands for, (n,) each.

    corners : (m, 3, 3) float, mm;  area : (m,) mm²;  spacing : mm;  most : parts of the longest side at most
    """
    parts = np.empty(corners.shape[0], np.int64)
    total = 0
    for f in range(corners.shape[0]):
        longest = 0.0
        for k in range(3):
            square = 0.0
            for axis in range(3):
                square += (corners[f, k, axis] - corners[f, (k + 1) % 3, axis]) ** 2
            longest = max(longest, square)
        parts[f] = min(max(int(np.ceil(np.sqrt(longest) / spacing)), 1), most)
        total += (parts[f] + 1) * (parts[f] + 2) // 2
    points, facets, areas = np.empty((total, 3)), np.empty(total, np.int64), np.empty(total)
    row = 0
    for f in range(corners.shape[0]):
        n = parts[f]
        share = area[f] / ((n + 1) * (n + 2) // 2)
        for i in range(n + 1):
            for j in range(n + 1 - i):
                a, b = i / n, j / n
                for axis in range(3):
                    base = corners[f, 0, axis]
                    points[row, axis] = base + a * (corners[f, 1, axis] - base) + b * (corners[f, 2, axis] - base)
                facets[row], areas[row] = f, share
                row += 1
    return points, facets, areas
