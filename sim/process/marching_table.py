"""Which facets a cube of the grid holds for each pattern of metal at its corners, made from one rule per face."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MOST_FACETS = 5
CORNERS: NDArray[np.int64] = np.array([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in range(8)])  # bit d of a corner's number: its place along d
_EDGES = [(a, c, c | 1 << a) for a in range(3) for c in range(8) if not c >> a & 1]
EDGE_AXIS: NDArray[np.int64] = np.array([a for a, _, _ in _EDGES])
EDGE_CORNER: NDArray[np.int64] = np.array([c for _, c, _ in _EDGES])  # where the edge begins
_NUMBER = {frozenset(edge[1:]): n for n, edge in enumerate(_EDGES)}


def _faces() -> list[list[int]]:
    """Corners of the six faces, in turn, anticlockwise seen from outside."""
    faces = []
    for axis in range(3):
        b, c = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        ring = [0, b, b | c, c]
        faces += [ring[::-1], [corner | 1 << axis for corner in ring]]
    return faces


_FACES = _faces()
_FACES_OF = [{n for n, face in enumerate(_FACES) if {begin, end} <= set(face)} for _, begin, end in _EDGES]


def loops(case: int) -> list[list[int]]:
    """Closed chains of grid edges that the surface passes through, metal on their left seen from outside.

    case : bit c is set where corner c is metal
    On each face every run of metal corners is cut off by itself: from the edge where the ring enters metal to the one where it leaves.
    The neighbour sees the same runs the other way round, so that its chain passes the same two edges against this one.
    """
    after: dict[int, int] = {}
    for ring in _FACES:
        for n, corner in enumerate(ring):
            if case >> corner & 1 and not case >> ring[n - 1] & 1:
                last = n
                while case >> ring[(last + 1) % 4] & 1:
                    last += 1
                enters, leaves = (ring[n - 1], corner), (ring[last % 4], ring[(last + 1) % 4])
                after[_NUMBER[frozenset(enters)]] = _NUMBER[frozenset(leaves)]
    chains = []
    while after:
        chain, edge = [], min(after)
        while edge in after:
            chain.append(edge)
            edge = after.pop(edge)
        chains.append(chain)
    return chains


def triangles(chain: list[int]) -> list[tuple[int, int, int]] | None:
    """A chain as triangles none of whose inner sides lies in a face of the cube, so that no neighbour can have the same side; None: no way."""
    if len(chain) < 3:
        return []
    for n in range(1, len(chain) - 1):
        sides = [(chain[0], chain[n]), (chain[n], chain[-1])]
        inner = [side for side, gap in zip(sides, (n, len(chain) - 1 - n), strict=True) if gap > 1]
        if any(_FACES_OF[p] & _FACES_OF[q] for p, q in inner):
            continue
        before, behind = triangles(chain[: n + 1]), triangles(chain[n:])
        if before is not None and behind is not None:
            return [*before, (chain[0], chain[n], chain[-1]), *behind]
    return None


def _table() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of facets of each case (256,), and their grid edges (256, MOST_FACETS, 3)."""
    counts, edges = np.zeros(256, dtype=np.int64), np.zeros((256, MOST_FACETS, 3), dtype=np.int64)
    for case in range(256):
        made = [triangle for chain in loops(case) for triangle in triangles(chain) or []]
        counts[case] = len(made)
        edges[case, : len(made)] = np.array(made).reshape(-1, 3)
    return counts, edges


FACET_COUNT, FACET_EDGES = _table()
