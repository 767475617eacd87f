"""What the tool did in one step, piece by piece: the only thing that the metal gets to know."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """Pieces of motion in order of time; `dt.sum()` is the time that went by, pieces at standstill included.

    tip0, tip1 : (k, 3) float, mm    Tip at begin and end of each piece, table frame.
    axis0, axis1 : (k, 3) float    Tool axis (tip into head), table frame.
    down : (k, 3) float    Direction of gravity at the end of each piece, table frame.
    emission_w : (k,) float, W    Mean emitted power over the piece.
    powder_g_min : (k,) float    Powder that leaves the nozzle.
    dt : (k,) float, s
    line : (k,) int    N-word of the line that moved, 0 for none.
    joints0, joints1 : (k, n) float, mm or deg    Real joint positions.
    tool : number in the spindle; spindle_rpm at the end of the step; head_deployed: slide of the deposition head is out.
    """

    tip0: Floats
    tip1: Floats
    axis0: Floats
    axis1: Floats
    down: Floats
    emission_w: Floats
    powder_g_min: Floats
    dt: Floats
    line: NDArray[np.int64]
    joints0: Floats
    joints1: Floats
    tool: int
    spindle_rpm: float
    head_deployed: bool

    def __len__(self) -> int:
        return len(self.dt)

    def part(self, first: int, last: int) -> Trace:
        """Pieces from `first` to `last` (exclusive)."""
        columns = {field.name: getattr(self, field.name) for field in fields(self)}
        pieces: dict[str, Any] = {name: value[first:last] for name, value in columns.items() if isinstance(value, np.ndarray)}
        return replace(self, **pieces)
