"""Which facet lies across each edge: half-edges bucketed by vertex, in linear time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

PAIRED, OPEN, SAME_DIRECTION, CROWDED = 0, 1, 2, 3
"""State of a half-edge: one mate the other way round; no mate; one mate in the same direction; three or more facets."""

COINCIDENT_RAD = 1e-9
"""Facets around an edge that are nearer than this lie on each other: far above the rounding of an angle."""


@njit(cache=True)
def pair_half_edges(facets: NDArray[np.int64], vertex_count: int) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
    """Mate of every half-edge.

    facets : (m, 3) int64   half-edge 3f + j runs from facets[f, j] to facets[f, (j + 1) % 3]
    Returns mate : (3m,) int64, the other half-edge of the same edge (-1 where OPEN or CROWDED) and
    state : (3m,) int8, one of PAIRED, OPEN, SAME_DIRECTION, CROWDED. Half-edges of zero length are CROWDED.
    """
    half_count = 3 * facets.shape[0]
    start = np.zeros(vertex_count + 1, np.int64)
    for h in range(half_count):
        a, b = facets[h // 3, h % 3], facets[h // 3, (h + 1) % 3]
        start[min(a, b) + 1] += 1
    for v in range(vertex_count):
        start[v + 1] += start[v]
    slot = start[:-1].copy()
    bucket = np.empty(half_count, np.int64)
    far = np.empty(half_count, np.int64)
    for h in range(half_count):
        a, b = facets[h // 3, h % 3], facets[h // 3, (h + 1) % 3]
        low = min(a, b)
        bucket[slot[low]] = h
        far[slot[low]] = max(a, b)
        slot[low] += 1
    mate = np.full(half_count, -1, np.int64)
    state = np.full(half_count, CROWDED, np.int8)
    for v in range(vertex_count):
        for i in range(start[v], start[v + 1]):
            found = -1
            count = 0
            for k in range(start[v], start[v + 1]):
                if k != i and far[k] == far[i]:
                    found = k
                    count += 1
            if far[i] == v or count > 1:
                continue
            h = bucket[i]
            if count == 0:
                state[h] = OPEN
                continue
            g = bucket[found]
            mate[h] = g
            same = facets[h // 3, h % 3] == facets[g // 3, g % 3]
            state[h] = SAME_DIRECTION if same else PAIRED
    return mate, state


def pair_crowded(
    vertices: NDArray[np.float64], facets: NDArray[np.int64], mate: NDArray[np.int64], state: NDArray[np.int8]
) -> None:
    """Pair, in place, the half-edges of edges that three or more facets share, each across the material between them.

    vertices : (n, 3) float mm;  facets : (m, 3) int64;  mate, state : (3m,) as from `pair_half_edges`.
    Around the edge, the facet met first when turning from a facet into its material is its mate. Edges whose facets
    do not run equally often in both directions keep their surplus unpaired.
    """
    crowded = np.flatnonzero(state == CROWDED)
    tail = facets[crowded // 3, crowded % 3]
    head = facets[crowded // 3, (crowded + 1) % 3]
    groups: dict[tuple[int, int], list[int]] = {}
    for h, a, b in zip(crowded.tolist(), tail.tolist(), head.tolist(), strict=True):
        if a != b:
            groups.setdefault((min(a, b), max(a, b)), []).append(h)
    for (low, high), halves in groups.items():
        angle = _angles_around(vertices, facets, low, high, halves)
        forward = [h for h in halves if facets[h // 3, h % 3] == low]
        backward = [h for h in halves if facets[h // 3, h % 3] == high]
        for h in sorted(forward, key=lambda item: (angle[item], item)):
            if not backward:
                break
            chosen = min(backward, key=lambda g: (_turn_into_material(angle[h] - angle[g]), g))
            backward.remove(chosen)
            mate[h], mate[chosen] = chosen, h
            state[h] = state[chosen] = PAIRED


def _turn_into_material(difference: float) -> float:
    """Angle (rad) turned from a facet into its material; facets that coincide bound different material."""
    turn = float(difference % (2.0 * np.pi))
    return turn if turn > COINCIDENT_RAD else 2.0 * np.pi


def _angles_around(
    vertices: NDArray[np.float64], facets: NDArray[np.int64], low: int, high: int, halves: list[int]
) -> dict[int, float]:
    """Angle (rad) of each facet around the edge low -> high, from an arbitrary but fixed zero."""
    axis = vertices[high] - vertices[low]
    axis = axis / np.linalg.norm(axis)
    zero = np.eye(3)[int(np.argmin(np.abs(axis)))]
    zero = zero - axis * (zero @ axis)
    zero = zero / np.linalg.norm(zero)
    side = np.cross(axis, zero)
    angle: dict[int, float] = {}
    for h in halves:
        apex = vertices[facets[h // 3, (h + 2) % 3]] - vertices[low]
        angle[h] = float(np.arctan2(apex @ side, apex @ zero))
    return angle
