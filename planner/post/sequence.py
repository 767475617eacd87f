"""Operations to tape: tool changes, modes, dwells, positioning, and the moves of the passes with their set-points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Tool
from config.material import Deposition, load_material
from planner.collide.guard import Guard
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.limits import check_travel, excess
from planner.plan import Operation, Pass, Plan
from planner.post.arc_shape import arc_over_chord
from planner.post.arcs import with_arcs
from planner.post.clock import item_times, spin_up_s
from planner.post.economy import Built
from planner.post.linearise import LinearOperation
from planner.post.macros import END, START
from planner.post.pass_curve import PassCurve
from planner.post.pass_timing import PassTimer, Path, Way
from planner.post.poses import SAME_POSE, PoseSolver
from planner.post.positioning import Positioner
from planner.post.process_state import MODE_DEPOSIT, MODE_MILL, MODE_SAFE, ProcessState
from planner.post.reaching import reach_operation
from planner.post.tape import Move, Origin, Tape
from planner.post.tracking import ActualSpeed, actual_speed, tracked
from planner.post.watching import watch_moves
from planner.program import LineKind

_SAME_ARC_MM = 1e-6
_STANDS_DEG = 1e-7


@dataclass
class Counts:
    """What the sequence had to do beyond the Plan's own passes.

    positionings : retracts that the Plan has no link for, tool changes not counted
    """

    positionings: int = 0
    changes: list[str] = field(default_factory=list)
    """One line each: what is run with other axes, poses or tools than planned, and why."""
    built: dict[str, Built] = field(default_factory=dict)
    """Kind of operation -> how far its moves are off their passes by construction."""


@dataclass
class Sequencer:
    """Writes a Plan's operations on a tape, for one cell and one placement of the part."""

    plan: Plan
    cell: Cell
    chain: Chain
    placed: Floats
    carrier_gas_l_min: float
    counts: Counts = field(default_factory=Counts)

    def __post_init__(self) -> None:
        self.tape = Tape(np.array([axis.home for axis in self.cell.axes]))
        self.state = ProcessState(self.tape, self.cell, self.carrier_gas_l_min)
        self.guard = Guard(self.plan, self.cell, self.chain, self.placed)
        self.posted: dict[int, Operation] = {}
        self._positioner = Positioner(self.chain, self.cell, self.guard)
        self.timer = PassTimer(self.cell)
        self.speed: ActualSpeed | None = None
        self._spindle_rpm = 0.0
        self._layer_starts: dict[int, int] = {}
        self._solvers: dict[int, PoseSolver] = {}

    def solver(self, tool: Tool) -> PoseSolver:
        """The poses of a tool."""
        return self._solvers.setdefault(tool.number, PoseSolver(self.chain, self.cell, np.array(tool.tip_mm)))

    @cached_property
    def deposition(self) -> Deposition:
        """What the plan's material takes. Raises ConfigError."""
        return load_material(self.plan.material).deposition

    def run(self) -> Tape:
        """The whole tape. Raises PostError, TravelLimitError or ReachError."""
        self.tape.command(START, Origin())
        self._positioner.retract(self.tape, Origin())
        for number, operation in enumerate(self.plan.operations):
            self._operation(number, operation)
        self._finish()
        self._follow_speed()
        return self.tape

    def _operation(self, number: int, operation: Operation) -> None:
        if not operation.passes:
            return
        origin = Origin(LineKind.LINK, operation.layer, number)
        curves = [
            PassCurve(
                item, self.placed, f"pass {index} of operation {number} ({operation.process}), layer {operation.layer}"
            )
            for index, item in enumerate(operation.passes)
        ]
        self.guard.begin(operation)
        reached = reach_operation(operation, curves, self)
        tool, curves, moves = reached.tool, list(reached.curves), with_arcs(reached.moves, self.cell)
        kind = operation.process.value
        self.counts.built[kind] = self.counts.built.get(kind, Built()).with_moves(moves.tip_mm, moves.axis_deg)
        operation = self.posted[number] = replace(operation, passes=tuple(curve.source for curve in curves))
        is_changed = tool.number != self.tape.tool
        begin, stood = self.tape.count, self.tape.joints
        self.guard.begin(operation, tool)
        if is_changed:
            self._change_tool(tool.number, operation, origin)
        self._spin(operation.spindle_rpm, origin)
        self._dwell(operation, origin)
        if operation.process.is_deposit and self.state.mode != MODE_DEPOSIT:
            self.state.enter_mode(MODE_DEPOSIT, self.tape.count)
        self._check_travel(curves, moves)
        self.counts.positionings += int(np.count_nonzero(moves.poses.needs_positioning[int(is_changed) :]))
        apart = float(np.abs(moves.poses.joints[0] - self.tape.joints).max())
        if is_changed or apart > SAME_POSE:  # changing, spinning up and waiting are done standing clear
            moves.poses.needs_positioning[0] = True
        self._passes(number, operation, curves, moves, tool)
        watch_moves(self.guard, self.tape.since(begin), stood, operation)
        self.guard.advance(operation, tool)

    def _passes(
        self, number: int, operation: Operation, curves: list[PassCurve], moves: LinearOperation, tool: Tool
    ) -> None:
        first = np.flatnonzero(moves.rows.is_first)
        for index, (begin, end) in enumerate(zip(first, np.append(first[1:], len(moves.rows.arc_mm)), strict=True)):
            item = operation.passes[index]
            kind = LineKind.LINK if item.is_link else LineKind.PROCESS
            origin = Origin(kind, operation.layer, number, index)
            part = slice(int(begin), int(end))
            joints, arcs = moves.poses.joints[part], moves.rows.arc_mm[part]
            if moves.poses.needs_positioning[begin]:
                self._position(joints[0], item, index, tool, Origin(LineKind.LINK, operation.layer, number))
            if item.is_link or not operation.process.is_deposit:
                self.state.darken(origin)
            if operation.process.is_deposit and not item.is_link:
                self.state.start_flows(*_flows(item))
            bulge = np.zeros(len(arcs) - 1) if moves.bulge is None else moves.bulge[part][1:]
            lengths = self._lengths(joints, arcs, moves.rows.tip[part]) * arc_over_chord(bulge)
            path = _path(moves, index, joints, arcs)
            self._pass(item, curves[index], path, (joints, arcs, lengths, bulge), origin, operation.process.is_deposit)

    def _pass(
        self,
        item: Pass,
        curve: PassCurve,
        path: Path,
        moves: tuple[Floats, Floats, Floats, Floats],
        origin: Origin,
        deposits: bool,
    ) -> None:
        """Moves of one pass: joints (n, 5), arc lengths there (n,), lengths of the tip's ways (n - 1,), mm, and bulges (n - 1,) between."""
        joints, arcs, lengths, bulge = moves
        if len(joints) < 2:
            return
        row = np.searchsorted(curve.set_point_arcs, arcs[:-1] + _SAME_ARC_MM, side="right") - 1
        move = Move.FEED
        if item.rapid:
            turns = bool(self._turning(joints).any())
            times, move = self.timer.rapid(joints, turns=turns), Move.FEED if turns else Move.RAPID
        else:
            asked = Way(joints, arcs, lengths, bulge, item.setpoints[row, 1])
            timed = self.timer.timed(asked, path, (origin.operation, origin.pass_))
            joints, arcs, bulge, times = timed.way.joints, timed.way.arc_mm, timed.way.bulge, timed.time_s
            row = row[timed.source]
        if item.is_link:
            self.state.note_link(self.tape.count + len(times) - 1)
        edges = np.flatnonzero(np.diff(row)) + 1
        for begin, end in zip(np.append(0, edges), np.append(edges, len(row)), strict=True):
            _, _, laser_w, powder, gas = item.setpoints[row[begin]]
            if deposits and not item.is_link:
                self.state.set_points(float(laser_w), float(powder), float(gas), origin)
                if laser_w > 0.0:
                    self._layer_starts.setdefault(origin.layer, self.tape.count)
            self.tape.moves(
                joints[begin + 1 : end + 1],
                arcs[begin : end + 1],
                times[begin:end],
                move,
                origin,
                bulge=bulge[begin:end],
            )

    def _lengths(self, joints: Floats, arcs: Floats, tips: Floats) -> Floats:
        """(n - 1,) mm: way of the tip in each move: the chord, or the arc where rotary joints bend the way."""
        chords = np.linalg.norm(np.diff(tips, axis=0), axis=1)
        return np.where(self._turning(joints), np.diff(arcs), chords)

    def _turning(self, joints: Floats) -> NDArray[np.bool_]:
        """(n - 1,) bool: moves with rotary motion."""
        steps = np.abs(np.diff(joints[:, [joint.column for joint in self.chain.rotary]], axis=0))
        return np.asarray(np.any(steps > _STANDS_DEG, axis=1))

    def _position(self, target: Floats, item: Pass, index: int, tool: Tool, origin: Origin) -> None:
        self.state.darken(origin)
        feed = None if item.rapid else float(item.setpoints[0, 1])
        self.state.note_link(self._positioner.travel(self.tape, tool, target, feed, origin, index))

    def _change_tool(self, number: int, operation: Operation, origin: Origin) -> None:
        self._stand_clear(origin)
        self._spin(0.0, origin)
        is_in = self.tape.tool == 0 and number == self.cell.tools[0].number  # a cell stands with its first tool in
        self.tape.tool = number
        place, change_s = Origin(LineKind.TOOL, origin.layer, origin.operation), self.cell.response.tool_change_s
        change = self.tape.command(f"M6 T{number}", place, stops=True, time_s=0.0 if is_in else change_s)
        if not operation.process.is_deposit and self.state.mode != MODE_MILL:
            self.state.enter_mode(MODE_MILL, change)

    def _spin(self, rpm: float, origin: Origin) -> None:
        if rpm == self._spindle_rpm:
            return
        if self.state.is_emitting:
            self._lift(origin)
        text = f"M3 S{rpm:.0f}" if rpm > 0.0 else "M5"
        place, wait_s = (
            Origin(LineKind.TOOL, origin.layer, origin.operation),
            spin_up_s(self.cell, self._spindle_rpm, rpm),
        )
        self.tape.command(text, place, stops=True, time_s=wait_s)
        self._spindle_rpm = rpm

    def _dwell(self, operation: Operation, origin: Origin) -> None:
        earlier = [layer for layer in self._layer_starts if layer < operation.layer]
        if operation.interpass_s <= 0.0 or not earlier:
            return
        if self.state.is_emitting:
            self._lift(origin)
        since = self._layer_starts[max(earlier)]
        self.tape.dwell(Origin(LineKind.DWELL, origin.layer, origin.operation), operation.interpass_s, since)

    def _lift(self, origin: Origin) -> None:
        """Gate off with a move a little away from the part, to wait there."""
        self.state.darken(origin)
        tool = next((item for item in self.cell.tools if item.number == self.tape.tool), None)
        self._positioner.stand_clear(self.tape, tool, origin)

    def _stand_clear(self, origin: Origin) -> None:
        """Laser gate off with a move away from the part: a gate that waits for motion would stay on through a halt."""
        self.state.darken(origin)
        self._positioner.retract(self.tape, origin)

    def _finish(self) -> None:
        layer = max((operation.layer for operation in self.plan.operations), default=-1)
        origin = Origin(LineKind.LINK, layer)
        self._stand_clear(origin)
        end = Origin(LineKind.SETUP, layer)
        self._spin(0.0, end)
        last = self.tape.command(END, end, stops=True)
        self.state.enter_mode(MODE_SAFE, last)

    def _follow_speed(self) -> None:
        """Laser power and powder of the schedule by the speed that the tip really has."""
        items = self.tape.items()
        waits = np.array(sorted({entry.item for entry in self.tape.entries if entry.is_barrier}), dtype=np.int64)
        times = item_times(items, self.cell, waits)
        self.speed = actual_speed(items, times, self.posted)
        if self.state.emissions:
            starts = np.append(0.0, np.cumsum(times))[:-1]
            found = tracked(self.tape.entries, self.state.emissions, self.speed, starts, self.cell, self.deposition)
            self.tape.entries = sorted(found, key=lambda entry: entry.item)

    def _check_travel(self, curves: list[PassCurve], moves: LinearOperation) -> None:
        outside = np.flatnonzero(excess(self.cell.axes, moves.poses.joints).any(axis=1))
        if outside.size == 0:
            return
        build_from_table = np.linalg.inv(self.placed)
        tips = moves.rows.tip[outside] @ build_from_table[:3, :3].T + build_from_table[:3, 3]
        places = [
            f"{curves[int(index)].place}, at x {tip[0]:.2f} y {tip[1]:.2f} z {tip[2]:.2f} mm of the part"
            for index, tip in zip(moves.rows.pass_[outside], tips, strict=True)
        ]
        check_travel(self.cell.axes, moves.poses.joints[outside], places)


def _path(moves: LinearOperation, index: int, joints: Floats, arcs: Floats) -> Path:
    """The samples that the moves of a pass were made from; its joints and arc lengths where there are none."""
    if moves.sampled is None:
        return Path(joints, arcs)
    of_pass = moves.sampled.rows.pass_ == index
    return Path(moves.sampled.tube.joints[of_pass], moves.sampled.rows.arc_mm[of_pass])


def _flows(item: Pass) -> tuple[float, float]:
    """Powder, g/min, and shield gas, L/min, at the first place of a pass that emits (its start if none does)."""
    emits = np.flatnonzero(item.setpoints[:, 2] > 0.0)
    row = item.setpoints[emits[0] if emits.size else 0]
    return float(row[3]), float(row[4])
