"""The strip of surface between two planes: which facets lie in it and how they hang together."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.slicing.slicer import SNAP_FRACTION

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


_REMEMBERED = 3  # slabs of a mesh: bands go from one to the next


@dataclass(frozen=True, eq=False)
class Slab:
    """The space above a bottom plane and below a top plane, and the mesh in it.

    bottom, top : (6,) float     the planes: a point (mm) and the unit normal, both pointing from bottom to top
    above, below : (n,) float    height of each mesh vertex above the bottom plane and depth below the top plane, mm;
                                 0 for vertices that lie on the plane within the slicer's rounding
    component : (m,) int64       number of the connected piece of surface that each facet belongs to; -1 outside
    count : int                  how many pieces there are
    """

    bottom: Floats
    top: Floats
    above: Floats
    below: Floats
    component: Ints
    count: int


_SLABS: WeakKeyDictionary[Mesh, OrderedDict[tuple[bytes, bytes], Slab]] = WeakKeyDictionary()


def slab_of(mesh: Mesh, bottom: Floats, top: Floats) -> Slab:
    """The slab between two planes and the pieces of surface in it.

    bottom, top : (6,) float, mm and unit normal.
    Open at both planes, as the slicer's sections "above" the bottom and "below" the top are: level faces in the planes
    are outside. Two facets hang together where their common edge runs through the slab. The last few slabs of a mesh are
    remembered: a layer's sections, matching and walls ask for the same one.
    """
    known = _SLABS.setdefault(mesh, OrderedDict())
    key = (bottom.tobytes(), top.tobytes())
    if key not in known:
        snap_mm = SNAP_FRACTION * float(np.abs(mesh.bounds).max() + mesh.diagonal)
        above = _heights(mesh.vertices, bottom, snap_mm)
        below = -_heights(mesh.vertices, top, snap_mm)
        component, count = strip_components(mesh.facets, mesh.adjacency, above, below)
        known[key] = Slab(bottom, top, above, below, component, int(count))
        if len(known) > _REMEMBERED:
            known.popitem(last=False)
    return known[key]


@njit(cache=True)
def _heights(vertices: Floats, plane: Floats, snap_mm: float) -> Floats:  # pragma: no cover
    """Height of each vertex above a plane, mm; 0 within snap_mm."""
    heights = np.empty(vertices.shape[0])
    for v in range(vertices.shape[0]):
        height = 0.0
        for axis in range(3):
            height += (vertices[v, axis] - plane[axis]) * plane[3 + axis]
        heights[v] = height if abs(height) > snap_mm else 0.0
    return heights


@njit(cache=True)
def edge_is_inside(above_a: float, below_a: float, above_b: float, below_b: float) -> bool:
    """Whether some point of the open edge a-b has above > 0 and below > 0 (both are linear along it)."""
    low, high = 0.0, 1.0
    for start, stop in ((above_a, above_b), (below_a, below_b)):
        if start <= 0.0 and stop <= 0.0:
            return False
        if start < 0.0 or (start == 0.0 and stop > 0.0):
            low = max(low, start / (start - stop))
        elif stop < 0.0 or (stop == 0.0 and start > 0.0):
            high = min(high, start / (start - stop))
    return bool(high > low)


@njit(cache=True)
def strip_components(facets: Ints, adjacency: Ints, above: Floats, below: Floats) -> tuple[Ints, int]:
    """Connected pieces of the surface inside a slab, by flooding over edges that run through it.

    facets, adjacency : (m, 3) int64;  above, below : (n,) float, mm, signed distances into the slab from its planes
    Returns (m,) int64 piece of each facet (-1: not inside) and the number of pieces.
    """
    component = np.full(facets.shape[0], -1, np.int64)
    stack = np.empty(facets.shape[0], np.int64)
    reach = np.empty(above.shape[0], np.uint8)  # 1: above the bottom plane, 2: below the top plane
    for v in range(above.shape[0]):
        reach[v] = (1 if above[v] > 0.0 else 0) | (2 if below[v] > 0.0 else 0)
    count = 0
    for seed in range(facets.shape[0]):
        if reach[facets[seed, 0]] | reach[facets[seed, 1]] | reach[facets[seed, 2]] != 3 or component[seed] >= 0:
            continue
        inside = False
        for j in range(3):
            a, b = facets[seed, j], facets[seed, (j + 1) % 3]
            inside = inside or edge_is_inside(above[a], below[a], above[b], below[b])
        if not inside:
            continue
        component[seed] = count
        stack[0] = seed
        size = 1
        while size > 0:
            size -= 1
            f = stack[size]
            for j in range(3):
                g = adjacency[f, j]
                a, b = facets[f, j], facets[f, (j + 1) % 3]
                if g >= 0 and component[g] < 0 and edge_is_inside(above[a], below[a], above[b], below[b]):
                    component[g] = count
                    stack[size] = g
                    size += 1
        count += 1
    return component, count
