"""The part as it should be: exact signed distance to its mesh at any points and on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.process.facet_tree import close_distances, facet_tree, signed_distances
from sim.process.field import Field
from sim.process.part_field import part_field

Array = NDArray[np.float64]

BALL_SPACINGS = 8.0  # of a surface's vertices: facets are gathered for places so far apart
SEED = 20  # of the surface samples; fixed, so that the same part gives the same figures


class Target:
    """A closed triangle mesh in the build frame.

    vertices : (n, 3) float, mm
    facets : (m, 3) int
    spacing_mm : distance of surface samples, which are spread over it uniformly by area
    """

    def __init__(self, vertices: Array, facets: NDArray[np.int64], spacing_mm: float) -> None:
        self.vertices = np.ascontiguousarray(vertices, dtype=float)
        self.facets = np.ascontiguousarray(facets, dtype=np.int64)
        self.corners: Array = self.vertices[self.facets]
        cross = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        double_area = np.linalg.norm(cross, axis=1)
        self.areas: Array = 0.5 * double_area
        self.normals: Array = cross / np.maximum(double_area, 1e-300)[:, None]
        self.samples, self.sample_facets = self._sample(spacing_mm)
        self.tree = facet_tree(self.corners)

    @property
    def bounds(self) -> Array:
        """(2, 3) float, mm."""
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def volume_mm3(self) -> float:
        """Enclosed volume by the divergence theorem."""
        a, b, c = self.corners[:, 0], self.corners[:, 1], self.corners[:, 2]
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)

    def _sample(self, spacing_mm: float) -> tuple[Array, NDArray[np.int64]]:
        """Points spread over the surface by area: (k, 3) mm and their facets (k,)."""
        wanted = int(np.ceil(self.areas.sum() / spacing_mm**2))
        random = np.random.default_rng(SEED)
        edges = np.concatenate([[0.0], np.cumsum(self.areas)])
        at = (np.arange(wanted) + 0.5) / wanted * edges[-1]
        facets = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, len(self.facets) - 1)
        u, v = random.random((2, wanted))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        a, b, c = (self.corners[facets, i] for i in range(3))
        return a + u[:, None] * (b - a) + v[:, None] * (c - a), facets

    def signed_distance(self, points: Array) -> Array:
        """Distance to the surface, mm, negative inside, exact. points : (n, 3) float, mm -> (n,) float"""
        distance, _ = signed_distances(self.tree, np.ascontiguousarray(points, dtype=np.float64))
        return np.asarray(distance)

    def surface_distance(self, vertices: Array, spacing_mm: float) -> Array:
        """The same for the vertices of a surface, most of which follow one another at `spacing_mm`: faster. vertices : (n, 3) float, mm"""
        return np.asarray(close_distances(self.tree, np.ascontiguousarray(vertices, dtype=np.float64), BALL_SPACINGS * spacing_mm))

    def field_on(self, origin: Array, cell_mm: float, band_mm: float, cells: tuple[int, ...] | NDArray[np.int64]) -> Field:
        """Sparse signed distance on a grid of `cells` with the centre of its first cell at `origin`, exact within the band, mm."""
        return part_field(self.tree, origin, cell_mm, band_mm, cells)
