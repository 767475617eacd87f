"""The cell's controller: one state, one tick that senses, judges and acts, and everything that latches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any

from cellctl.cell.acknowledging import mark
from cellctl.cell.behaviour import STEPS
from cellctl.cell.clock_watch import ClockWatch
from cellctl.cell.cnc_checks import tells_tool
from cellctl.cell.control import ControlToken
from cellctl.cell.flow_by_hand import FlowByHand
from cellctl.cell.gate import Gate
from cellctl.cell.hearing import hear
from cellctl.cell.homing_watch import HomingWatch
from cellctl.cell.laser_hand import LaserHand
from cellctl.cell.light_watch import LightWatch
from cellctl.cell.measuring import standing
from cellctl.cell.modes import Modes
from cellctl.cell.pilot import Pilot
from cellctl.cell.quiesce import Quiesce
from cellctl.cell.reacting import react
from cellctl.cell.record import END, Found, Journal
from cellctl.cell.retract import Retract
from cellctl.cell.safety import Senses, Situation, Told
from cellctl.cell.sampling import Sampling
from cellctl.cell.spindle_watch import SpindleWatch
from cellctl.cell.stream import Run
from cellctl.cell.surroundings import Position, TableWatch
from cellctl.cell.tip import TipFinder
from cellctl.cell.transaction import Rollback, StepFailedError, Transaction
from cellctl.cell.way_back import begin_way_back
from cellctl.cell.whereabouts import note
from cellctl.domain.interlocks import may_emit, why_not
from cellctl.domain.messages import Event
from cellctl.domain.snapshot import Alarm, JobView, Lines, Permissive
from cellctl.domain.states import State, Trigger, after
from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.errors import LinkError, RangeError_
from drivers.interfaces import Clock

S, T = State, Trigger
DARK_RAMPS = 5.0  # time constants until less than 1 % is left of the light
LEAD_MAX_S = 0.05  # a request that takes longer does not put off a hold: what it would cost is the dead-man's to bound
BEFORE_A_PASS = ("depositing", "moving")  # permissives that come with the pass: the laser's level goes ahead of them, its permit never


@dataclass
class Times:
    """Clocks handed in: `wire` for everything that is measured, `unix` for what is written down."""

    wire: Clock
    unix: Callable[[], float]


@dataclass
class Ended:
    """The last run, kept for the operator to see."""

    view: JobView
    lines: Lines


class Controller:
    """One cell. `tick` never waits; whoever changes the state does it through the table (`go`)."""

    def __init__(self, cell: Cell, times: Times, journal: Journal) -> None:
        self.filed = cell
        self.times = times
        self.journal = journal
        self.found: Found = journal.find()
        self.cell = cell = standing(cell, self.found.measured.get(cell.name))
        self.tips = TipFinder(cell)
        self.state = S.OFFLINE
        self.because = "the cell process has started"
        self.offline_line = "connecting"
        self.cnc_line = "connecting"  # why the CNC is not there
        self.alarms: dict[str, Alarm] = {}
        self.alarms_made = 0
        self.told: dict[str, Told] = {}  # what each alarm was latched for
        self.permissives: list[Permissive] = []
        self.run: Run | None = None
        self.run_started_at = 0.0
        self.ended: Ended | None = None
        self.transaction: Transaction | None = None  # of aborting, resetting, resuming
        self.drivers: CellDrivers | None = None
        self.is_cnc_alive = False
        self.last_tick_at = times.wire.now()
        self.jog_sent_at: float | None = None
        self.homing_watch = HomingWatch(0.0)
        self.control = ControlToken(cell.by_hand, times.unix, self.event, self.found.last.get("control"), times.wire)
        self.table = TableWatch(cell.by_hand, times.unix)
        self.clock_watch = ClockWatch(times.wire, times.unix, self.event, self.table)
        self.position = Position(self.event, self.found.last.get("position"))
        self.way_back: Rollback | None = None  # of a guarded sequence that a fault broke off
        self.retract = Retract(self)
        self.gate = Gate(self)
        self.pilot = Pilot(self)
        self.flow_by_hand = FlowByHand(self)
        self.spindle = SpindleWatch(self)
        self.powder_until: float | None = None  # wire time at which powder that a reaction let flow on is shut
        self.sampling = Sampling(self)
        self._recover()

    # -- wires ---------------------------------------------------------------------------------------------------------

    def attach(self, drivers: CellDrivers) -> None:
        """Use these drivers from now on; everything is commanded safe first."""
        self.drivers = drivers
        self.hand = LaserHand(drivers, self.times.wire)
        self.light = LightWatch(self.cell, drivers.laser, self.hand)
        self.senses = Senses(self.cell, drivers, self.times.wire)
        self.modes = Modes(self.cell, drivers, self.times.wire, self.hand)
        self.quiesce = Quiesce(drivers, lambda: self.gate.is_asked)
        self.quiesce.on_hold = self._brakes
        for client in (drivers.io.client, drivers.laser.client, drivers.feeder.client):
            client.on_level = self.judge
        drivers.laser.client.beats.on_sent = self._put_off_dead_man
        self.hand.lock("the cell process has started")
        drivers.laser.safe()
        drivers.feeder.safe()

    def _put_off_dead_man(self) -> None:
        """A heartbeat goes to the laser: what it puts off, metal's end if this process is killed, is written down then."""
        note(self, self.times.wire.now())

    def _brakes(self, at: float) -> None:
        if self.run is not None:
            self.run.follower.command_hold(at)

    def _recover(self) -> None:
        """Runs that no process ended become interrupted; faults and a stop that nobody reset stay latched."""
        for run in self.found.unfinished:
            text = f"{run.name}: interrupted after line {run.last_line} of {run.total_lines}; the cell process ended"
            self.journal.write(END, (self.times.unix(), "interrupted", run.last_line, run.job))
            self.event(
                "job",
                text,
                {"outcome": "interrupted", "last_line": run.last_line, "total_lines": run.total_lines, **run.document},
                job=run.job,
            )
            lines = Lines(executed=run.last_line, total=run.total_lines)
            progress = run.last_line / max(run.total_lines, 1)
            self.ended = Ended(JobView(run.job, run.name, progress=progress, outcome="interrupted"), lines)
            self.fault("restarted", f"{run.name}, last executed line {run.last_line} of {run.total_lines}")
        for code, detail, remedy in self.found.alarms:
            self.fault(code, detail, remedy)
        for code, (who, at) in self.found.seen.items():
            mark(self, [code], who, at)
        if self.found.is_stopped:
            self.go(T.STOP, "stopped before the cell process ended")
        if self.found.unfinished:
            self.journal.commit()

    # -- state and events ----------------------------------------------------------------------------------------------

    def go(self, trigger: Trigger, because: str) -> None:
        """Change the state by the table. Raises WrongStateError and changes nothing."""
        target = after(self.state, trigger)
        if target is self.state:
            return
        if target is S.FAULT:
            begin_way_back(self, because)
        elif trigger is T.START and self.drivers is not None and not tells_tool(self.drivers.cnc):
            self.event("tool", "tool not reported by this firmware: the program's own tool changes are what is known")
        elif target is S.HOMING:
            self.homing_watch = HomingWatch(self.times.wire.now(), reports_homing=self.cell.cnc.firmware == "grblhal")
        if self.state is S.PURGING and self.drivers is not None:
            self.drivers.feeder.safe()
        self.state, self.because = target, because
        self.transaction = None
        data = {"state": target.value, "trigger": trigger.value, "because": because}
        self.event("state", f"{target.value}: {because}", data)
        if target is not S.RUNNING and self.drivers is not None:
            self.hand.lock(because)

    def event(self, kind: str, text: str, data: dict[str, Any] | None = None, job: str | None = None) -> None:
        """Write down what happened; clients get it when it is durable."""
        name = job if job is not None else (self.run.job if self.run else "")
        self.journal.event(Event(0, self.times.unix(), kind, text, name, data or {}))

    def fault(self, code: str, detail: str = "", remedy: str = "") -> None:
        """Latch a fault and carry out the reaction that the cell file has for it (reacting.py)."""
        react(self, code, detail, remedy)

    @property
    def lead_s(self) -> float:
        """How long the tip has to go on moving after the laser is locked, so that it is dark before it stands (s).

        The write may wait for one request that is under way; the laser's own ramp comes behind it.
        """
        if self.drivers is None:
            return 0.0
        client = self.drivers.laser.client
        ebb_s = client.latency.read.longest_s + client.latency.write.longest_s + DARK_RAMPS * client.device.ramp_s
        lead_s = max(self.cell.limits.tick_s, min(ebb_s, LEAD_MAX_S)) if self.hand.is_permitted else 0.0
        return max(lead_s, self.hand.dark_in_s)

    @property
    def quiesce_pending(self) -> bool:
        """Whether a run that is over has not yet been brought to rest, or the head is still to be taken back."""
        if self.drivers is None:
            return False
        return self.retract.is_pending or (self.run is not None and bool(self.quiesce.outcome))

    def end_run(self, outcome: str) -> None:
        """The run is over: written down with the last executed line."""
        run = self.run
        if run is None or self.drivers is None:
            return
        executed = run.executed
        self.journal.write(END, (self.times.unix(), outcome, executed, run.job))
        text = f"{run.name}: {outcome} after line {executed} of {run.total}"
        places = self.journal.box.moment.document
        self.event("job", text, {"outcome": outcome, "last_line": executed, "total_lines": run.total, **places})
        self.ended = Ended(self.job_view(outcome), self.lines())
        run.transaction = None  # its steps hold the run, and with it the program's file
        self.run = None
        self.quiesce.outcome = ""

    # -- the tick ------------------------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Sense, judge, act: once per period, never waiting."""
        now = self.last_tick_at = self.times.wire.now()
        self.clock_watch.look()
        if self.drivers is None:
            return
        self.pump()
        self.table.watch(self.drivers, self.run is not None)
        self.gate.advance(now)
        self.pilot.advance(now)
        try:
            self._watch(now)
            STEPS[self.state](self, self.drivers, now)
        except StepFailedError as error:
            self.fault(error.code, error.detail, error.remedy)
        except RangeError_ as error:
            self.fault("step_failed", error.message, error.hint)
        except LinkError as error:  # the CNC's line broke under this step: the next pump brings PortLost
            self.hand.lock(error.message)
        self._decide(now)
        note(self, now)
        self.sampling.take(now)

    def act(self, now: float) -> None:
        """Between two ticks: carry out what is due at its own time, and give or take the permit by the levels as they stand."""
        if self.drivers is None:
            return
        try:
            if self.state is S.RUNNING and self.run is not None:
                self.run.follow(now)
            self._decide(now)
        except RangeError_ as error:
            self.fault("step_failed", error.message, error.hint)

    def judge(self) -> None:
        """Fresh levels have come in: what they show latches now and takes the permit away. Only tick and act ever give it."""
        if self.drivers is None:
            return
        now = self.times.wire.now()
        try:
            self._watch(now)
        except LinkError as error:
            self.hand.lock(error.message)
        if self.hand.is_permitted:
            lost = why_not(self.senses.permissives(self._situation(now)))
            if lost:
                self.hand.lock(lost)

    def _decide(self, now: float) -> None:
        """Permit with the wanted power, or neither, by every condition as it stands."""
        self.permissives = self.senses.permissives(self._situation(now))
        is_arming = self.run is not None and self.run.is_arming and may_emit([p for p in self.permissives if p.name not in BEFORE_A_PASS])
        self.hand.apply(may_emit(self.permissives), why_not(self.permissives), is_arming=is_arming)

    def pump(self) -> None:
        """Let the CNC's line read and write, and take in what it tells. Called by every tick and when bytes have come."""
        if self.drivers is not None and self.is_cnc_alive:
            for event in self.drivers.cnc.pump():
                hear(self, event)
            if self.run is not None:
                self.run.count()

    def _situation(self, now: float) -> Situation:
        run = self.run
        if run is None:
            return Situation(self.state, bool(self.alarms), False, False, "no job", False, 0, None, 0.0, self.retract.is_pending)
        return Situation(
            self.state,
            bool(self.alarms),
            run.is_depositing,
            run.judge.is_moving(now),
            run.judge.why,
            run.is_run_expected(now),
            run.mode,
            run.tool_at(run.line),
            run.overrides.powder_g_min(run.wanted.powder_g_min),
            powder_before_g_min=run.overrides.flow_before_g_min(run.wanted.powder_g_min, now),
        )

    def _watch(self, now: float) -> None:
        situation = self._situation(now)
        found = [*self.senses.faults(situation)] if self.state not in (S.OFFLINE, S.RESETTING) else []
        if self.state is not S.OFFLINE:
            found += self.senses.unpermitted_emission(self.hand)
            found += self.light.faults(self.run if self.state is S.RUNNING else None, now)
        if self.state is S.FAULT:
            found += self.senses.late_causes(self.told)
        for code, detail, remedy in found:
            self.fault(code, detail, remedy)
        while self.senses.news:
            self.event("device", self.senses.news.pop(0))

    # -- views ---------------------------------------------------------------------------------------------------------

    def lines(self) -> Lines:
        """The four counts of the run, or of the last one."""
        if self.run is None or self.drivers is None:
            return self.ended.lines if self.ended else Lines()
        counts = self.drivers.cnc.counts
        return Lines(counts.sent, counts.acknowledged, counts.executing, self.run.executed, self.run.total)

    def job_view(self, outcome: str = "") -> JobView:
        """The run as the operator sees it. Raises AssertionError without a run."""
        run = self.run
        assert run is not None
        row = run.row
        kind = {0: "safe", 1: "deposit", 2: "mill"}[run.mode]
        follower, last = run.follower, run.follower.last
        return JobView(
            run.job, run.name, max(int(row["layer"]), 0), len(run.program.layer_starts) - 1, int(row["operation"]), kind,
            run.executed / max(run.total, 1), self.times.wire.now() - self.run_started_at, run.remaining_s(), outcome,
            follower.source if last else "", last.arc_mm if last else 0.0, follower.error_mm if isfinite(follower.error_mm) else -1.0,
        )  # fmt: skip
