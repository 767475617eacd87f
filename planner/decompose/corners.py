"""What facets' corners have in common, facet by facet, in one pass over the mesh: a search asks it hundreds of times."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


def used_vertices(mesh: Mesh) -> Ints:
    """(k,) int   Numbers of the vertices that facets name, rising."""
    mask = np.zeros(len(mesh.vertices), dtype=np.bool_)
    mask[mesh.facets.ravel()] = True
    return np.flatnonzero(mask)


@njit(cache=True)
def spans(values: NDArray[Any], facets: Ints) -> tuple[NDArray[Any], NDArray[Any]]:  # pragma: no cover
    """Least and greatest of a quantity of the vertices, (n,), over the corners of each facet: (m,) each."""
    count = facets.shape[0]
    low, high = np.empty(count, values.dtype), np.empty(count, values.dtype)
    for f in range(count):
        a, b, c = values[facets[f, 0]], values[facets[f, 1]], values[facets[f, 2]]
        low[f] = min(a, b, c)
        high[f] = max(a, b, c)
    return low, high


@njit(cache=True)
def shares_beyond(values: Floats, facets: Ints, limit: float) -> Floats:  # pragma: no cover
    """(m,) float, 0 … 1   Share of each facet's corners at which a quantity of the vertices is above a limit."""
    made = np.empty(facets.shape[0])
    for f in range(facets.shape[0]):
        count = 0
        for k in range(3):
            if values[facets[f, k]] > limit:
                count += 1
        made[f] = count / 3.0
    return made


@njit(cache=True)
def seeds_of(facets: Ints, rises: Flags, stands: Flags, count: int) -> Flags:  # pragma: no cover
    """(count,) bool   Vertices all of whose facets rise, and those of facets that stand on something."""
    made = np.zeros(count, np.bool_)
    for f in range(facets.shape[0]):
        for k in range(3):
            made[facets[f, k]] = True
    for f in range(facets.shape[0]):
        if not rises[f]:
            for k in range(3):
                made[facets[f, k]] = False
    for f in range(facets.shape[0]):
        if stands[f]:
            for k in range(3):
                made[facets[f, k]] = True
    return made


@njit(cache=True)
def edges_between(facets: Ints, mask: Flags) -> tuple[Ints, Ints]:  # pragma: no cover
    """Facet and slot (edge from corner slot to the next) of every half-edge both of whose ends are marked: (k,) each."""
    rows, slots = [0 for _ in range(0)], [0 for _ in range(0)]
    for f in range(facets.shape[0]):
        for k in range(3):
            if mask[facets[f, k]] and mask[facets[f, (k + 1) % 3]]:
                rows.append(f)
                slots.append(k)
    return np.array(rows, dtype=np.int64), np.array(slots, dtype=np.int64)
