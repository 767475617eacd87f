"""The triangle mesh that everything else is planned from: millimetres, facets counter-clockwise from outside."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from planner.errors import MeshError
from planner.mesh import adjacency as half_edges
from planner.mesh import facets as kernels
from planner.mesh.weld import unique_vertices

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh, never changed after it was made.

    vertices : (n, 3) float64, mm
    facets   : (m, 3) int64   vertex numbers, counter-clockwise seen from outside
    Raises MeshError if the arrays have another shape, a coordinate is not finite or a facet names a missing vertex.
    """

    vertices: Floats
    facets: Ints

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float64, order="C")
        facets = np.array(self.facets, dtype=np.int64, order="C")
        if vertices.ndim != 2 or vertices.shape[1] != 3 or facets.ndim != 2 or facets.shape[1] != 3:
            raise MeshError(
                f"a mesh needs (n, 3) vertices and (m, 3) facets, not {vertices.shape} and {facets.shape}",
                "triangulate the model before passing it on",
            )
        if not np.isfinite(vertices).all():
            bad = int(np.count_nonzero(~np.isfinite(vertices).all(axis=1)))
            raise MeshError(f"{bad} vertices of the mesh are not finite numbers", "export the model again")
        if len(facets) and (facets.min() < 0 or facets.max() >= len(vertices)):
            raise MeshError(f"a facet names a vertex outside 0 … {len(vertices) - 1}", "export the model again")
        vertices.setflags(write=False)
        facets.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "facets", facets)

    @classmethod
    def from_trimesh(cls, source: trimesh.Trimesh) -> Mesh:
        """Mesh from a `trimesh.Trimesh` in mm; vertices with equal coordinates become one if it is not closed as it is.

        Raises MeshError as the constructor does.
        """
        mesh = cls(np.asarray(source.vertices), np.asarray(source.faces))
        if len(mesh.facets) and not mesh.is_closed:
            vertices, first = unique_vertices(mesh.vertices)
            mesh = cls(vertices, first[mesh.facets])
        return mesh

    def to_trimesh(self) -> trimesh.Trimesh:
        """The same vertices and facets as a `trimesh.Trimesh`, in the same order."""
        return trimesh.Trimesh(self.vertices.copy(), self.facets.copy(), process=False)

    @cached_property
    def corners(self) -> Floats:
        """(m, 3, 3) float, mm: the three corners of each facet."""
        return np.asarray(self.vertices[self.facets])

    @cached_property
    def area_vectors(self) -> Floats:
        """(m, 3) float, mm²: outward normal times area of each facet."""
        return kernels.area_vectors_of(self.vertices, self.facets)

    @cached_property
    def areas(self) -> Floats:
        """(m,) float, mm²."""
        return kernels.lengths_of(self.area_vectors)

    @cached_property
    def normals(self) -> Floats:
        """(m, 3) float: outward unit normals; zero for a facet without area."""
        areas = self.areas[:, None]
        return np.divide(self.area_vectors, areas, out=np.zeros_like(self.area_vectors), where=areas > 0.0)

    @cached_property
    def centroids(self) -> Floats:
        """(m, 3) float, mm."""
        return kernels.centroids_of(self.vertices, self.facets)

    @cached_property
    def bounds(self) -> Floats:
        """(2, 3) float, mm: lowest and highest corner of the box around the facets. Raises MeshError if empty."""
        if not len(self.facets):
            raise MeshError("the mesh holds no facets", "export the model again")
        return kernels.bounds_of(self.vertices, self.facets)

    @cached_property
    def size(self) -> Floats:
        """(3,) float, mm: edge lengths of the box around the facets."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @cached_property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal, mm: the scale that tolerances refer to."""
        return float(np.linalg.norm(self.size))

    @cached_property
    def volume(self) -> float:
        """Enclosed volume, mm³, by the divergence theorem; negative if the mesh is inside out."""
        middle = self.bounds.mean(axis=0)
        return float(np.einsum("ij,ij->", self.centroids - middle, self.area_vectors) / 3.0)

    @cached_property
    def _half_edges(self) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
        mate, state = half_edges.pair_half_edges(self.facets, len(self.vertices))
        half_edges.pair_crowded(self.vertices, self.facets, mate, state)
        return mate, state

    @cached_property
    def across(self) -> NDArray[np.int32]:
        """(3m,) int32: the half-edge 3f + j on the other side of each; -1 where none runs the other way."""
        mate, state = self._half_edges
        return mate if self.is_closed else np.where(state == half_edges.PAIRED, mate, np.int32(-1))

    @cached_property
    def adjacency(self) -> Ints:
        """(m, 3) int64: facet across edge j (vertex j to j + 1); -1 where no facet runs the other way."""
        return (self.across // 3).astype(np.int64).reshape(-1, 3)

    @cached_property
    def half_edge_mates(self) -> Ints:
        """(3m,) int64: the other half-edge of each edge, 3f + j; -1 where there is none or more than one."""
        return self._half_edges[0].astype(np.int64)

    @cached_property
    def edge_state(self) -> NDArray[np.int8]:
        """(m, 3) int8: PAIRED, OPEN, SAME_DIRECTION or CROWDED (planner.mesh.adjacency) of each edge."""
        return self._half_edges[1].reshape(-1, 3)

    @cached_property
    def is_closed(self) -> bool:
        """Whether every edge has a facet on both sides, running in opposite directions (watertight and oriented)."""
        return bool(len(self.facets)) and bool((self.edge_state == half_edges.PAIRED).all())

    @cached_property
    def sha256(self) -> str:
        """Hex digest of the canonical bytes: counts, then vertices (float64) and facets (int64), little-endian."""
        digest = hashlib.sha256(b"mesh mm 1\n")
        digest.update(np.array([len(self.vertices), len(self.facets)], dtype="<i8").tobytes())
        digest.update((self.vertices + 0.0).astype("<f8").tobytes())
        digest.update(self.facets.astype("<i8").tobytes())
        return digest.hexdigest()

    def transformed(self, matrix: ArrayLike) -> Mesh:
        """The mesh under an affine map; facets are turned round if the map mirrors, so that outside stays outside.

        matrix : (4, 4) float   target_from_mesh, mm
        Raises MeshError if the matrix is not (4, 4), not affine or not finite.
        """
        affine = np.asarray(matrix, dtype=np.float64)
        if affine.shape != (4, 4) or not np.isfinite(affine).all() or not np.array_equal(affine[3], [0, 0, 0, 1]):
            raise MeshError("a mesh transform must be a finite (4, 4) affine matrix", "pass rotation and translation")
        facets = self.facets[:, ::-1] if np.linalg.det(affine[:3, :3]) < 0.0 else self.facets
        return Mesh(self.vertices @ affine[:3, :3].T + affine[:3, 3], facets)


def mesh_of(source: Any) -> Mesh:
    """The Mesh behind what a caller handed in: a Mesh as it is, or a `trimesh.Trimesh`.

    Raises MeshError for anything else.
    """
    if isinstance(source, Mesh):
        return source
    if isinstance(source, trimesh.Trimesh):
        return Mesh.from_trimesh(source)
    raise MeshError(f"a mesh is needed, not {type(source).__name__}", "load it with planner.mesh.load")
