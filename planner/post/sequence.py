"""Operations to tape: tool changes, modes, dwells, positioning, and the moves of the passes with their set-points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Tool
from planner.collide.guard import Guard
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.limits import check_travel, excess
from planner.kinematics.timing import axis_limited_times
from planner.plan import Operation, Pass, Plan
from planner.post.linearise import LinearOperation
from planner.post.macros import END, START
from planner.post.pass_curve import PassCurve
from planner.post.poses import SAME_POSE, PoseSolver
from planner.post.positioning import Positioner
from planner.post.process_state import MODE_DEPOSIT, MODE_MILL, MODE_SAFE, ProcessState
from planner.post.reaching import reach_operation
from planner.post.tape import Move, Origin, Tape
from planner.program import LineKind

_SAME_ARC_MM = 1e-6
_STANDS_DEG = 1e-7


@dataclass
class Counts:
    """What the sequence had to do beyond the Plan's own passes.

    slowed_blocks : moves that were lengthened to what the controller takes per second
    limited_blocks : moves that were slowed by an axis' velocity   positionings : retracts that the Plan has no link for, tool changes not counted
    """

    slowed_blocks: int = 0
    limited_blocks: int = 0
    positionings: int = 0


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
        self._positioner = Positioner(self.chain, self.cell)
        self._max_velocity = np.array([axis.max_velocity for axis in self.cell.axes])
        self._spindle_rpm = 0.0
        self._layer_starts: dict[int, int] = {}
        self._solvers: dict[int, PoseSolver] = {}

    def solver(self, tool: Tool) -> PoseSolver:
        """The poses of a tool."""
        return self._solvers.setdefault(tool.number, PoseSolver(self.chain, self.cell, np.array(tool.tip_mm)))

    def run(self) -> Tape:
        """The whole tape. Raises PostError, TravelLimitError or ReachError."""
        self.tape.command(START, Origin())
        self._positioner.retract(self.tape, Origin())
        for number, operation in enumerate(self.plan.operations):
            self._operation(number, operation)
        self._finish()
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
        reached = reach_operation(operation, curves, self)
        tool, curves, moves = reached.tool, list(reached.curves), reached.moves
        operation = self.posted[number] = replace(operation, passes=tuple(curve.source for curve in curves))
        is_changed = tool.number != self.tape.tool
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
        self._passes(number, operation, curves, moves)
        self.guard.advance(operation)

    def _passes(self, number: int, operation: Operation, curves: list[PassCurve], moves: LinearOperation) -> None:
        first = np.flatnonzero(moves.rows.is_first)
        for index, (begin, end) in enumerate(zip(first, np.append(first[1:], len(moves.rows.arc_mm)), strict=True)):
            item = operation.passes[index]
            kind = LineKind.LINK if item.is_link else LineKind.PROCESS
            origin = Origin(kind, operation.layer, number, index)
            part = slice(int(begin), int(end))
            joints, arcs = moves.poses.joints[part], moves.rows.arc_mm[part]
            if moves.poses.needs_positioning[begin]:
                self._position(joints[0], item, Origin(LineKind.LINK, operation.layer, number))
            if item.is_link or not operation.process.is_deposit:
                self.state.darken(origin)
            if operation.process.is_deposit and not item.is_link:
                self.state.start_flows(*_flows(item))
            lengths = self._lengths(joints, arcs, moves.rows.tip[part])
            self._pass(item, curves[index], joints, (arcs, lengths), origin, operation.process.is_deposit)

    def _pass(
        self, item: Pass, curve: PassCurve, joints: Floats, way: tuple[Floats, Floats], origin: Origin, deposits: bool
    ) -> None:
        """Moves of one pass; way : arc lengths at the joints (n,) and lengths of the tip's ways between them (n - 1,), mm."""
        arcs, lengths = way
        if len(joints) < 2:
            return
        row = np.searchsorted(curve.set_point_arcs, arcs[:-1] + _SAME_ARC_MM, side="right") - 1
        times, move = self._times(item, joints, lengths, row)
        if item.is_link:
            self.state.note_link(self.tape.count + len(times) - 1)
        edges = np.flatnonzero(np.diff(row)) + 1
        for begin, end in zip(np.append(0, edges), np.append(edges, len(row)), strict=True):
            _, _, laser_w, powder, gas = item.setpoints[row[begin]]
            if deposits and not item.is_link:
                self.state.set_points(float(laser_w), float(powder), float(gas), origin)
                if laser_w > 0.0:
                    self._layer_starts.setdefault(origin.layer, self.tape.count)
            self.tape.moves(joints[begin + 1 : end + 1], arcs[begin : end + 1], times[begin:end], move, origin)

    def _lengths(self, joints: Floats, arcs: Floats, tips: Floats) -> Floats:
        """(n - 1,) mm: way of the tip in each move: the chord, or the arc where rotary joints bend the way."""
        chords = np.linalg.norm(np.diff(tips, axis=0), axis=1)
        return np.where(self._turning(joints), np.diff(arcs), chords)

    def _turning(self, joints: Floats) -> NDArray[np.bool_]:
        """(n - 1,) bool: moves with rotary motion."""
        steps = np.abs(np.diff(joints[:, [joint.column for joint in self.chain.rotary]], axis=0))
        return np.asarray(np.any(steps > _STANDS_DEG, axis=1))

    def _times(self, item: Pass, joints: Floats, lengths: Floats, row: NDArray[np.int64]) -> tuple[Floats, Move]:
        """Nominal times of the moves of a pass, s, and how they move; lengths : (n,) mm of tip motion."""
        steps = np.diff(joints, axis=0)
        asked = np.zeros(len(steps)) if item.rapid else lengths / item.setpoints[row, 1]
        times = axis_limited_times(steps, asked, self._max_velocity)
        is_rapid = item.rapid and not self._turning(joints).any()
        if not item.rapid:
            self.counts.limited_blocks += int(np.count_nonzero(times > asked * (1.0 + 1e-9)))
        if not is_rapid:
            least = 1.0 / self.cell.cnc.max_blocks_per_s
            self.counts.slowed_blocks += int(np.count_nonzero(times < least))
            times = np.maximum(times, least)
        return times, Move.RAPID if is_rapid else Move.FEED

    def _position(self, target: Floats, item: Pass, origin: Origin) -> None:
        self.state.darken(origin)
        self._positioner.retract(self.tape, origin)
        self.state.note_link(self.tape.count)
        self._positioner.approach(self.tape, target, None if item.rapid else float(item.setpoints[0, 1]), origin)

    def _change_tool(self, number: int, operation: Operation, origin: Origin) -> None:
        self._stand_clear(origin)
        self._spin(0.0, origin)
        self.tape.tool = number
        change = self.tape.command(f"M6 T{number}", Origin(LineKind.TOOL, origin.layer, origin.operation), stops=True)
        if not operation.process.is_deposit and self.state.mode != MODE_MILL:
            self.state.enter_mode(MODE_MILL, change)

    def _spin(self, rpm: float, origin: Origin) -> None:
        if rpm == self._spindle_rpm:
            return
        if self.state.is_emitting:
            self._stand_clear(origin)
        text = f"M3 S{rpm:.0f}" if rpm > 0.0 else "M5"
        self.tape.command(text, Origin(LineKind.TOOL, origin.layer, origin.operation), stops=True)
        self._spindle_rpm = rpm

    def _dwell(self, operation: Operation, origin: Origin) -> None:
        earlier = [layer for layer in self._layer_starts if layer < operation.layer]
        if operation.interpass_s <= 0.0 or not earlier:
            return
        if self.state.is_emitting:
            self._stand_clear(origin)
        since = self._layer_starts[max(earlier)]
        self.tape.dwell(Origin(LineKind.DWELL, origin.layer, origin.operation), operation.interpass_s, since)

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


def _flows(item: Pass) -> tuple[float, float]:
    """Powder, g/min, and shield gas, L/min, at the first place of a pass that emits (its start if none does)."""
    emits = np.flatnonzero(item.setpoints[:, 2] > 0.0)
    row = item.setpoints[emits[0] if emits.size else 0]
    return float(row[3]), float(row[4])
