"""The strip of surface between two planes: which facets lie in it and how they hang together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.slicing.slicer import SNAP_FRACTION

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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


def slab_of(mesh: Mesh, bottom: Floats, top: Floats) -> Slab:
    """The slab between two planes and the pieces of surface in it.

    bottom, top : (6,) float, mm and unit normal.
    Open at both planes, as the slicer's sections "above" the bottom and "below" the top are: level faces in the planes
    are outside. Two facets hang together where their common edge runs through the slab.
    """
    snap_mm = SNAP_FRACTION * float(np.abs(mesh.bounds).max() + mesh.diagonal)
    above = (mesh.vertices - bottom[:3]) @ bottom[3:]
    below = (top[:3] - mesh.vertices) @ top[3:]
    above[np.abs(above) <= snap_mm] = 0.0
    below[np.abs(below) <= snap_mm] = 0.0
    component, count = strip_components(mesh.facets, mesh.adjacency, above, below)
    return Slab(bottom, top, above, below, component, int(count))


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
    count = 0
    for seed in range(facets.shape[0]):
        if component[seed] >= 0:
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
