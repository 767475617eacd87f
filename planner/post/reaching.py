"""With which tool and which poses an operation is done, so that nothing is hit: one that reaches all of its passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from config.cell import Tool
from planner.plan import Operation
from planner.post.linearise import LinearOperation, linearise
from planner.post.pass_curve import PassCurve
from planner.post.tools import tool_for

if TYPE_CHECKING:
    from planner.post.sequence import Sequencer


@dataclass(frozen=True)
class Reached:
    """tool : that does it   curves : its passes, with the axes that they are run with   moves : of the joints."""

    tool: Tool
    curves: Sequence[PassCurve]
    moves: LinearOperation


def reach_operation(operation: Operation, curves: Sequence[PassCurve], sequencer: Sequencer) -> Reached:
    """Tool and moves of an operation from where the machine stands.

    Raises PostError, ReachError or TravelLimitError, one line: what does not go, where.
    """
    cell = sequencer.cell
    tool = tool_for(operation, cell)
    start = sequencer.tape.joints
    moves = linearise(curves, sequencer.solver(tool), start, cell.chord_tolerance_mm, cell.axis_tolerance_deg)
    return Reached(tool, curves, moves)
