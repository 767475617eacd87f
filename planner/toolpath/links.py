"""Ways between passes: short ones in the layer with the laser off, all others lifted clear of the metal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import PlanningError
from planner.plan import Operation, Pass
from planner.process import Settings
from planner.toolpath.motion import UP, axis_at, process_pass, straight, turning

Floats = NDArray[np.float64]

CLEARANCE_MM = 5.0
"""Above the highest metal on lifted ways: a disc of the cutter that leans by 70 degrees still passes."""
APPROACH_MM = 2.0
"""The last stretch down to the metal is run at feed."""
RAPID_MM_S = 100.0  # nominal: a rapid goes as fast as the cell allows
_SHORT_STEPS = 3.0  # bead widths and leads: up to here the head stays in the layer between hatch lines
_LEAST_AXIS_Z = 0.05  # below it lifting along the axis leads nowhere
_MET_MM = 1e-6
_HOP = np.array([0.0, 0.0, 1.0])  # mm: room to turn in, where the tip need not go anywhere


@dataclass(frozen=True)
class Pose:
    """Where the tool is.  tip : (3,) float, mm   axis : (3,) float, unit."""

    tip: Floats
    axis: Floats

    def raised_to(self, z: float) -> Pose:
        """The pose lifted along its axis until the tip is at height z; itself where it is higher.

        Raises PlanningError if the axis lies so flat that lifting along it leads nowhere.
        """
        if self.tip[2] >= z:
            return self
        if self.axis[2] < _LEAST_AXIS_Z:
            raise PlanningError("the tool axis lies flat: it cannot be lifted clear along itself", "turn the part")
        return Pose(self.tip + (z - self.tip[2]) / self.axis[2] * self.axis, self.axis)


def start_of(step: Pass) -> Pose:
    """Where a pass begins."""
    low = step.tip.domain[0]
    return Pose(step.tip.evaluate([low])[0], axis_at(step.axis, low))


def end_of(step: Pass) -> Pose:
    """Where a pass ends."""
    high = step.tip.domain[1]
    return Pose(step.tip.evaluate([high])[0], axis_at(step.axis, high))


def linked(
    operation: Operation, here: Pose | None, metal_top: float, settings: Settings, standing_mm: float = 0.0
) -> tuple[Operation, Pose]:
    """The operation with the ways to, between and from its passes, and the pose in which it leaves the tool.

    here : pose before it (None: a piece begins, clear above the first pass)   metal_top : highest metal of the piece, mm
    standing_mm : highest of what else stands under the ways.
    It ends lifted clear, so that the tool may be changed; every pass starts where the one before it ends.
    """
    clear = max(metal_top, standing_mm) + CLEARANCE_MM
    passes: list[Pass] = []
    for number, step in enumerate(operation.passes):
        goal = start_of(step)
        if here is None:
            here = goal.raised_to(clear)
        way = None
        if number and operation.process.is_deposit:
            way = _short_way(here, goal, operation, settings)
        passes.extend(way if way is not None else _lifted_way(here, goal, metal_top, clear, step, operation))
        passes.append(step)
        here = end_of(step)
    assert here is not None  # an operation has at least one pass
    up = here.raised_to(clear)
    if np.linalg.norm(up.tip - here.tip) > _MET_MM:
        passes.append(_link([here, up], RAPID_MM_S, None, True))
    return replace(operation, passes=tuple(passes)), up


def taken_up(
    here: Pose | None, before: Operation | None, operation: Operation, is_beside: bool = False
) -> Pose | None:
    """The pose to link an operation from; none where another tool begins with another axis, or beside what stands.

    is_beside : something stands beside the piece. The tool is changed up at the machine's retract; the other one need not
    come down where it would lean otherwise, or where only the first one, longer or thinner, has room.
    """
    if here is None or before is None or not operation.passes:
        return here
    is_other = (before.process.is_deposit, before.cutter_diameter_mm) != (
        operation.process.is_deposit,
        operation.cutter_diameter_mm,
    )
    turns = np.abs(start_of(operation.passes[0]).axis - here.axis).max() > 1e-9
    return None if is_other and (turns or is_beside) else here


def linked_from_beside(operation: Operation, here: Pose, beyond: Pose, metal_top: float) -> tuple[Operation, Pose]:
    """The operation with ways to and from its one pass, which begins and ends on a straight way in from the side.

    beyond : beside the whole part, with the pass's axis, in line with where it begins   metal_top : highest metal, mm.
    Upright over the part, turned beside it, down beside it, straight in; back the same way.
    """
    clear = metal_top + CLEARANCE_MM
    (step,) = operation.passes
    over = Pose(np.array([*beyond.tip[:2], max(clear, float(beyond.tip[2]))]), beyond.axis)
    upright = Pose(over.tip, UP)
    way_in = [here.raised_to(clear), upright, over, beyond, start_of(step)]
    way_out = [end_of(step), beyond, over, upright]
    passes = (_link([here, *way_in], RAPID_MM_S, None, True), step, _link(way_out, RAPID_MM_S, None, True))
    return replace(operation, passes=passes), end_of(passes[-1])


def _short_way(here: Pose, goal: Pose, operation: Operation, settings: Settings) -> list[Pass] | None:
    """Straight on in the layer at the pass's feed with the laser off, if that is short; None if it is not."""
    facts = settings.material.deposition
    reach = _SHORT_STEPS * operation.bead_width_mm + facts.lead_in_mm + facts.lead_out_mm
    distance = float(np.linalg.norm(goal.tip - here.tip))
    if distance > reach or np.abs(goal.axis - here.axis).max() > 1e-9:
        return None
    if distance <= _MET_MM:
        return []
    row = operation.passes[0].setpoints[0]
    return [_link([here, goal], float(row[1]), row, False)]


def _lifted_way(
    here: Pose, goal: Pose, metal_top: float, clear: float, step: Pass, operation: Operation
) -> list[Pass]:
    """Up along the axis, over (turning to the goal's axis there), down along that axis, the last stretch at feed."""
    over_start, over_end = here.raised_to(clear), goal.raised_to(clear)
    near = goal.raised_to(max(metal_top, float(goal.tip[2])) + APPROACH_MM)
    row = step.setpoints[0] if operation.process.is_deposit else None
    rapid = [_link([here, over_start, over_end, near], RAPID_MM_S, row, True)]
    if np.linalg.norm(near.tip - goal.tip) <= _MET_MM:
        return rapid
    return [*rapid, _link([near, goal], float(step.setpoints[0, 1]), row, False)]


def _link(poses: list[Pose], feed_mm_s: float, row: Floats | None, rapid: bool) -> Pass:
    """A link pass through poses; powder and gas stay as in row. Poses that only turn are lifted by a millimetre."""
    kept = [poses[0]]
    for pose in poses[1:]:
        if np.linalg.norm(pose.tip - kept[-1].tip) > _MET_MM:
            kept.append(pose)
        elif np.abs(pose.axis - kept[-1].axis).max() > 1e-9:
            kept.append(Pose(pose.tip + _HOP, pose.axis))
    if len(kept) == 1:
        kept = [kept[0], Pose(kept[0].tip + _HOP, kept[0].axis), kept[0]]
    tips, axes = np.array([pose.tip for pose in kept]), np.array([pose.axis for pose in kept])
    powder, gas = (0.0, 0.0) if row is None else (float(row[3]), float(row[4]))
    motion = straight(tips, axes[0]) if np.abs(axes - axes[0]).max() < 1e-12 else turning(tips, axes)
    return process_pass(motion, [0.0, feed_mm_s, 0.0, powder, gas], is_link=True, rapid=rapid)
