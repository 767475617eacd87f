"""What a plane cuts out of a mesh: closed, oriented, nested loops that know the facets they came from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LoopStack:
    """Contours of many parallel planes as flat arrays, loop after loop; `Loop` and `Section` are views of it.

    mesh    : Mesh
    points  : (n, 3) float, mm   weights : (n,) float   halves : (n,) int32, half-edge 3f + j of the facet that begins
    start   : (l + 1,) int64     rows of each loop
    area    : (l,) float, mm²    signed
    loops   : (s,) int64         numbers of the loops that count, plane after plane
    parents : (s,) int32         counted from the plane's first, -1 for none
    first   : (k + 1,) int64     each plane's part of loops
    axes    : (3, 3) float       unit vectors u, v, w of all the planes
    """

    mesh: Mesh
    points: Floats
    weights: Floats
    halves: NDArray[np.int32]
    start: Ints
    area: Floats
    loops: Ints
    parents: NDArray[np.int32]
    first: Ints
    axes: Floats


class Loop:
    """One closed contour of a section; the material lies on its left seen against the plane's normal.

    points   : (n, 3) float, mm    last != first; no two neighbours are equal
    facets   : (n,) int64          mesh facet of the segment from point i to point i + 1
    edges    : (n, 2) int64        mesh vertices a < b of the edge that point i lies on
    weights  : (n,) float          point i = a + weights[i] (b - a); exactly 0 or 1 where the plane meets a vertex
    xy       : (n, 2) float, mm    the points in the section's frame
    area_mm2 : float               signed: outer contours (counter-clockwise) positive, holes negative
    parent   : int                 the smallest loop of this section around this one, by number; -1 if none
    """

    def __init__(self, stack: LoopStack, number: int, parent: int, origin: Floats) -> None:
        self._stack = stack
        self._rows = slice(int(stack.start[number]), int(stack.start[number + 1]))
        self._origin = origin
        self.points: Floats = stack.points[self._rows]
        self.weights: Floats = stack.weights[self._rows]
        self.area_mm2 = float(stack.area[number])
        self.parent = parent

    @cached_property
    def facets(self) -> Ints:
        """(n,) int64: mesh facet of the segment from point i to point i + 1."""
        return (self._stack.halves[self._rows] // 3).astype(np.int64)

    @cached_property
    def edges(self) -> Ints:
        """(n, 2) int64: mesh vertices a < b of the edge that point i lies on."""
        slot = self._stack.halves[self._rows] % 3
        corners = self._stack.mesh.facets[self.facets]
        rows = np.arange(len(slot))
        return np.sort(np.column_stack([corners[rows, slot], corners[rows, (slot + 1) % 3]]), axis=1)

    @cached_property
    def xy(self) -> Floats:
        """(n, 2) float, mm: the points in the section's frame."""
        return np.asarray((self.points - self._origin) @ self._stack.axes[:2].T)

    @property
    def is_hole(self) -> bool:
        """Whether material lies outside this loop (it runs clockwise)."""
        return self.area_mm2 < 0.0

    @cached_property
    def length_mm(self) -> float:
        """Perimeter, mm."""
        return float(np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1).sum())

    def polygon2d(self) -> shapely.Polygon:
        """The loop alone, without what lies in it, in the section's plane coordinates (mm)."""
        return shapely.Polygon(self.xy)


class Section:
    """All loops that one plane cuts out of a mesh.

    plane : (6,) float      a point (mm) and the unit normal
    frame : (4, 3) float    origin (mm) and the unit vectors u, v, w; right-handed, w is the plane's normal
    loops : list of Loop    empty where the plane misses the mesh
    """

    def __init__(self, plane: Floats, stack: LoopStack, number: int) -> None:
        self.plane = plane
        self._stack = stack
        self._number = number

    @cached_property
    def frame(self) -> Floats:
        """(4, 3) float: origin (mm) and the unit vectors u, v, w; right-handed, w is the plane's normal."""
        return np.vstack([self.plane[:3], self._stack.axes])

    @cached_property
    def loops(self) -> list[Loop]:
        """All loops, in the order of the first mesh facet that each of them meets."""
        stack, origin = self._stack, self.plane[:3]
        part = slice(int(stack.first[self._number]), int(stack.first[self._number + 1]))
        numbers, parents = stack.loops[part].tolist(), stack.parents[part].tolist()
        return [Loop(stack, number, parent, origin) for number, parent in zip(numbers, parents, strict=True)]

    @property
    def origin(self) -> Floats:
        """(3,) float, mm: the plane's point, where xy = (0, 0)."""
        return np.asarray(self.plane[:3])

    @property
    def normal(self) -> Floats:
        """(3,) float: the plane's unit normal."""
        return np.asarray(self._stack.axes[2])

    @property
    def area_mm2(self) -> float:
        """Sum of the loops' signed areas, mm²."""
        part = self._stack.loops[self._stack.first[self._number] : self._stack.first[self._number + 1]]
        return float(self._stack.area[part].sum())

    def lift(self, xy: ArrayLike) -> Floats:
        """Plane coordinates to space.  xy : (n, 2) float, mm.  Returns (n, 3) float, mm."""
        plane_xy = np.asarray(xy, dtype=np.float64)
        return np.asarray(self.frame[0] + plane_xy @ self.frame[1:3])

    def flatten(self, points: ArrayLike) -> Floats:
        """Space to plane coordinates, along the normal.  points : (n, 3) float, mm.  Returns (n, 2) float, mm."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.frame[0]) @ self.frame[1:3].T)

    def to_shapely(self) -> shapely.MultiPolygon:
        """The material in the plane, in plane coordinates (mm): points that the loops wind around at least once.

        Bodies that overlap count once. Loops that touch themselves or each other at a point give valid polygons.
        """
        holes_of: dict[int, list[Floats]] = {}
        for loop in self.loops:
            if loop.is_hole:
                holes_of.setdefault(loop.parent, []).append(loop.xy)
        pieces = [
            shapely.Polygon(loop.xy, holes_of.get(number, []))
            for number, loop in enumerate(self.loops)
            if not loop.is_hole
        ]
        if not all(piece.is_valid for piece in pieces) or not _are_apart(pieces):
            made = [shapely.make_valid(piece, method="structure", keep_collapsed=False) for piece in pieces]
            return _as_multipolygon(shapely.union_all(made))
        return shapely.MultiPolygon(pieces)


def _are_apart(pieces: list[shapely.Polygon]) -> bool:
    """Whether no two polygons share more than a boundary point, so that they form a valid multipolygon."""
    return len(pieces) < 2 or bool(shapely.MultiPolygon(pieces).is_valid)


def _as_multipolygon(shape: shapely.Geometry) -> shapely.MultiPolygon:
    """The polygons of any geometry."""
    parts = [part for part in shapely.get_parts(shape, return_index=False) if isinstance(part, shapely.Polygon)]
    return shapely.MultiPolygon([part for part in parts if not part.is_empty])


def plane_frame(plane: ArrayLike) -> Floats:
    """Right-handed frame of a plane, the same for the same plane: u is +x laid into the plane (+y where w is near x).

    plane : (6,) float   a point (mm) and a unit normal
    Returns (4, 3) float: origin, u, v, w.  The plane z = h gives u = x, v = y; the plane x = h gives u = y, v = z.
    """
    x, y, z, wx, wy, wz = np.asarray(plane, dtype=np.float64).tolist()
    u = (1.0 - wx * wx, -wy * wx, -wz * wx) if abs(wx) < 0.9 else (-wx * wy, 1.0 - wy * wy, -wz * wy)
    length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    ux, uy, uz = u[0] / length + 0.0, u[1] / length + 0.0, u[2] / length + 0.0  # + 0.0 turns -0 into 0
    v = (wy * uz - wz * uy + 0.0, wz * ux - wx * uz + 0.0, wx * uy - wy * ux + 0.0)
    return np.array([(x, y, z), (ux, uy, uz), v, (wx, wy, wz)])


def checked_planes(planes: ArrayLike) -> Floats:
    """Planes as (k, 6) float with normals of length 1 to the last bit.

    Raises InputError if the shape is wrong, a number is not finite, or a normal's length is not 1 within 1e-6
    (far above rounding, far below a forgotten normalisation).
    """
    values = np.array(planes, dtype=np.float64)
    if values.size == 0:
        return values.reshape(0, 6)
    if values.ndim == 1 and values.shape == (6,):
        values = values[None, :]
    if values.ndim != 2 or values.shape[1] != 6:
        raise InputError(f"planes must be (k, 6), a point and a unit normal each, not {values.shape}", "")
    if not np.isfinite(values).all():
        bad = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise InputError(f"plane {bad} holds a number that is not finite", "check how the planes were computed")
    length = np.sqrt(np.einsum("ij,ij->i", values[:, 3:], values[:, 3:]))
    if (np.abs(length - 1.0) > 1e-6).any():
        bad = int(np.argmax(np.abs(length - 1.0)))
        raise InputError(f"the normal of plane {bad} has length {length[bad]:.6g}, not 1", "normalise it")
    off = np.abs(length - 1.0) > 4e-16
    values[off, 3:] /= length[off, None]
    return values
