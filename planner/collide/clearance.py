"""How near the bodies of a cell come to each other and to the part, pose by pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Clearance:
    """Least clearance in each pose.

    mm : (n,) float, less than 0: how deep two things are in each other; at most what was asked for
    pairs : (n,) int, row of `names`, -1 where nothing is nearer than asked   places : (n, 3) float, mm, build frame
    names : what meets what, as in `config.machine`: "T2 holder", "clamp 1", "nozzle", "part" …
    """

    mm: Floats
    pairs: Ints
    places: Floats
    names: tuple[tuple[str, str], ...]

    def pair(self, row: int) -> tuple[str, str]:
        """The two that are nearest in a pose; ("", "") where nothing is nearer than asked."""
        return self.names[int(self.pairs[row])] if self.pairs[row] >= 0 else ("", "")

    def place(self, row: int) -> Floats:
        """(3,) mm, build frame: where they are nearest, or deepest in each other."""
        return np.asarray(self.places[row])

    def why(self, row: int) -> str:
        """One line: what meets what by how much, where."""
        first, second = self.pair(row)
        if not first:
            return f"nothing is nearer than {float(self.mm[row]):.1f} mm"
        x, y, z = self.places[row]
        gap = float(self.mm[row])
        meets = f"{first} meets {second} by {-gap:.1f} mm" if gap < 0.0 else f"{first} is {gap:.1f} mm from {second}"
        return f"{meets} at x {x:.1f} y {y:.1f} z {z:.1f} mm of the part"

    def nearer(self, other: Clearance) -> Clearance:
        """Of two clearances of the same poses the lesser one in each."""
        is_other = other.mm < self.mm
        shifted = np.where(other.pairs >= 0, other.pairs + len(self.names), -1)
        return Clearance(
            np.where(is_other, other.mm, self.mm),
            np.where(is_other, shifted, self.pairs),
            np.where(is_other[:, None], other.places, self.places),
            (*self.names, *other.names),
        )
