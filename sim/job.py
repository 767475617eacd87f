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
    """What a proof needs to know of a Program (see planner/program.py for the meaning of each field)."""

    @property
    def part_name(self) -> str: ...  # noqa: D102
    @property
    def process(self) -> str: ...  # noqa: D102
    @property
    def material(self) -> str: ...  # noqa: D102
    @property
    def tolerance_mm(self) -> float: ...  # noqa: D102
    @property
    def lines(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def table(self) -> NDArray[np.void]: ...  # noqa: D102
    @property
    def schedule(self) -> NDArray[np.void]: ...  # noqa: D102
    @property
    def machine_from_build(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def build_from_part(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def work_offset(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def gate(self) -> str: ...  # noqa: D102


class TriangleMesh(Protocol):
    """Vertices (n, 3) float, mm, part frame; facets (m, 3) int."""

    @property
    def vertices(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def facets(self) -> NDArray[np.int64]: ...  # noqa: D102
