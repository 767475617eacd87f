"""How long blocks have to last at least: what the control takes in per second, and what the serial line carries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Floats
from planner.post.words import Words

Ints = NDArray[np.int64]

LINE_SHARE = 0.9
"""Of the serial line's bytes per second (10 bits each): what a program takes; status reports are asked for on it too."""
HELD_BLOCKS = 15
"""Blocks that every control holds ahead: grbl's planner has 16. So many may come faster than the line, from what it has in store."""
_NUMBER_BYTES = 8  # N, six digits, the new line
_FEED_BYTES = 7  # F and five digits with their point
_ARC_BYTES = 2  # G2
_CENTRE_EXTRA = 1  # decimals of I and J beyond those of X and Y
_MARGIN = 1e-9  # relative: a block as long as it has to be is not short


@dataclass(frozen=True)
class LineRate:
    """least_s : s, of one block at the control's rate   bytes_per_s : what the line carries of a program"""

    words: Words
    is_rotary: NDArray[np.bool_]
    plane: tuple[int, int]
    least_s: float
    bytes_per_s: float

    @classmethod
    def of(cls, cell: Cell) -> LineRate:
        """Of a cell with its nominal work offset."""
        offset = np.array([cell.placement.work_offset.get(letter, 0.0) for letter in cell.letters])
        rotary = np.array([axis.kind == "rotary" for axis in cell.axes])
        plane = cell.letters.index("X"), cell.letters.index("Y")
        least_s = 1.0 / cell.cnc.max_blocks_per_s
        return cls(Words.of(cell, offset), rotary, plane, least_s, LINE_SHARE * cell.cnc.baud / 10.0)

    def line_bytes(self, joints: Floats, bulge: Floats) -> Ints:
        """(n - 1,) int: bytes of the lines of moves between joints (n, 5), at most; bulge : (n - 1,) of arcs.

        Words of axes that move, and F where a rotary axis does (inverse time); needless zeros are counted.
        """
        counts = self.words.counts(joints)
        says = np.diff(counts, axis=0) != 0
        units = 10**self.words.decimals
        whole = np.abs(counts[1:]) // units
        digits = np.floor(np.log10(np.maximum(whole, 1))).astype(np.int64) + 1
        places = self.words.decimals + (self.words.decimals > 0)
        sizes = np.where(says, 1 + (counts[1:] < 0) + digits + places, 0).sum(axis=1)
        timed = says[:, self.is_rotary].any(axis=1)
        centre = 2 * (3 + int(digits.max(initial=1)) + int(places[list(self.plane)].max()) + _CENTRE_EXTRA)
        return np.asarray(
            _NUMBER_BYTES + sizes + _FEED_BYTES * timed + (bulge != 0.0) * (_ARC_BYTES + centre), dtype=np.int64
        )

    def least_times(self, joints: Floats, bulge: Floats, times_s: Floats) -> Floats:
        """(n - 1,) float, s: what each move has to last, given what it and those before it would: times_s (n - 1,).

        No move shorter than the control's least; and where more bytes come than the line carries for longer than the control's
        HELD_BLOCKS last, moves are lengthened to what it carries.
        """
        need_s = self.line_bytes(joints, bulge) / self.bytes_per_s
        return _carried(np.maximum(times_s, self.least_s), need_s, self.least_s)

    def slow(self, times_s: Floats, least_s: Floats) -> NDArray[np.bool_]:
        """(n - 1,) bool: moves that have to last longer than they would."""
        return np.asarray(times_s < least_s * (1.0 - _MARGIN))


@njit(cache=True)
def _carried(times_s: Floats, need_s: Floats, least_s: float) -> Floats:
    """The least times: the line is behind by what it needs more than the moves last, at most by what HELD_BLOCKS of them need."""
    result = np.full(len(times_s), least_s)
    behind, store = 0.0, 0.0
    for i in range(len(times_s)):
        store += need_s[i]
        if i >= HELD_BLOCKS:
            store -= need_s[i - HELD_BLOCKS]
        behind = max(behind + need_s[i] - times_s[i], 0.0)
        if behind > store:
            result[i] = times_s[i] + behind - store
            behind = store
    return result
