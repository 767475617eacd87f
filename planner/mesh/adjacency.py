"""Which facet lies across each edge: half-edges bucketed by vertex, in linear time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

PAIRED, OPEN, SAME_DIRECTION, CROWDED = 0, 1, 2, 3
"""State of a half-edge: one mate the other way round; no mate; one mate in the same direction; three or more facets."""

COINCIDENT_RAD = 1e-9
"""Facets around an edge that are nearer than this lie on each other: far above the rounding of an angle."""


MAX_FACETS = (2**31 - 1) // 3
"""Half-edges are numbered in 32 bits."""


@njit(cache=True)
def _bucket_half_edges(facets: NDArray[np.int64], vertex_count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Half-edges by their lower vertex, in ascending order: bucket[start[v] : start[v + 1]].

    Returns start : (n + 1,) int32 and bucket : (3m, 2) int32, the half-edge and its higher vertex w, as w where the
    half-edge runs towards w and as -1 - w where it comes from there.
    """
    start = np.zeros(vertex_count + 1, np.int32)
    for f in range(facets.shape[0]):
        a, b, c = facets[f, 0], facets[f, 1], facets[f, 2]
        start[min(a, b)] += 1
        start[min(b, c)] += 1
        start[min(c, a)] += 1
    for v in range(vertex_count):
        start[v + 1] += start[v]
    bucket = np.empty((3 * facets.shape[0], 2), np.int32)
    for f in range(facets.shape[0] - 1, -1, -1):
        for j in range(2, -1, -1):
            a, b = facets[f, j], facets[f, j + 1 if j < 2 else 0]
            low = min(a, b)
            start[low] -= 1
            bucket[start[low], 0] = 3 * f + j
            bucket[start[low], 1] = b if a <= b else -1 - a
    return start, bucket


@njit(cache=True)
def pair_half_edges(facets: NDArray[np.int64], vertex_count: int) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Mate of every half-edge, in time linear in the facets however many meet at a vertex.

    facets : (m, 3) int64   half-edge 3f + j runs from facets[f, j] to facets[f, (j + 1) % 3]; m <= MAX_FACETS
    Returns mate : (3m,) int32, the other half-edge of the same edge (-1 where OPEN or CROWDED) and
    state : (3m,) int8, one of PAIRED, OPEN, SAME_DIRECTION, CROWDED. Half-edges of zero length are CROWDED.
    """
    start, bucket = _bucket_half_edges(facets, vertex_count)
    mate = np.full(3 * facets.shape[0], -1, np.int32)
    state = np.full(3 * facets.shape[0], OPEN, np.int8)
    met = np.full(vertex_count, -1, np.int32)  # place in the bucket of the first half-edge to each higher vertex
    for v in range(vertex_count):
        for i in range(start[v], start[v + 1]):
            h, w = bucket[i, 0], bucket[i, 1]
            far = w if w >= 0 else -1 - w
            if far == v:
                state[h] = CROWDED
                continue
            if met[far] < start[v]:
                met[far] = i
                continue
            g = bucket[met[far], 0]
            if state[g] == OPEN:
                mate[h], mate[g] = g, h
                state[h] = state[g] = SAME_DIRECTION if w == bucket[met[far], 1] else PAIRED
                continue
            if mate[g] >= 0:
                state[mate[g]] = CROWDED
                mate[mate[g]] = -1
                mate[g] = -1
            state[g] = state[h] = CROWDED
    return mate, state


def pair_crowded(
    vertices: NDArray[np.float64], facets: NDArray[np.int64], mate: NDArray[np.int32], state: NDArray[np.int8]
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
