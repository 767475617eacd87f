"""LinuxCNC: G64 P Q, gate and power on outputs that switch with the motion (M62/M63, M67), NURBS in the XY plane (G5.2, G5.3)."""

from __future__ import annotations

from config.cell import Cell
from config.macros import DialectName, Macros
from planner.post.blocks import write
from planner.post.read_blocks import LINUXCNC, Reading
from planner.post.read_blocks import read as read_blocks
from planner.program import Program

__all__ = ["MACROS", "NAME", "fitted", "has_splines", "read", "remarks", "values", "write"]

NAME: DialectName = "linuxcnc"
MACROS = Macros(
    start=("G17 G21 G40 G49", "G54 G90 G94", "G64 P{path_mm} Q{merge_mm}"),
    home=(), tool_change=("M6 T{tool}",), probe=(), end=("M2",),
)  # fmt: skip
has_splines = True

# How the chord tolerance is shared out: what the control may leave corners (P) and drop points (Q); the written moves keep the rest.
_PATH_SHARE = 0.3
_MERGE_SHARE = 0.1
_GATE_OUTPUT = 0
_POWER_OUTPUT = 0


def fitted(cell: Cell) -> Cell:
    """The cell with the share of the tolerance that the moves may use, and with the outputs 0 where the file names none."""
    cnc = cell.cnc
    outputs = {
        "laser_gate_output": _GATE_OUTPUT if cnc.laser_gate_output is None else cnc.laser_gate_output,
        "power_output": _POWER_OUTPUT if cnc.power_output is None else cnc.power_output,
    }
    left = (1.0 - _PATH_SHARE - _MERGE_SHARE) * cell.chord_tolerance_mm
    return cell.model_copy(update={"cnc": cnc.model_copy(update=outputs), "chord_tolerance_mm": left})


def values(cell: Cell) -> dict[str, str]:
    """P and Q of G64 for the fitted cell, mm: with the moves' own share they stay within the tolerance of the cell file."""
    whole = cell.chord_tolerance_mm / (1.0 - _PATH_SHARE - _MERGE_SHARE)
    return {"path_mm": f"{_PATH_SHARE * whole:.6g}", "merge_mm": f"{_MERGE_SHARE * whole:.6g}"}


def remarks(cell: Cell) -> list[str]:
    """Which outputs are used, and what the power's number means."""
    return [f"gate M62 M63 P{cell.cnc.laser_gate_output}, power M67 E{cell.cnc.power_output} Q in W"]


def read(program: Program) -> Reading:
    """What the text says. Raises PostError with the line where it is not what this dialect writes."""
    return read_blocks(program, LINUXCNC)
