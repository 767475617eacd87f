"""Numbers as words of a block: decimals that keep the tip, fixed point without needless digits, feeds to what a drive can hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Floats

Ints = NDArray[np.int64]

_ROUNDING_SHARE = 0.1
"""Of the chord tolerance: what rounding of one word may move the tip."""
_FEED_DIGITS = 5  # significant; 0.001 % of a speed is below what any drive holds
_MAX_DECIMALS = 6


@dataclass(frozen=True)
class Words:
    """How joints become axis words: letters, decimals and work offset, in the order of the cell's axes."""

    letters: tuple[str, ...]
    decimals: Ints
    offset: Floats

    @classmethod
    def of(cls, cell: Cell, work_offset: Floats) -> Words:
        """Fewest decimals whose rounding moves no tip in the build volume by more than a tenth of the chord tolerance."""
        low, high = np.array(cell.build_volume.min_mm), np.array(cell.build_volume.max_mm)
        reach = float(np.linalg.norm(high - low))  # mm per radian
        step = 2.0 * _ROUNDING_SHARE * cell.chord_tolerance_mm
        steps = np.array([step if axis.kind == "linear" else np.rad2deg(step / reach) for axis in cell.axes])
        decimals = np.maximum(np.ceil(-np.log10(steps)), 0).astype(np.int64)
        return cls(cell.letters, np.minimum(decimals, _MAX_DECIMALS), work_offset)

    def counts(self, joints: Floats) -> Ints:
        """(n, 5) int: words of joints (n, 5), in units of their last decimal."""
        return np.asarray(np.rint((joints - self.offset) * 10.0**self.decimals), dtype=np.int64)

    def values(self, counts: Ints) -> Floats:
        """(n, 5) float: what the words say, in the work offset's coordinates."""
        return np.asarray(counts / 10.0**self.decimals)

    def joints(self, counts: Ints) -> Floats:
        """(n, 5) float: machine coordinates that the words stand for."""
        return self.values(counts) + self.offset


def decimal(count: int, decimals: int) -> str:
    """A number of fixed point as few characters as it has digits: 12500, 3 -> 12.5."""
    if decimals == 0:
        return str(count)
    sign = "-" if count < 0 else ""
    whole, part = divmod(abs(count), 10**decimals)
    digits = f"{part:0{decimals}d}".rstrip("0")
    return f"{sign}{whole}.{digits}" if digits else f"{sign}{whole}"


def feed_counts(feeds: Floats) -> tuple[Ints, Ints]:
    """Feeds (n,) to five significant digits as numbers of fixed point: (n,) counts and (n,) decimals."""
    magnitude = np.floor(np.log10(np.maximum(feeds, 1e-6))).astype(np.int64)
    places = np.clip(_FEED_DIGITS - 1 - magnitude, 0, _MAX_DECIMALS)
    return np.rint(feeds * 10.0**places).astype(np.int64), places


def feed_word(feed: float) -> str:
    """One F-word."""
    counts, places = feed_counts(np.array([feed]))
    return "F" + decimal(int(counts[0]), int(places[0]))
