"""Metal that is to be milled away, as cells: what of it stands is told cell by cell, whichever side a cutter comes from."""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import MultiPolygon

from planner.decompose.solids import polygons, section, solid_of
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_CELLS = 20_000  # that a body is divided into, about
_FINE_MM = 0.02  # of the body's surface: finer facets are steps of its making, which no cutter follows
_PITCH_MM = (0.25, 1.0)  # least and greatest side of a cell


@dataclass(frozen=True, eq=False)
class Metal:
    """A body in cubic cells, frame of its mesh.

    solid : the body itself   low : (3,) float, mm, the lattice's corner   pitch_mm : side of a cell
    numbers : (n, 3) int, place of each cell in the lattice   cell_mm3 : share of the body's volume of each cell
    """

    solid: manifold3d.Manifold
    low: Floats
    pitch_mm: float
    numbers: Ints
    cell_mm3: float

    @classmethod
    def from_mesh(cls, mesh: Mesh) -> Metal:
        """The cells whose middles lie in a closed mesh, mm.  Raises PlanningError if it encloses no volume."""
        solid = solid_of(mesh).simplify(_FINE_MM)
        volume = float(mesh.volume)
        pitch = float(np.clip((volume / _CELLS) ** (1.0 / 3.0), *_PITCH_MM))
        low, high = mesh.bounds
        count = np.maximum(np.floor((high - low) / pitch + 0.5 - 1e-9).astype(np.int64), 1)
        x, y = (low[k] + (np.arange(count[k]) + 0.5) * pitch for k in (0, 1))
        grid_x, grid_y = (axis.ravel() for axis in np.meshgrid(x, y, indexing="ij"))
        found = []
        for k in range(int(count[2])):
            region = section(solid, min(float(low[2] + (k + 0.5) * pitch), float(high[2]) - _FINE_MM))
            shapely.prepare(region)
            inside = np.flatnonzero(shapely.contains_xy(region, grid_x, grid_y))
            found.append(np.column_stack([inside // len(y), inside % len(y), np.full(len(inside), k)]))
        numbers = np.vstack(found)
        return cls(solid, low, pitch, numbers, volume / max(len(numbers), 1))

    @property
    def points(self) -> Floats:
        """(n, 3) float, mm   The cells' middles."""
        return np.asarray(self.low + (self.numbers + 0.5) * self.pitch_mm)

    def volume_mm3(self, chosen: Flags) -> float:
        """Of some cells."""
        return float(np.count_nonzero(chosen) * self.cell_mm3)

    def bodies(self, chosen: Flags) -> list[Ints]:
        """The connected bodies of some cells, largest first, then by their first cell, as numbers of cells."""
        rows = np.flatnonzero(chosen)
        if not len(rows):
            return []
        labels, count = ndimage.label(self._lattice(rows), np.ones((3, 3, 3)))
        own = labels[tuple(self.numbers[rows].T)]
        found = [rows[own == number] for number in range(1, count + 1)]
        return sorted(found, key=lambda body: (-len(body), int(body[0])))

    def half_thickness_mm(self, rows: Ints) -> float:
        """Of a body: of the largest ball in it, mm."""
        deep = ndimage.distance_transform_edt(np.pad(self._lattice(rows), 1))
        return float((deep.max() - 0.5) * self.pitch_mm)

    def _lattice(self, rows: Ints) -> Flags:
        there = np.zeros(self.numbers.max(axis=0) + 1, dtype=np.bool_)
        there[tuple(self.numbers[rows].T)] = True
        return there


def region_of(cells: Flags, low: Floats, pitch_mm: float) -> MultiPolygon:
    """The region that some squares of a raster cover, mm.

    cells : (i, j) bool, x along the first axis   low : (2,) float, mm, the raster's corner.
    """
    edges = np.diff(np.pad(cells.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    column, start = np.nonzero(edges == 1)
    _, end = np.nonzero(edges == -1)
    x = low[0] + column * pitch_mm
    runs = shapely.box(x, low[1] + start * pitch_mm, x + pitch_mm, low[1] + end * pitch_mm)
    return polygons(shapely.union_all(runs, grid_size=1e-6))
