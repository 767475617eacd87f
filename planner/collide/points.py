"""Obstacles as points: samples of a mesh's surface, and a tree of balls over them for many questions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import z_codes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAF = 8
"""Points in a leaf of the tree."""
_ROWS_OF_PITCH = 0.89  # a sample is at most sqrt(1 + 1/4) of the rows' distance away: 0.995 of the pitch


def surface_points(mesh: Mesh, pitch_mm: float) -> Floats:
    """Points of a mesh's surface, (n, 3) float, mm: none of the surface is farther than the pitch from one of them.

    Each facet is sampled in rows along its longest edge, ends and corners included, so that slivers get few. Facets smaller
    than the pitch give their corners. The same points in the same order for the same mesh.  Raises InputError for a pitch of
    0 or less.
    """
    if not pitch_mm > 0.0:
        raise InputError(f"points cannot lie {pitch_mm:g} mm apart", "give a pitch above 0 mm")
    corners = mesh.corners[mesh.areas > 0.0]
    if not len(corners):
        return np.empty((0, 3))
    step = _ROWS_OF_PITCH * pitch_mm
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = np.argmax(sides, axis=1)
    a, b, c = (corners[np.arange(len(corners)), (longest + k) % 3] for k in range(3))
    base = sides.max(axis=1)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / base
    rows = np.maximum(np.ceil(height / step), 1.0).astype(np.int64)
    facet, row = _runs(rows + 1)
    t = row / rows[facet]
    columns = np.maximum(np.ceil(base[facet] * (1.0 - t) / step), 1.0).astype(np.int64)
    columns[t == 1.0] = 0
    line, column = _runs(columns + 1)
    s = column / np.maximum(columns[line], 1)
    facet, t = facet[line], t[line][:, None]
    begin, end = a[facet] * (1.0 - t) + c[facet] * t, b[facet] * (1.0 - t) + c[facet] * t
    points = begin * (1.0 - s[:, None]) + end * s[:, None]
    return np.asarray(np.unique(points, axis=0))


def _runs(counts: Ints) -> tuple[Ints, Ints]:
    """Numbers 0 … count - 1 for each count, one after the other: which count each belongs to, and the number."""
    of = np.repeat(np.arange(len(counts)), counts)
    first = np.cumsum(counts) - counts
    return of, np.arange(len(of)) - first[of]


@dataclass(frozen=True, eq=False)
class PointTree:
    """Points made ready for `reach`: a complete binary tree of balls on leaves of LEAF neighbours along a Z-curve.

    points : (n, 3) float, mm, in the order of the leaves   order : (n,) int64, which of the given points each is
    balls : (2 ** d - 1, 4) float, mm, centre and radius; children of ball i are 2 i + 1 and 2 i + 2
    """

    points: Floats
    order: Ints
    balls: Floats

    @classmethod
    def over(cls, obstacles: ArrayLike) -> PointTree:
        """The tree over (m, 3) points, mm.  Raises InputError if they are of another shape or not finite."""
        given = np.ascontiguousarray(obstacles, dtype=np.float64)
        if given.ndim != 2 or given.shape[1] != 3 or not np.isfinite(given).all():
            raise InputError(f"obstacles are (m, 3) finite points, not {given.shape}", "sample meshes by surface_points")
        if not len(given):
            return cls(given, np.empty(0, dtype=np.int64), np.empty((0, 4)))
        order = np.argsort(z_codes(given), kind="stable")
        leaves = 1 << max(-(-len(given) // LEAF) - 1, 0).bit_length()
        filled = order[np.minimum(np.arange(leaves * LEAF), len(given) - 1)]
        levels = []
        while leaves >= 1:
            groups = given[filled].reshape(leaves, -1, 3)
            centre = 0.5 * (groups.min(axis=1) + groups.max(axis=1))
            radius = np.sqrt(((groups - centre[:, None]) ** 2).sum(axis=2).max(axis=1))
            levels.append(np.column_stack([centre, radius]))
            leaves //= 2
        return cls(np.ascontiguousarray(given[filled]), filled, np.concatenate(levels[::-1]))
