"""A part in cells along one build direction, and what of it can be grown level by level from what carries it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from planner.decompose.overhang import LEVEL_DEG
from planner.mesh.mesh import Mesh
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

ACROSS = 150  # cells along the part's diagonal, across the direction: walls of a hundredth of the part still show
PER_LEVEL = 3.0  # cells across per level: a wall that leans by 30 degrees moves by more than one cell
_OFF_GRID = np.array([0.371, 0.431])  # of a cell: cells' centres keep off the round coordinates that edges lie on
_SLACK = 0.5  # cells: a step is known to half a cell on each side


@dataclass(frozen=True, eq=False)
class Cells:
    """A part in cells, along a direction.

    frame : (4, 3) float   corner of the first cell, mm, and the axes u, v, w = direction
    solid : (l, ny, nx) bool, levels from below   steep : whose underside lies in this level and leans too much
    cell_mm, level_mm : size of a cell across and along
    """

    frame: Floats
    solid: Flags
    steep: Flags
    cell_mm: float
    level_mm: float

    @property
    def volume_mm3(self) -> float:
        """Of all solid cells."""
        return float(np.count_nonzero(self.solid)) * self.cell_mm**2 * self.level_mm

    def centres(self) -> tuple[Floats, Ints]:
        """(n, 3) float, mm, centres of the solid cells, and their flat numbers, (n,) int."""
        numbers = np.flatnonzero(self.solid)
        level, row, column = np.unravel_index(numbers, self.solid.shape)
        local = np.column_stack([column + 0.5, row + 0.5, level + 0.5]) * [self.cell_mm, self.cell_mm, self.level_mm]
        return self.frame[0] + local @ self.frame[1:], numbers

    def holding(self, points: Floats) -> Ints:
        """(n,) int   Flat number of the cell that holds each point, (n, 3) mm; -1 outside."""
        local = (points - self.frame[0]) @ self.frame[1:].T / [self.cell_mm, self.cell_mm, self.level_mm]
        column, row, level = np.floor(local).astype(np.int64).T
        depth, rows, columns = self.solid.shape
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows) & (level >= 0) & (level < depth)
        return np.where(inside, (level * rows + row) * columns + column, -1)


def cells_along(mesh: Mesh, direction: Floats, limit_deg: float) -> Cells:
    """The part in cells along a unit direction.  limit_deg : lean from it beyond which an underside is steep."""
    frame = plane_frame(np.concatenate([np.zeros(3), direction]))
    local = mesh.vertices @ frame[1:].T
    used = np.unique(mesh.facets)
    low, high = local[used].min(axis=0), local[used].max(axis=0)
    cell = float(np.linalg.norm(high - low)) / ACROSS
    levels = max(int(np.ceil((high[2] - low[2]) / (PER_LEVEL * cell))), 2)
    level = float(high[2] - low[2]) / levels
    low[:2] -= cell * (1.0 + _OFF_GRID)
    columns, rows = np.ceil((high[:2] - low[:2]) / cell).astype(int) + 1
    scaled = (local - low) / [cell, cell, level]
    looking = mesh.normals @ frame[3]
    steep = looking < -np.sin(np.radians(min(limit_deg, LEVEL_DEG))) - 1e-9
    change, hangs = _crossings(scaled, mesh.facets, steep, levels, int(rows), int(columns))
    solid = np.cumsum(change, axis=0)[:-1] > 0
    hangs[0] = False
    return Cells(np.vstack([low @ frame[1:], frame[1:]]), solid, hangs[:-1] & solid, cell, level)


@njit(cache=True)
def _crossings(
    points: Floats, facets: Ints, steep: Flags, levels: int, rows: int, columns: int
) -> tuple[NDArray[np.int16], Flags]:  # pragma: no cover - compiled
    """Change of the winding number at each level of each column, and where a steep facet lets it in."""
    change = np.zeros((levels + 1, rows, columns), dtype=np.int16)
    hangs = np.zeros((levels + 1, rows, columns), dtype=np.bool_)
    for f in range(len(facets)):
        a, b, c = facets[f]
        area = (points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1]) - (points[b, 1] - points[a, 1]) * (
            points[c, 0] - points[a, 0]
        )
        if area == 0.0:
            continue
        sign = -1 if area > 0.0 else 1
        first_x = int(np.floor(min(points[a, 0], points[b, 0], points[c, 0]) - 0.5))
        last_x = int(np.ceil(max(points[a, 0], points[b, 0], points[c, 0]) - 0.5))
        first_y = int(np.floor(min(points[a, 1], points[b, 1], points[c, 1]) - 0.5))
        last_y = int(np.ceil(max(points[a, 1], points[b, 1], points[c, 1]) - 0.5))
        for y in range(max(first_y, 0), min(last_y, rows - 1) + 1):
            for x in range(max(first_x, 0), min(last_x, columns - 1) + 1):
                u = _edge(points, b, c, x + 0.5, y + 0.5)
                v = _edge(points, c, a, x + 0.5, y + 0.5)
                w = _edge(points, a, b, x + 0.5, y + 0.5)
                if sign < 0 and not (u >= 0.0 and v >= 0.0 and w >= 0.0):
                    continue
                if sign > 0 and not (u < 0.0 and v < 0.0 and w < 0.0):
                    continue
                height = (u * points[a, 2] + v * points[b, 2] + w * points[c, 2]) / (u + v + w)
                level = min(max(int(np.ceil(height - 0.5)), 0), levels)
                change[level, y, x] += sign
                if sign > 0 and steep[f]:
                    hangs[level, y, x] = True
    return change, hangs


@njit(cache=True)
def _edge(points: Floats, a: int, b: int, x: float, y: float) -> float:  # pragma: no cover - compiled
    """Twice the signed area over an edge, to the last bit the negative of that over the edge the other way round."""
    if a < b:
        ahead = (points[b, 0] - points[a, 0]) * (y - points[a, 1]) - (points[b, 1] - points[a, 1]) * (x - points[a, 0])
    else:
        ahead = (points[a, 1] - points[b, 1]) * (x - points[b, 0]) - (points[a, 0] - points[b, 0]) * (y - points[b, 1])
    return float(ahead)


def grow(cells: Cells, limit_deg: float, seeds: Flags | None, *, on_plate: bool) -> Flags:
    """(l, ny, nx) bool   What can be deposited along the cells' direction, level by level.

    seeds : (l, ny, nx) bool, what stands already; None: nothing   on_plate : whether the lowest level lies on the plate.
    A cell is made where it is within reach of what carries its level (level height times the tangent of the limit),
    in one piece with it, and has no underside of its own in this level that leans more.
    """
    reach = cells.level_mm / cells.cell_mm * np.tan(np.radians(min(limit_deg, LEVEL_DEG))) + _SLACK
    made = np.zeros_like(cells.solid)
    below = cells.solid[0] if on_plate else np.zeros_like(cells.solid[0])
    for level, section in enumerate(cells.solid):
        stands = section & below
        if seeds is not None:
            stands |= seeds[level] & section
        wanted = section & ~cells.steep[level]
        if stands.any() and (wanted & ~stands).any():
            stands = _spread(stands, wanted | stands, reach)
        made[level] = below = stands
    return made


def _spread(stands: Flags, wanted: Flags, reach: float) -> Flags:
    """What is wanted within reach (cells) of what stands and in one piece with it."""
    near = wanted & (ndimage.distance_transform_edt(~stands) <= reach)
    pieces, count = ndimage.label(near, structure=np.ones((3, 3), dtype=np.int8))
    held = np.zeros(count + 1, dtype=np.bool_)
    held[pieces[stands & near]] = True
    held[0] = False
    return np.asarray(held[pieces] | stands)
