"""The way back to the part: rotary axes first while the machine is clear of everything, then over the place, then down along the tool's axis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from config.cell import Cell, Tool
from planner.collide.guard import Guard
from planner.errors import ReachError
from planner.kinematics.chain import TOOL_AXIS, Chain, Floats
from planner.kinematics.inverse import linear_joints
from planner.kinematics.limits import check_travel, excess
from planner.plan import Plan
from planner.post.retract import Retract
from planner.program import Program

_ALONG = 0.9999  # cosine: the tool's axis goes along the retracting one
_LIFTS = (1.0, 3.0, 8.0, 20.0)  # of the clearance: how far out along the tool's axis, tried in order


@dataclass(frozen=True)
class Approach:
    """Joints (5,), in the order in which they are taken up.

    turned : rotary axes as at the place, all else as after the retract   over : above the place, retracted
    clear : the tool stands clear of the part   target : where the pass, or the link that leads to it, goes on
    """

    turned: Floats
    over: Floats
    clear: Floats
    target: Floats



def approach_to(
    target: Floats,
    tool: Tool,
    cell: Cell,
    chain: Chain,
    clearance_mm: float,
    is_direct: bool,
    standing: Guard | None,
    done: int,
) -> Approach:
    """The way to joints (5,) `target`.

    is_direct : the target stands on the part; else it is clear of it   standing : the part as it stands then, None: nobody looks
    done : last pass of the operation that the guard has begun whose cut is gone
    Raises ReachError: what meets what on the last way tried; TravelLimitError.
    """
    retract = Retract.of(chain, cell)
    check_travel(cell.axes, target[None, :], "at the place of re-entry")
    why = ""
    for clear in _clear_places(target, tool, cell, chain, clearance_mm if is_direct else 0.0, retract):
        found = _way(target, clear, cell, retract)
        rows = np.vstack([found.turned, found.over, found.clear, found.target])
        if excess(cell.axes, rows).any():
            why = why or "an axis would leave its travel"
            continue
        if standing is None or not standing.is_watching:
            return found
        seen = standing.clearance(
            tool, rows, cuts=False, limit_mm=0.0, joined=np.arange(4) > 0, passes=np.full(4, done)
        )
        is_hit = standing.hits(seen)
        if not is_hit[:3].any() and not (is_hit[3] and not is_direct):
            return found
        why = seen.why(int(np.argmin(np.where(is_hit, seen.mm, np.inf))))
    raise ReachError(
        f"no way leads back to the place of re-entry: {why}", "resume from the begin of its operation, or of its layer"
    )


def _clear_places(
    target: Floats, tool: Tool, cell: Cell, chain: Chain, clearance_mm: float, retract: Retract
) -> Iterator[Floats]:
    """Joints that stand clear of the part above the target, along the tool's axis as seen from the table; the nearest first."""
    if clearance_mm <= 0.0:
        yield target
        return
    tip, axis = chain.forward(target[None, :], np.array(tool.tip_mm))
    lifts = np.array(_LIFTS) * clearance_mm
    direct = np.abs(chain.linear_directions(target[None, :])[0] @ TOOL_AXIS)
    for lift in lifts.tolist():
        clear = linear_joints(chain, target[None, :], tip + lift * axis, np.array(tool.tip_mm))[0]
        if direct.max() > _ALONG and np.abs(np.delete(clear - target, retract.column)).max() < 1e-9:
            clear[retract.column] = retract.way * min(retract.way * clear[retract.column], retract.way * retract.end)
        yield clear


def _way(target: Floats, clear: Floats, cell: Cell, retract: Retract) -> Approach:
    turned, over = np.array([axis.home for axis in cell.axes]), clear.copy()
    for column, axis in enumerate(cell.axes):
        if axis.kind == "rotary":
            turned[column] = target[column]
    turned[retract.column] = over[retract.column] = retract.end
    return Approach(turned, over, clear, target)


def guard_at(plan: Plan, program: Program, cell: Cell, chain: Chain, operation: int, pass_: int) -> Guard:
    """The part as it stands in a pass of an operation, by the Plan. Raises PostError if the cell's bodies cannot be read."""
    guard = Guard(plan, cell, chain, program.machine_from_build)
    if not guard.is_watching:
        return guard
    for number, item in enumerate(plan.operations[: operation + 1]):
        if not item.passes:
            continue
        if number < operation:
            guard.advance(item)
        elif item.process.is_deposit:
            guard.advance(replace(item, passes=item.passes[: pass_ + 1]))
        else:
            guard.begin(item)
    return guard
