"""A control without a changer pauses (M0) where a tool is to be put in by hand: told by name, and let go on only when a person says so."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from cellctl.cell.cnc_checks import SPINDLE_STANDS_RPM
from cellctl.cell.program_text import COMMENT
from drivers.cnc.protocol import SPINDLE_STOP
from planner.program import LineKind

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller
    from cellctl.cell.stream import Run
    from drivers.cell_wires import CellDrivers

_PAUSE = re.compile(r"M0?[01](?!\d)")


def asked_tool(run: Run, drivers: CellDrivers) -> int | None:
    """Number of the tool for which a Program's own pause holds the machine; None: it is held, or runs, for something else."""
    status, index = drivers.cnc.status, drivers.cnc.counts.acknowledged  # the pause is answered when the machine was let go
    if status is None or status.state != "Hold" or index >= run.total:
        return None
    kinds = run.program.table["kind"]
    if kinds[index] != LineKind.TOOL or not _PAUSE.search(COMMENT.sub("", run.program.lines[index])):
        return None
    others = np.flatnonzero(kinds[index:] != LineKind.TOOL)
    return run.tool_at(index + int(others[0]) if others.size else run.total)


def told_pause(c: Controller, run: Run, drivers: CellDrivers) -> str:
    """What a hold that nobody commanded is for, in a line for the operator. A spindle that turns at a tool change is stopped."""
    number = asked_tool(run, drivers)
    if number is None:
        return "feed hold at the machine"
    if drivers.cnc.status is not None and drivers.cnc.status.rpm > SPINDLE_STANDS_RPM:
        drivers.cnc.urge(SPINDLE_STOP)
    tool = next((tool for tool in c.cell.tools if tool.number == number), None)
    name = f"T{number} ({tool.name})" if tool is not None else f"T{number}"
    return f"put in tool {name} by hand once the spindle stands, then resume"
