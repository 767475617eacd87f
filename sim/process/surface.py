"""The surface of a field as triangles: marching cubes on the blocks that hold a surface, closed and manifold whatever the field is."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, METAL, Field
from sim.process.marching_table import CORNERS, EDGE_AXIS, EDGE_CORNER, FACET_COUNT, FACET_EDGES
from sim.process.stock import Stock

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Triangles = tuple[Array, Index]  # vertices (n, 3) mm, facets (m, 3)

APART = 1e-3  # of a cell: vertices keep this far from grid points, so that no two of them ever coincide in a file


def built_mesh(stock: Stock, base_mm: float) -> Triangles:
    """Surface of the stock above `base_mm` as triangles: vertices (n, 3) mm, build frame, and facets (m, 3), outward, closed at the base.

    Empty arrays when there is no metal there; base_mm = -inf: the whole stock. See `field_mesh`.
    """
    return field_mesh(stock.field, base_mm)


def field_mesh(field: Field, base_mm: float = -np.inf) -> Triangles:
    """Surface of a field where it is zero, cut off flat at `base_mm`: vertices (n, 3) mm and facets (m, 3), outward.

    Every edge has exactly two facets and every vertex one fan, at any state: beyond the grid is air, so metal at the grid's edge is
    closed there; where two bodies touch along an edge or at a corner they are kept apart (of a face of the grid with metal at two
    opposite corners only, the two are separate); a value of exactly zero counts as air. Vertices lie on grid edges, by linear
    interpolation. Time and memory go with the surface: layers of blocks are taken one by one, and only columns with a surface are read.

    Source: Lorensen and Cline, Marching Cubes (1987), with facets from the sign pattern of each face, the same seen from both sides
    (`marching_table`), so that neighbouring cubes always agree.
    """
    nx, ny, _ = field.shape
    ids = np.zeros((3, nx + BLOCK + 1, ny + BLOCK + 1, BLOCK + 1), dtype=np.int32)  # vertex on the edge along each axis from each point
    vertices: list[Array] = []
    facets: list[Index] = []
    done = 0
    for layer in range(_first_layer(field, base_mm), field.shape[2] // BLOCK):
        active = active_columns(field.blocks.directory, layer, _lies_below(field, layer, base_mm))
        ids[:2, :, :, 0] = ids[:2, :, :, BLOCK]
        if not len(active):
            continue
        first = np.array([-BLOCK, -BLOCK, layer * BLOCK])
        window = field.dense(first, first + np.array(ids.shape[1:]))
        below = base_mm - field.origin[2] - field.cell_mm * (first[2] + np.arange(BLOCK + 1))
        if below.max() > -field.band_mm:
            np.maximum(window, below.astype(np.float32), out=window)
        counts = count_layer(window, active)
        points, corners = np.empty((counts[0], 3)), np.empty((counts[1], 3), dtype=np.int64)
        march_layer(window, active, ids, done, points, corners)
        points += first
        vertices.append(points * field.cell_mm + field.origin)
        facets.append(corners)
        done += len(points)
    if not done:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return np.concatenate(vertices), np.concatenate(facets)


def _first_layer(field: Field, base_mm: float) -> int:
    """Layer of blocks to begin with: below all metal, so that nothing crosses its lowest plane."""
    if np.isneginf(base_mm):
        return -1
    return max(-1, int(np.floor((base_mm - field.origin[2]) / field.cell_mm / BLOCK)) - 1)


def _lies_below(field: Field, layer: int, base_mm: float) -> bool:
    """Whether the base cuts through a layer of blocks or the first plane above it."""
    return bool(field.origin[2] + layer * BLOCK * field.cell_mm <= base_mm + field.cell_mm)


@njit(cache=True, nogil=True)
def active_columns(directory: NDArray[np.int32], layer: int, all_metal: bool) -> Index:
    """Blocks of a layer whose cubes may hold a surface: (m, 2) int, their place in the padded window. all_metal : also uniform metal."""
    bx, by, bz = directory.shape
    found = np.empty(((bx + 1) * (by + 1), 2), np.int64)
    count = 0
    for a in range(-1, bx):
        for b in range(-1, by):
            air = metal = mixed = False
            for n in range(8):
                i, j, k = a + (n & 1), b + (n >> 1 & 1), layer + (n >> 2)
                beyond = i < 0 or j < 0 or k < 0 or i >= bx or j >= by or k >= bz
                entry = AIR if beyond else directory[i, j, k]
                air = air or entry == AIR
                metal = metal or entry == METAL
                mixed = mixed or entry >= 0
            if mixed or (metal and (air or all_metal)):
                found[count, 0], found[count, 1] = a + 1, b + 1
                count += 1
    return found[:count]


@njit(cache=True, nogil=True)
def case_of(window: NDArray[np.float32], i: int, j: int, k: int) -> int:
    """Which corners of a cube are metal, one bit each."""
    case = 0
    for c in range(8):
        if window[i + CORNERS[c, 0], j + CORNERS[c, 1], k + CORNERS[c, 2]] < 0.0:
            case |= 1 << c
    return case


@njit(cache=True, nogil=True)
def count_layer(window: NDArray[np.float32], active: Index) -> Index:
    """How many vertices and facets `march_layer` makes, (2,) int. window : (x, y, BLOCK + 1) mm; active : (m, 2) int."""
    counts = np.zeros(2, np.int64)
    for n in range(active.shape[0]):
        for i in range(active[n, 0] * BLOCK, min((active[n, 0] + 1) * BLOCK, window.shape[0] - 1)):
            for j in range(active[n, 1] * BLOCK, min((active[n, 1] + 1) * BLOCK, window.shape[1] - 1)):
                for k in range(BLOCK):
                    metal = window[i, j, k] < 0.0
                    above = window[i, j, k + 1] < 0.0
                    counts[0] += metal != above
                    counts[0] += (window[i + 1, j, k + 1] < 0.0) != above
                    counts[0] += (window[i, j + 1, k + 1] < 0.0) != above
                    counts[1] += FACET_COUNT[case_of(window, i, j, k)]
    return counts


@njit(cache=True, nogil=True)
def march_layer(window: NDArray[np.float32], active: Index, ids: NDArray[np.int32], done: int, points: Array, facets: Index) -> None:
    """Vertices and facets of one layer of cubes.

    window : (x, y, BLOCK + 1) float32, mm   ids : (3, x, y, BLOCK + 1) int, written; those of the lowest plane come from the layer below
    done : vertices made before   points : (n, 3) float, written, in cells of the window   facets : (m, 3) int, written
    """
    made = 0
    for n in range(active.shape[0]):
        for i in range(active[n, 0] * BLOCK, min((active[n, 0] + 1) * BLOCK, window.shape[0] - 1)):
            for j in range(active[n, 1] * BLOCK, min((active[n, 1] + 1) * BLOCK, window.shape[1] - 1)):
                for k in range(BLOCK):
                    made = cross(window, ids, points, made, done, 2, i, j, k, window[i, j, k + 1])
                    made = cross(window, ids, points, made, done, 0, i, j, k + 1, window[i + 1, j, k + 1])
                    made = cross(window, ids, points, made, done, 1, i, j, k + 1, window[i, j + 1, k + 1])
    made = 0
    for n in range(active.shape[0]):
        for i in range(active[n, 0] * BLOCK, min((active[n, 0] + 1) * BLOCK, window.shape[0] - 1)):
            for j in range(active[n, 1] * BLOCK, min((active[n, 1] + 1) * BLOCK, window.shape[1] - 1)):
                for k in range(BLOCK):
                    case = case_of(window, i, j, k)
                    for f in range(FACET_COUNT[case]):
                        for c in range(3):
                            e = FACET_EDGES[case, f, c]
                            p = EDGE_CORNER[e]
                            facets[made, c] = ids[EDGE_AXIS[e], i + CORNERS[p, 0], j + CORNERS[p, 1], k + CORNERS[p, 2]]
                        made += 1


@njit(cache=True, nogil=True)
def cross(
    window: NDArray[np.float32], ids: NDArray[np.int32], points: Array, made: int, done: int, axis: int, i: int, j: int, k: int, far: float
) -> int:
    """Make the vertex of the grid edge along `axis` from a point to the next, whose value is `far`, if it crosses; vertices made so far."""
    near = window[i, j, k]
    if (near < 0.0) == (far < 0.0):
        return made
    share = near / (near - far)
    points[made, 0], points[made, 1], points[made, 2] = i, j, k
    points[made, axis] += min(max(share, APART), 1.0 - APART)
    ids[axis, i, j, k] = done + made
    return made + 1
