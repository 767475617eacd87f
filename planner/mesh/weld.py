"""Vertices with equal coordinates made one, by hashing the coordinates' bits."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_FIRST_SLOTS = 1 << 12
"""Slots of the empty table; it grows fourfold whenever it is half full, so that it stays as small as the mesh allows."""


@njit(cache=True)
def _slot_of(words: NDArray[np.uint32], row: int, slots: int) -> int:
    """Where the search for a row of words (n, 6) begins; products stay below 2**63.  Source: MurmurHash2, Appleby."""
    mixed = 0
    for axis in range(6):
        mixed = ((mixed ^ int(words[row, axis])) * 0x5BD1E995) & 0xFFFFFFFF
        mixed ^= mixed >> 15
    return int(mixed & (slots - 1))


@njit(cache=True)
def _is_equal(words: NDArray[np.uint32], p: int, q: int) -> bool:
    same = True
    for axis in range(6):
        same &= words[p, axis] == words[q, axis]
    return same


@njit(cache=True)
def _number_equal(words: NDArray[np.uint32]) -> tuple[Ints, Ints]:
    """Number of every row of words (n, 6) among the different ones, and the first row of each of those."""
    count = words.shape[0]
    number = np.empty(count, np.int64)
    first = np.empty(count, np.int64)
    found = 0
    table = np.full(_FIRST_SLOTS, -1, np.int32)
    for row in range(count):
        if 2 * found >= table.shape[0]:
            table = np.full(4 * table.shape[0], -1, np.int32)
            for k in range(found):
                slot = _slot_of(words, first[k], table.shape[0])
                while table[slot] >= 0:
                    slot = (slot + 1) & (table.shape[0] - 1)
                table[slot] = k
        slot = _slot_of(words, row, table.shape[0])
        while True:
            k = table[slot]
            if k < 0:
                table[slot] = found
                first[found] = row
                number[row] = found
                found += 1
                break
            if _is_equal(words, first[k], row):
                number[row] = k
                break
            slot = (slot + 1) & (table.shape[0] - 1)
    return number, first[:found].copy()


def unique_vertices(vertices: Floats) -> tuple[Floats, Ints]:
    """Merge vertices with exactly equal coordinates, in order of first appearance.

    vertices : (n, 3) float, finite.  Returns (k, 3) float and, for each of the n, its number among the k.
    """
    plain = np.ascontiguousarray(vertices, dtype=np.float64) + 0.0  # -0 and 0 are one
    number, first = _number_equal(plain.view(np.uint32).reshape(-1, 6))
    return plain[first], number
