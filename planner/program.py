"""The Program: a Plan for one cell and one placement, as G-code lines, what each line stands for, and the process schedule. Data only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

PROGRAM_SCHEMA = 2


class LineKind(IntEnum):
    """What a line is there for."""

    SETUP = 0
    LINK = 1
    PROCESS = 2
    DWELL = 3
    TOOL = 4


class Channel(IntEnum):
    """What an entry of the schedule sets. MODE is a guarded transaction of the cell (0 safe, 1 deposit, 2 mill)."""

    MODE = 0
    LASER_W = 1
    POWDER_G_MIN = 2
    CARRIER_GAS_L_MIN = 3
    SHIELD_GAS_L_MIN = 4
    EMISSION = 5


LINE_DTYPE = np.dtype(
    [
        ("n", "<i4"),  # the N-word; line i of the text has n = i + 1
        ("kind", "u1"),  # LineKind
        ("layer", "<i4"),
        ("operation", "<i4"),  # index over the whole Plan, -1: none
        ("pass_", "<i4"),  # index in the operation, -1: none
        ("arc_start_mm", "<f8"),  # along the pass
        ("arc_end_mm", "<f8"),
        ("time_start_s", "<f8"),  # predicted, from the start of the Program, waits of barriers not counted
        ("time_end_s", "<f8"),
        ("tip_end", "<f8", (3,)),  # mm, build frame, at the end of the line
        ("axis_end", "<f8", (3,)),  # unit vector, build frame
        ("joints_end", "<f8", (5,)),  # mm or deg, machine coordinates, in the order of the cell's axes
        ("bulge", "<f8"),  # of an arc in the machine's XY plane: tan(sweep / 4), counter-clockwise > 0; 0: straight
    ]
)

SCHEDULE_DTYPE = np.dtype(
    [
        ("n", "<i4"),  # applies at the start of this line
        ("channel", "u1"),  # Channel
        ("barrier", "u1"),  # 1: the line waits until all before it is executed, the value is set and its read-back is steady
        ("value", "<f8"),  # W, g/min, L/min, mode number, 0/1
    ]
)


@dataclass(frozen=True)
class Continues:
    """What a resumed Program goes on from. Its table's rows carry layer, operation, pass and arc length of the original.

    program_sha256 : of the original's program.json   line, fraction : where metal ended there, index of the line (N-word less 1)
    layer, operation, pass_, arc_mm : of the place of re-entry   resumed_line : index of the original's first line that is run as it was
    head_lines : lines before that one here   overlap_mm, lead_in_mm : along the pass, before metal's end; 0, 0: at the begin of a pass
    """

    program_sha256: str
    line: int
    fraction: float
    layer: int
    operation: int
    pass_: int
    arc_mm: float
    resumed_line: int
    head_lines: int
    overlap_mm: float
    lead_in_mm: float


@dataclass(frozen=True)
class ProcessWindow:
    """What the version of the material that a Program was posted with allows, each as (least, greatest). material_sha256 : which version"""

    material_sha256: str
    laser_w: tuple[float, float]
    powder_g_min: tuple[float, float]

    @classmethod
    def from_document(cls, told: Mapping[str, Any]) -> ProcessWindow:
        """From its JSON. Raises LookupError, TypeError, ValueError for what is none."""
        laser_w, powder_g_min = (_range(name, told[name]) for name in ("laser_w", "powder_g_min"))
        return cls(str(told["material_sha256"]), laser_w, powder_g_min)


def _range(name: str, told: Any) -> tuple[float, float]:
    low, high = (float(value) for value in told)
    if not 0.0 <= low <= high < math.inf:
        raise ValueError(f"window: {name} is from {low} to {high}")
    return low, high


@dataclass(frozen=True)
class Program:
    """A postable, provable, runnable job.

    lines : G-code, one command line each, without newline; line i carries N(i+1)
    table : (n,) LINE_DTYPE
    schedule : (k,) SCHEDULE_DTYPE, ordered by n; barrier entries of one line are carried out in order before the line is sent
    layer_starts : (layers + 1,) int, first line index of each layer; lines before layer 0 are set-up
    machine_from_build : (4, 4) float, build frame to table frame (= machine frame at all joints zero)
    build_from_part : (4, 4) float
    work_offset : (5,) float, G54 that the controller must hold, order of the cell's axes
    gate : "stream" (M62/M63 in the text) or "modbus" (EMISSION entries in the schedule)
    stock_allowance_mm : process "mill": what it cuts from is the part's box, grown by this sideways and upwards; None: a given stock
    continues : of which Program, from which point on, this one makes the rest; None: it makes the whole part
    window : of the material; None: nothing is deposited, or it was posted by a version that did not say
    """

    part_name: str
    cell_name: str
    dialect: str
    plan_sha256: str
    mesh_sha256: str
    cell_sha256: str
    tolerance_mm: float
    process: str
    material: str
    lines: tuple[str, ...]
    table: NDArray[np.void]
    schedule: NDArray[np.void]
    layer_starts: NDArray[np.int64]
    axis_letters: tuple[str, ...]
    machine_from_build: NDArray[np.float64]
    build_from_part: NDArray[np.float64]
    work_offset: NDArray[np.float64]
    gate: str
    tools: tuple[int, ...]
    duration_s: float
    stock_allowance_mm: float | None = None
    continues: Continues | None = None
    window: ProcessWindow | None = None
    schema: int = PROGRAM_SCHEMA
