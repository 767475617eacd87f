"""One running job: the stream that stops at barriers, set-points at their place on the path, progress from lines executed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from cellctl.cell.first_cuts import first_cuts, speed_at
from cellctl.cell.laser_hand import LaserHand
from cellctl.cell.modes import DEPOSIT, MILL, SAFE, Modes
from cellctl.cell.opened_program import speeds_of, timeline_of, tools_of
from cellctl.cell.power_share import PowerShare
from cellctl.cell.program_text import gate_of_lines as gate_of_lines
from cellctl.cell.set_points import LASER_CHANNELS, Leads, SetPoints
from cellctl.cell.told_limits import told_limits
from cellctl.cell.tool_by_hand import asked_tool
from cellctl.cell.transaction import Step, Transaction
from cellctl.domain.judge import MotionJudge
from cellctl.domain.overrides import Overrides
from cellctl.domain.sync import Follower
from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.cnc.events import Status
from planner.program import Channel, LineKind, Program

FEEDER_CHANNELS = tuple(channel for channel in Channel if channel not in LASER_CHANNELS)
IDLE_TIMEOUT_S = 5.0
ARM_S = 0.1  # the laser's level is written so long before the permit, beside its own time for it
EXPECT_PERIODS = 2.5  # status periods for which motion is taken for granted after a release with the gate shut


@dataclass(frozen=True)
class Wanted:
    """The process set-points that the Program has reached, to be restored after a hold."""

    laser_w: float = 0.0
    powder_g_min: float = 0.0
    carrier_gas_l_min: float = 0.0
    shield_gas_l_min: float = 0.0


class Run:
    """A Program on its way through the CNC. Knows no states: the controller asks, and tells."""

    def __init__(
        self, job: str, name: str, program: Program, cell: Cell, drivers: CellDrivers, modes: Modes, hand: LaserHand,
        overrides: Overrides | None = None,
    ) -> None:
        self.job = job
        self.name = name
        self.program = program
        schedule = program.schedule
        self._speeds = speeds_of(program)
        self._cuts = first_cuts(program, self._speeds)
        self._barriers = np.unique([*schedule["n"][schedule["barrier"] == 1], *self._cuts]).astype(np.int64)
        told = told_limits(drivers.cnc.told_settings, program.axis_letters)
        self.timeline = replace(timeline_of(program, cell), actual=told)
        period = cell.cnc.status_period_s
        self.follower = Follower(self.timeline, period)
        self.judge = MotionJudge(cell.limits.moving_mm_s, EXPECT_PERIODS * period)
        self.mode = SAFE
        self.wanted = Wanted()
        self.is_emission_due = False
        self.transaction: Transaction | None = None
        self.executed = 0  # lines that the machine has executed
        self._cell = cell
        self._d = drivers
        self._modes = modes
        self._hand = hand
        self.overrides = hand.overrides = overrides or Overrides()
        self._period_s = period
        self._schedule = schedule
        self._points = SetPoints(program, self.timeline, self.follower, Leads(drivers, cell.response))
        self._share = PowerShare(self.follower, cell.response.laser_write_s)
        self._armed_until = 0.0
        self.is_arming = False  # the permit is about to come: its level goes ahead
        self._released = 0
        self._answered_at = -1.0
        self._tools = tools_of(program)
        drivers.laser.edges.is_gated = program.gate == "stream"
        drivers.cnc.load(program.lines, times_s=cast("Sequence[float]", self.timeline.time_end_s))

    # -- progress ------------------------------------------------------------------------------------------------------

    @property
    def total(self) -> int:
        """Lines of the Program."""
        return len(self.program.lines)

    def count(self) -> None:
        """Take the lines executed from the last report: all before the one that moves, or all of them at a standstill behind them.

        An Idle that came with or before the answer to the last line may have been said before that line was parsed.
        """
        status, counts = self._d.cnc.status, self._d.cnc.counts
        if status is None:
            return
        if not status.is_idle and counts.executing > 0:
            self.executed = max(self.executed, counts.executing - 1)
        elif not status.is_idle and self.follower.source == "position" and self.follower.last is not None:
            self.executed = max(self.executed, min(self.follower.last.line, counts.sent))
        elif status.is_idle and status.at > self._answered_at:
            self.executed = max(self.executed, counts.executed)

    @property
    def line(self) -> int:
        """Index of the line that executes, or of the next one."""
        counts = self._d.cnc.counts
        return min(max(counts.executing - 1 if counts.executing > 0 else self.executed, 0), self.total - 1)

    @property
    def row(self) -> Any:
        """The table's row of that line."""
        return self.program.table[self.line]

    @property
    def offset(self) -> dict[str, float]:
        """The Program's work offset per axis letter."""
        return dict(zip(self.program.axis_letters, map(float, self.program.work_offset), strict=True))

    def tool_at(self, index: int) -> int | None:
        """Number of the tool that the Program has mounted before line `index`; None before its first tool change."""
        mounted = [number for line, number in self._tools if line < index]
        return mounted[-1] if mounted else None

    def remaining_s(self) -> float:
        """Predicted process time to the end of the Program, waits at barriers not counted (s)."""
        last = self.follower.last
        return max(float(self.program.duration_s) - (last.time_s if last else 0.0), 0.0)

    # -- reports and schedule ------------------------------------------------------------------------------------------

    def report(self, status: Status) -> None:
        """Project a status report on the Program."""
        letters = self.program.axis_letters
        if not all(letter in status.machine for letter in letters):
            return
        joints = np.array([status.machine[letter] for letter in letters])
        is_run = status.state == "Run" or (status.state == "Idle" and self._is_dwell(self.line))
        told = status.line is not None and status.line > 0
        self.follower.report(
            self.line if told else max(self._released - 1, 0), joints, status.at, is_run=is_run, feed=status.feed_mm_min,
            override=status.overrides[0] / 100.0, is_line_told=told,
        )  # fmt: skip
        self.judge.report(self.follower)
        if status.state not in ("Run", "Idle"):
            self.judge.standstill(f"the CNC is {status.state}")

    def _is_dwell(self, line: int) -> bool:
        return bool(self.program.table["kind"][line] == LineKind.DWELL)

    def follow(self, now: float) -> None:
        """Carry out what the schedule has for the place where the machine will be once the device has reacted."""
        self._take(now, self.line)
        laser = self._d.laser.client.latency
        lead_s = ARM_S + laser.level_s + laser.read.longest_s
        begins_at = self._points.switches_on_at(now, self._released, lead_s)
        was_arming, self.is_arming = self.is_arming, self.mode == DEPOSIT and begins_at is not None
        if begins_at is not None:
            self._armed_until = begins_at + laser.write.value_s
        if now >= self._armed_until or (self.is_arming and not was_arming):  # once the level is there, the permit alone is waited for
            self._hand.factor = self._share.at(now, max(now + laser.level_s, begins_at or 0.0), laser.write.value_s)
        self._d.laser.client.due(self._points.due_at(now, self._released, LASER_CHANNELS))
        self._d.feeder.client.due(self._points.due_at(now, self._released, FEEDER_CHANNELS))
        self._expect_end_of_dwell(now)

    def _take(self, now: float, line: int) -> None:
        for channel, value in self._points.take(now, line, self._released):
            self._set(channel, value)

    def due_at(self) -> float | None:
        """Wire time (s) at which the next set-point has to be sent, to be followed then; None: none is in sight."""
        return self._points.due_at(self._d.laser.client.clock.now(), self._released)

    def _expect_end_of_dwell(self, now: float) -> None:
        """A dwell with the gate shut ends at a known time: the permit has to be back before the pass behind it."""
        last = self.follower.last
        if last is None or not self._is_dwell(last.line) or self.timeline.is_emitting[last.line]:
            return
        left = (self.timeline.time_at(last.line, 1.0) - self.follower.predicted_time(now)) / max(
            self.follower.rate, 1e-3
        )
        if left <= self._period_s and last.line == self.line:
            self.judge.expect(now)

    def _set(self, channel: int, value: float) -> None:
        feeder, wanted = self._d.feeder, self.wanted
        if channel == Channel.LASER_W:
            self.wanted = Wanted(value, wanted.powder_g_min, wanted.carrier_gas_l_min, wanted.shield_gas_l_min)
            self._hand.power_wanted_w = value
        elif channel == Channel.POWDER_G_MIN:
            self.wanted = Wanted(wanted.laser_w, value, wanted.carrier_gas_l_min, wanted.shield_gas_l_min)
            feeder.set_rate(self.overrides.powder_g_min(value))
        elif channel == Channel.CARRIER_GAS_L_MIN:
            self.wanted = Wanted(wanted.laser_w, wanted.powder_g_min, value, wanted.shield_gas_l_min)
            feeder.set_carrier_gas(value)
        elif channel == Channel.SHIELD_GAS_L_MIN:
            self.wanted = Wanted(wanted.laser_w, wanted.powder_g_min, wanted.carrier_gas_l_min, value)
            feeder.set_shield_gas(value)
        elif channel == Channel.EMISSION:
            self.is_emission_due = bool(value)

    # -- barriers ------------------------------------------------------------------------------------------------------

    @property
    def next_barrier(self) -> int | None:
        """Index of the line at which the stream stops next; None behind the last."""
        position = int(np.searchsorted(self._barriers, self._released + 1))
        return int(self._barriers[position]) - 1 if position < len(self._barriers) else None

    @property
    def is_at_barrier(self) -> bool:
        """Whether everything that was released is executed and more is left."""
        return self._released < self.total and (self._released == 0 or self._is_standing_at(self._released))

    @property
    def stands_before_barrier(self) -> bool:
        """Whether nothing is left of what was released: a job held there goes on with the barrier, whatever the CNC's state."""
        return self._released < self.total and self.executed >= self._released

    @property
    def is_finished(self) -> bool:
        """Whether every line is executed."""
        return self._released >= self.total and self._is_standing_at(self.total)

    def _is_standing_at(self, count: int) -> bool:
        """Whether the machine stands with `count` lines executed, told by a report that is younger than the last answer."""
        status = self._d.cnc.status
        is_told = status is not None and status.is_idle and status.at > self._answered_at
        return is_told and self._d.cnc.is_drained and self.executed >= count

    def answered(self, at: float) -> None:
        """A line was answered at wire time `at` (s)."""
        self._answered_at = at

    def begin_barrier(self, *, again: bool = False) -> None:
        """Make the guarded sequence of the line that is next; a beginning without barrier has none.

        again : the cell has stood in a hold or a fault since, so that the mode which the Program is in is set up anew first
        """
        self.judge.standstill("the cell prepares the next operation")
        steps = [self._idle()]
        n = self._released + 1
        self._set_up_to(n - 1)
        entries = [self._schedule[row] for row in np.flatnonzero((self._schedule["n"] == n) & (self._schedule["barrier"] == 1))]
        if again and self.mode == DEPOSIT and not any(entry["channel"] == Channel.MODE for entry in entries):
            steps += self._deposit_again()
        for entry in entries:
            steps += self._steps(int(entry["channel"]), float(entry["value"]), n - 1)
        if n in self._cuts:
            steps += self._modes.cutting(self.tool_at(n - 1), self.offset, self._cuts[n])
        self.transaction = Transaction(steps)

    def _idle(self) -> Step:
        """A machine that was held between two lines is let go: nothing is there that could move."""
        cnc = self._d.cnc

        def let_go() -> None:
            if cnc.status is not None and cnc.status.state in ("Hold", "Door"):
                cnc.resume()

        return Step(
            "waiting until the CNC is Idle",
            lambda: cnc.status is not None and cnc.status.is_idle,
            IDLE_TIMEOUT_S,
            act=let_go,
        )

    def _set_up_to(self, n: int) -> None:
        """Carry out what was due up to line n and was not reached by prediction: the machine stands there."""
        for channel, value in self._points.take_up_to(n):
            self._set(channel, value)

    def _steps(self, channel: int, value: float, index: int) -> list[Step]:
        if channel == Channel.MODE:
            mode = int(value)
            done = Step(f"mode {mode}", lambda: True, 1.0, act=lambda: self._enter(mode))
            return [*self._modes.steps(mode, self.tool_at(index), self.offset), done]
        assign = Step("set-points", lambda: True, 1.0, act=lambda: self._set(channel, value))
        if channel == Channel.POWDER_G_MIN:
            return [*self._modes.powder(self.overrides.powder_g_min(value)), assign]
        if channel in (Channel.CARRIER_GAS_L_MIN, Channel.SHIELD_GAS_L_MIN):
            return [assign, self._modes.gas(channel == Channel.CARRIER_GAS_L_MIN, value)]
        return [assign]

    def _enter(self, mode: int) -> None:
        self.mode = mode
        if mode != DEPOSIT:
            self.wanted = Wanted()
            self._hand.power_wanted_w = 0.0
            self.is_emission_due = False

    def pass_barrier(self, now: float) -> None:
        """The sequence is verified: let the stream go up to the next barrier."""
        self.transaction = None
        n = self._released + 1
        self._set_up_to(n)
        start = self._released
        self._released = n  # the search for the next barrier begins behind this line
        barrier = self.next_barrier
        self._released = barrier if barrier is not None else self.total
        if self.program.gate == "stream" and self.mode == DEPOSIT and not self.timeline.is_emitting[max(start - 1, 0)]:
            self.judge.expect(now)
        self._take(now, start)
        self._d.cnc.release(self._released)

    def restore(self) -> list[Step]:
        """What has to be verified again before motion goes on after a hold."""
        if self.mode == DEPOSIT:
            return self._deposit_again()
        if self.mode == MILL:
            # A tool change that is next or under way has not been carried out; the control takes a tool's number up behind its pause.
            is_changing = self.row["kind"] == LineKind.TOOL or asked_tool(self, self._d) is not None
            tool = None if is_changing else self.tool_at(self.line + 1)
            # Whether the line that is next or under way has set the spindle going, or stopped it, is not known; the first cut behind it asks.
            before, after = (speed_at(self._speeds, index) for index in (self.line - 1, self.line))
            return self._modes.cutting(tool, self.offset, after if before == after else 0.0)
        return []

    def _deposit_again(self) -> list[Step]:
        wanted = self.wanted
        steps = self._modes.deposit(self.tool_at(self.line + 1), self.offset)
        steps += [self._modes.gas(True, wanted.carrier_gas_l_min), self._modes.gas(False, wanted.shield_gas_l_min)]
        return [*steps, *self._modes.powder(self.overrides.powder_g_min(wanted.powder_g_min))]

    # -- emission ------------------------------------------------------------------------------------------------------

    @property
    def is_depositing(self) -> bool:
        """Whether this is a depositing pass: by the in-stream gate's hand within the mode, or by the schedule's EMISSION."""
        return self.mode == DEPOSIT and (self.program.gate == "stream" or self.is_emission_due)

    def is_run_expected(self, now: float) -> bool:
        """Whether an Idle in the last report is older than the release behind it, or a dwell that is about to end."""
        return not self.judge.is_measured and self.judge.is_moving(now)
