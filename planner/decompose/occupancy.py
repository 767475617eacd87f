"""A part as cubes on a grid: coarse, but the same for any mesh of it; what is connected is found here and measured elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.decompose.corners import used_vertices
from planner.mesh.mesh import Mesh
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Links = NDArray[np.int32]

CUBES = 60_000
"""Cubes wanted inside a compact part: about 40 along each side of a block, 0.1 s for all that is done with them."""
_THIN = 2.5  # cubes through a wall at least: fewer would tear it
_MAX_CELLS = 24_000_000  # of the grid, one byte each
_MAX_CUBES = 400_000
_OFFSET = (0.4871, 0.5139, 0.4663)
"""Where the grid begins, in cubes: no round number, so that columns do not run along the edges of a drawn part."""


@dataclass(frozen=True, eq=False)
class Occupancy:
    """Cubes whose centre lies in the part.

    centres : (n, 3) float, mm, frame of the mesh   links : (n, 6) int32, the cube across each side, -1 where none
    cube_mm : length of their edges
    """

    centres: Floats
    links: Links
    cube_mm: float

    def only(self, inside: NDArray[np.bool_]) -> Occupancy:
        """The cubes of a part of it.  inside : (n,) bool"""
        number = np.where(inside, np.cumsum(inside) - 1, -1)
        links = self.links[inside]
        return Occupancy(self.centres[inside], np.where(links >= 0, number[links], -1).astype(np.int32), self.cube_mm)


def occupancy(mesh: Mesh, direction: Floats, cubes: int = CUBES) -> Occupancy:
    """Cubes of a part, on a grid that stands along a unit direction; n is about `cubes`, more where walls are thin.

    A point lies in the part where facets wind around it more than zero times, so bodies that overlap count once.
    """
    axes = plane_frame(np.concatenate([np.zeros(3), direction]))[1:]
    points = mesh.vertices @ axes.T
    used = points[used_vertices(mesh)]
    low, size = used.min(axis=0), np.ptp(used, axis=0)
    edge = _cube_edge(mesh, size, cubes)
    origin = low - edge * (1.0 + np.array(_OFFSET))
    counts = np.ceil((size + low - origin) / edge).astype(np.int64) + 1
    winding = _winding((points - origin) / edge, mesh.facets, counts[0], counts[1], counts[2])
    cells = np.argwhere(winding > 0)
    links = _links(cells, counts[0], counts[1], counts[2])
    return Occupancy((origin + (cells + 0.5) * edge) @ axes, links, edge)


def _cube_edge(mesh: Mesh, size: Floats, cubes: int) -> float:
    """Edge of the cubes, mm: so many in the volume, a few through a wall of mean thickness, within what memory holds."""
    volume = max(abs(mesh.volume), 1e-9)
    wall = 2.0 * volume / max(float(mesh.areas.sum()), 1e-9)
    edge = min((volume / cubes) ** (1.0 / 3.0), wall / _THIN)
    least = max((volume / _MAX_CUBES) ** (1.0 / 3.0), (float(np.prod(size)) / _MAX_CELLS) ** (1.0 / 3.0))
    return float(max(edge, least))


@njit(cache=True)
def _winding(points: Floats, facets: Ints, nx: int, ny: int, nz: int) -> NDArray[np.int8]:  # pragma: no cover
    """(nx, ny, nz) int8: how often the facets wind around each cell's centre.  points : (n, 3) in cells from the origin."""
    grid = np.zeros((nx, ny, nz), np.int8)
    for f in range(facets.shape[0]):
        a, b, c = facets[f, 0], facets[f, 1], facets[f, 2]
        pa, pb, pc = points[a], points[b], points[c]
        area = (pb[0] - pa[0]) * (pc[1] - pa[1]) - (pb[1] - pa[1]) * (pc[0] - pa[0])
        if area == 0.0:
            continue
        i0 = max(int(np.ceil(min(pa[0], pb[0], pc[0]) - 0.5)), 0)
        i1 = min(int(np.floor(max(pa[0], pb[0], pc[0]) - 0.5)), nx - 1)
        j0 = max(int(np.ceil(min(pa[1], pb[1], pc[1]) - 0.5)), 0)
        j1 = min(int(np.floor(max(pa[1], pb[1], pc[1]) - 0.5)), ny - 1)
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                x, y = i + 0.5, j + 0.5
                left = area > 0.0
                if _is_left(points, a, b, x, y) != left or _is_left(points, b, c, x, y) != left:
                    continue
                if _is_left(points, c, a, x, y) != left:
                    continue
                s = ((x - pa[0]) * (pc[1] - pa[1]) - (y - pa[1]) * (pc[0] - pa[0])) / area
                t = ((pb[0] - pa[0]) * (y - pa[1]) - (pb[1] - pa[1]) * (x - pa[0])) / area
                height = pa[2] + s * (pb[2] - pa[2]) + t * (pc[2] - pa[2])
                k = min(max(int(np.ceil(height - 0.5)), 0), nz - 1)
                grid[i, j, k] += -1 if left else 1
    for i in range(nx):
        for j in range(ny):
            for k in range(1, nz):
                grid[i, j, k] += grid[i, j, k - 1]
    return grid


@njit(cache=True)
def _is_left(points: Floats, a: int, b: int, x: float, y: float) -> bool:  # pragma: no cover
    """Whether (x, y) lies left of the edge a to b; of two facets with this edge exactly one has a point on it."""
    low, high = (a, b) if a < b else (b, a)
    p, q = points[low], points[high]
    is_left = (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) > 0.0
    return is_left if a < b else not is_left


@njit(cache=True)
def _links(cells: Ints, nx: int, ny: int, nz: int) -> Links:  # pragma: no cover
    """(n, 6) int32: number of the occupied cell on either side along x, y, z; -1 where there is none."""
    number = np.full((nx, ny, nz), -1, np.int32)
    for n in range(cells.shape[0]):
        number[cells[n, 0], cells[n, 1], cells[n, 2]] = n
    links = np.full((cells.shape[0], 6), -1, np.int32)
    limits = (nx, ny, nz)
    for n in range(cells.shape[0]):
        i, j, k = cells[n, 0], cells[n, 1], cells[n, 2]
        place = (i, j, k)
        for axis in range(3):
            di, dj, dk = int(axis == 0), int(axis == 1), int(axis == 2)
            if place[axis] > 0:
                links[n, 2 * axis] = number[i - di, j - dj, k - dk]
            if place[axis] < limits[axis] - 1:
                links[n, 2 * axis + 1] = number[i + di, j + dj, k + dk]
    return links
