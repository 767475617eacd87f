"""A Program as the simulated cell reads it: the fields that it needs, and the numbers of the schedule's channels (facts, written again here)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

MODE, LASER_W, POWDER_G_MIN, CARRIER_GAS_L_MIN, SHIELD_GAS_L_MIN, EMISSION = range(6)
SAFE, DEPOSIT, MILL = range(3)
PROCESS_LINE = 2


class Job(Protocol):
    """What a proof needs to know of a Program."""

    @property
    def part_name(self) -> str:
        """Name of the part."""

    @property
    def process(self) -> str:
        """"hybrid", "deposit" or "mill"."""

    @property
    def material(self) -> str:
        """Name of the powder."""

    @property
    def tolerance_mm(self) -> float:
        """Allowed deviation, mm."""

    @property
    def lines(self) -> Sequence[str]:
        """G-code, one command line each, without newline."""

    @property
    def table(self) -> NDArray[np.void]:
        """(n,) records with kind, layer and operation of each line."""

    @property
    def schedule(self) -> NDArray[np.void]:
        """(k,) records n, channel, barrier, value, ordered by n."""

    @property
    def machine_from_build(self) -> NDArray[np.float64]:
        """(4, 4) build frame to table frame."""

    @property
    def build_from_part(self) -> NDArray[np.float64]:
        """(4, 4) frame of the file to build frame."""

    @property
    def work_offset(self) -> NDArray[np.float64]:
        """(axes,) G54 that the controller must hold, mm or deg."""

    @property
    def stock_allowance_mm(self) -> float | None:
        """Process "mill": the part's box, grown by this sideways and upwards, is what it cuts from; None: a given stock."""

    @property
    def gate(self) -> str:
        """"stream" (M62/M63 in the text) or "modbus" (EMISSION entries in the schedule)."""
