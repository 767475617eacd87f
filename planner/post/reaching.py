"""With which tool and which poses an operation is done, so that nothing is hit: one that reaches all of its passes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from config import ConfigError
from config.cell import Tool
from planner.errors import PostError, ReachError
from planner.kinematics.limits import excess
from planner.plan import Operation
from planner.post.blocked import Blocked, looked_at
from planner.post.leaning import Bounds, is_smooth, leaned_clear
from planner.post.linearise import LinearOperation, linearise
from planner.post.pass_curve import PassCurve
from planner.post.pole_pass import is_too_fast, led_round, rotary_load
from planner.post.poses import PoseSolver
from planner.post.smooth_pass import rotary_share, smoothed
from planner.post.tools import tools_for

if TYPE_CHECKING:
    from planner.post.sequence import Sequencer

_SPINS_DEG = (0.0, 90.0, 180.0, -90.0, 45.0, -45.0, 135.0, -135.0)
"""Of the part about an upright tool, where it may stand as it likes."""
_QUARTERS, _BETTER_MM = 3, 0.05  # turns after which it is asked whether turning helps at all, and by how much it should
_MARGINS_MM = (0.5, 1.5)
"""Clearances that leaning keeps at its stations; the greater one where a spline between them came too near."""
_BALL_CONE_DEG = 30.0  # of a ball cutter: its flutes' ball still cuts
_BETTER_SHARE = 0.03  # of the asked speed: what evening has to bring to be worth it
_LEAST_GAIN = 0.9  # of the rotary load: what leading round the pole has to bring to be worth it


@dataclass(frozen=True)
class Reached:
    """tool : that does it   curves : its passes, with the axes that they are run with   moves : of the joints."""

    tool: Tool
    curves: Sequence[PassCurve]
    moves: LinearOperation


@dataclass(frozen=True)
class _Try:
    """A way to do it, what is in its way, and what was changed for it."""

    reached: Reached
    blocked: Blocked
    told: str = ""


def reach_operation(operation: Operation, curves: Sequence[PassCurve], sequencer: Sequencer) -> Reached:
    """Tool and moves of an operation from where the machine stands, nothing hit.

    As planned where that goes. Else, with each tool of the kind and diameter: another angle of a spin that is free, another
    branch, rapid links left to positioning, leaning within the process's cone. What was changed is told in `sequencer.counts`.
    Raises PostError, ReachError or TravelLimitError, one line: what meets what, where, and what would help.
    """
    tools = tools_for(operation, sequencer.cell)
    nearest: _Try | None = None
    failed: PostError | None = None
    for tool in tools:
        work = _Work(operation, tool, sequencer)
        try:
            for tried in work.tries(curves):
                if tried.blocked.is_clear:
                    _tell(tried, tools[0], sequencer)
                    return tried.reached
                if nearest is None or tried.blocked.depth < nearest.blocked.depth:
                    nearest = tried
        except PostError as error:
            failed = failed or error
    if nearest is None:
        raise failed or ReachError(f"no tool reaches {curves[0].place}", "plan the part again")
    if not nearest.blocked.meets[0]:
        return nearest.reached  # nothing is hit: it leaves the travel, which is told with the pose by the sequence
    raise ReachError(nearest.blocked.line, nearest.blocked.hint(nearest.reached.tool, operation.process.is_deposit))


def _tell(tried: _Try, planned: Tool, sequencer: Sequencer) -> None:
    told = [tried.told] if tried.told else []
    if tried.reached.tool.number != planned.number:
        told.append(f"tool {tried.reached.tool.number} instead of {planned.number}, which does not reach")
    place = tried.reached.curves[0].place.partition(" of ")[2]
    sequencer.counts.changes.extend(f"{place}: {text}" for text in told)


class _Work:
    """One operation with one tool."""

    def __init__(self, operation: Operation, tool: Tool, sequencer: Sequencer) -> None:
        self._operation, self._tool, self._sequencer = operation, tool, sequencer
        self._cell, self._guard = sequencer.cell, sequencer.guard
        self._solver = sequencer.solver(tool)

    def tries(self, curves: Sequence[PassCurve]) -> Iterator[_Try]:
        """One way after the other; each is asked for only where those before it are blocked."""
        first = self._evened(self._past_the_pole(self._tried(curves, self._solver)))
        yield first
        best = first
        for other in self._turned(curves, first):
            yield other
            best = min(best, other, key=lambda tried: tried.blocked.depth)
        curves = first.reached.curves
        if first.blocked.only_rapid:
            kept = [curve for k, curve in enumerate(curves) if k not in first.blocked.passes]
            if kept:
                yield self._tried(kept, self._solver, "rapid links that would meet something are gone round by positioning")
        yield from self._leaned(best)

    def _tried(self, curves: Sequence[PassCurve], solver: PoseSolver, told: str = "") -> _Try:
        start = self._sequencer.tape.joints
        moves = linearise(curves, solver, start, self._cell.chord_tolerance_mm, self._cell.axis_tolerance_deg)
        outside = excess(self._cell.axes, moves.poses.joints).max(axis=1)
        blocked = looked_at(self._guard, self._tool, curves, moves, outside)
        return _Try(Reached(self._tool, curves, moves), blocked, told)

    def _past_the_pole(self, first: _Try) -> _Try:
        """The same, or led round the pole where a rotary joint could not follow at the feed and the process may lean."""
        load = rotary_load(first.reached.curves, first.reached.moves, self._solver)
        if not is_too_fast(load) or self._bounds(0.0).cone_deg <= 0.0:
            return first
        curves = led_round(first.reached.curves, load, self._solver, self._guard.placed, self._tool, self._bounds(0.0).cone_deg)
        try:
            led = self._tried(curves, self._solver)
        except ReachError:
            return first
        less = rotary_load(curves, led.reached.moves, self._solver)
        if less.max() > _LEAST_GAIN * load.max() or (first.blocked.is_clear and not led.blocked.is_clear):
            return first
        count = sum(new is not old for new, old in zip(curves, first.reached.curves, strict=True))
        told = (
            f"{count} passes led round the pole: greatest rotary speed asked {100.0 * load.max():.0f} % of the axis' before, "
            f"{100.0 * less.max():.0f} % now"
        )
        return _Try(led.reached, led.blocked, told)

    def _evened(self, first: _Try) -> _Try:
        """The same, or with axes evened along the passes where a rotary joint would slow them and the process may lean."""
        curves, cone_deg = first.reached.curves, self._bounds(0.0).cone_deg
        share = rotary_share(curves, first.reached.moves, self._solver)
        if cone_deg <= 0.0 or not share.short.any():
            return first
        even = smoothed(curves, share.short, first.reached.moves, self._solver, self._guard.placed, self._tool, cone_deg)
        try:
            tried = self._tried(even, self._solver)
        except ReachError:
            return first
        after = rotary_share(even, tried.reached.moves, self._solver)
        better = after.held > share.held + _BETTER_SHARE
        if not better.any() or (first.blocked.is_clear and not tried.blocked.is_clear):
            return first
        if not better[[new is not old for new, old in zip(even, curves, strict=True)]].all():
            even = [new if better[k] else old for k, (new, old) in enumerate(zip(even, curves, strict=True))]
            tried = self._tried(even, self._solver)
        told = (
            f"{int(better.sum())} passes with the axis evened by up to {_lean(curves, even):.2f} deg: rotary joints hold "
            f"{100.0 * share.held[better].min():.0f} % of the asked speed in the worst before, {100.0 * after.held[better].min():.0f} % now"
        )
        return _Try(tried.reached, tried.blocked, "; ".join(text for text in (first.told, told) if text))

    def _turned(self, curves: Sequence[PassCurve], first: _Try) -> Iterator[_Try]:
        """The part turned about an upright tool; each branch by itself."""
        spin = self._solver.pair.columns[self._solver.pair.spin]
        joints = first.reached.moves.poses.joints
        if float(np.ptp(joints[:, list(self._solver.pair.columns)], axis=0).max()) == 0.0:
            depths: list[float] = []
            for angle in _SPINS_DEG:
                if abs(angle - float(joints[0, spin])) <= 1.0:
                    continue
                if len(depths) >= _QUARTERS and min(depths) > first.blocked.depth - _BETTER_MM:
                    return
                told = f"{self._cell.axes[spin].letter} at {angle:g} deg, turned about the upright tool, as planned {first.blocked.why}"
                for tried in self._quiet(curves, self._solver.with_spin(angle), told):
                    depths.append(tried.blocked.depth)
                    yield tried
            return
        for branch in (0, 1):
            yield from self._quiet(curves, self._solver.with_branch(branch), f"other branch of the rotary axes, as planned {first.blocked.why}")

    def _quiet(self, curves: Sequence[PassCurve], solver: PoseSolver, told: str) -> Iterator[_Try]:
        """A try that may not be possible."""
        try:
            yield self._tried(curves, solver, told)
        except ReachError:
            return

    def _leaned(self, best: _Try) -> Iterator[_Try]:
        reached = best.reached
        for margin_mm in _MARGINS_MM:
            bounds = self._bounds(margin_mm)
            if bounds.cone_deg <= 0.0:
                return
            curves = leaned_clear(
                reached.curves, reached.moves, best.blocked.rows, self._solver, self._guard, self._tool, bounds
            )
            if curves is None or not is_smooth(reached.curves, curves):
                continue
            count = sum(new is not old for new, old in zip(curves, reached.curves, strict=True))
            told = f"{count} passes leaned by up to {_lean(reached.curves, curves):.1f} deg, as planned {best.blocked.why}"
            yield from self._quiet(curves, self._solver, told)

    def _bounds(self, margin_mm: float) -> Bounds:
        """What leaning may do in this process."""
        plan, placed = self._sequencer.plan, self._guard.placed
        layer = next((item for item in plan.layers if item.index == self._operation.layer), None)
        up = placed[:3, :3] @ (layer.top[3:] if layer is not None else np.array([0.0, 0.0, 1.0]))
        if self._tool.kind == "ball_mill":
            return Bounds(_BALL_CONE_DEG, up, 180.0, margin_mm)
        if not self._operation.process.is_deposit:
            return Bounds(0.0, up, 0.0, margin_mm)
        try:
            facts = self._sequencer.deposition
        except ConfigError as error:
            raise PostError(f"cone of {plan.material}: {error.message}", error.hint) from None
        return Bounds(facts.cone_deg, up, facts.max_tilt_deg, margin_mm)


def _lean(before: Sequence[PassCurve], after: Sequence[PassCurve]) -> float:
    """Greatest angle between the axes of passes before and after, deg."""
    worst = 0.0
    for old, new in zip(before, after, strict=True):
        if new is old:
            continue
        share = np.linspace(0.0, 1.0, 200)
        first = old.axes(old.at_arc_length(share * old.length_mm))
        second = new.axes(new.at_arc_length(share * new.length_mm))
        worst = max(worst, float(np.linalg.norm(first - second, axis=1).max()))
    return float(np.rad2deg(2.0 * np.arcsin(min(0.5 * worst, 1.0))))
