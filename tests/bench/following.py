"""The simulated control runs a Program while our follower reads its reports: where it is, against where we say that it is."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from cellctl.cell.arc_ways import bows, plane_of
from cellctl.cell.stream import gate_of_lines
from cellctl.domain.sync import Follower, MotionLimits, Timeline
from config.cell import Cell
from drivers.cnc.events import Status
from drivers.cnc.status import StatusReader
from planner.program import Program
from sim.cnc.chain import Chain
from sim.cnc.firmware import Firmware

STEP_S = 0.002  # between two comparisons
PERIOD_S = 0.1


def changed(cell: Cell, *, acceleration: float = 1.0, deviation: float = 1.0) -> Cell:
    """The cell with other limits of acceleration and corners."""
    axes = [axis.model_copy(update={"max_acceleration": axis.max_acceleration * acceleration}) for axis in cell.axes]
    cnc = cell.cnc.model_copy(update={"junction_deviation_mm": cell.cnc.junction_deviation_mm * deviation})
    return cell.model_copy(update={"axes": axes, "cnc": cnc})


def limits_of(cell: Cell) -> MotionLimits:
    """Of a cell file."""
    return MotionLimits(np.array([axis.max_acceleration for axis in cell.axes]), cell.cnc.junction_deviation_mm)


def timeline_of(program: Program, cell: Cell, actual: Cell | None) -> Timeline:
    """As a run makes it. actual : what the control says of itself"""
    limits = limits_of(cell)
    rows = program.schedule
    barriers = np.unique(rows["n"][rows["barrier"] == 1]).astype(np.int64) - 1
    told = limits_of(actual) if actual else None
    gate, bent = gate_of_lines(program), bows(program, cell)
    return Timeline.from_table(program.table, gate, bent, plane_of(program), limits, barriers, told)


@dataclass
class Ride:
    """One Program on one control.

    cell : what the control is like    model : what the Program was posted for and the follower believes
    report_delay_s, jitter_s : every report comes so late, and up to so much later, and is stamped with the mean delay taken off
    """

    program: Program
    cell: Cell
    model: Cell
    with_lines: bool = True
    is_known: bool = False  # the control tells its own limits
    jitter_s: float = 0.0
    overrides: tuple[tuple[float, int], ...] = ()  # time and percent
    holds: tuple[tuple[float, float], ...] = ()  # time and how long
    tells_override: bool = True
    pause_s: float = 0.35  # at every barrier
    every: int = 1  # of how many report periods one is compared finely
    errors_mm: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    tips_mm: list[float] = field(default_factory=list)
    where: list[tuple[float, int, float]] = field(default_factory=list)
    claims_mm: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.timeline = timeline_of(self.program, self.model, self.cell if self.is_known else None)
        self.follower = Follower(self.timeline, PERIOD_S)
        self.firmware = Firmware(self.cell)
        self.chain = Chain(self.cell)
        self.reader = StatusReader(self.cell.letters)
        self._random = np.random.default_rng(7)
        rows = self.program.schedule
        self._stops = [*(np.unique(rows["n"][rows["barrier"] == 1]).astype(int) - 1), len(self.program.lines)]
        self._released = self._sent = 0
        self._resume_at = self._standing_since = -1.0
        self._inverse = np.linalg.inv(self.program.machine_from_build)
        self.firmware.supply = self._supply
        self.firmware.transmit()
        self.now = 0.0
        self._true_line, self._before = 0, (0.0, 0.0)

    def _supply(self, free: int) -> bytes:
        if self._sent >= self._released:
            return b""
        line = self.program.lines[self._sent].encode() + b"\n"
        if len(line) > free:
            return b""
        self._sent += 1
        return line

    def run(self, seconds: float) -> None:
        """Until the Program or the time is over."""
        for count in itertools.count():
            if self.now >= seconds or self._is_done():
                return
            self._hands()
            for _ in self._steps(count % self.every == 0):
                pass
            self._report()

    def _steps(self, is_fine: bool) -> Iterator[None]:
        step = STEP_S if is_fine else PERIOD_S
        for _ in range(round(PERIOD_S / step)):
            self.firmware.step(step)
            self.now += step
            self.firmware.transmit()
            if is_fine:
                self._compare()
            yield

    def _is_done(self) -> bool:
        return self._sent >= len(self.program.lines) and self.firmware.state[0] == "Idle"

    def _hands(self) -> None:
        firmware = self.firmware
        is_standing = self._sent >= self._released and firmware.machine.motion.count == 0 and firmware.state[0] == "Idle"
        if is_standing and self._standing_since < 0:
            self._standing_since = self.now
        if is_standing and self.now - self._standing_since >= self.pause_s:
            self._standing_since = -1.0
            self._released = next(stop for stop in self._stops if stop > self._released) if self._released < self._stops[-1] else self._released
        self._override()
        self._hold()

    def _override(self) -> None:
        firmware = self.firmware
        while self.overrides and self.overrides[0][0] <= self.now:
            percent = self.overrides[0][1]
            self.overrides = self.overrides[1:]
            tens, ones = divmod(abs(percent - 100), 10)
            up = percent > 100
            firmware.receive(b"\x90" + (b"\x91" if up else b"\x92") * tens + (b"\x93" if up else b"\x94") * ones)
            if self.tells_override:
                self.follower.command_override(percent / 100.0, self.now)

    def _hold(self) -> None:
        firmware = self.firmware
        if self._resume_at >= 0 and self.now >= self._resume_at:
            self._resume_at = -1.0
            firmware.receive(b"~")
            if self.tells_override:
                self.follower.command_resume(self.now)
        while self.holds and self.holds[0][0] <= self.now:
            self._resume_at = self.now + self.holds[0][1]
            self.holds = self.holds[1:]
            firmware.receive(b"!")
            if self.tells_override:
                self.follower.command_hold(self.now)

    def _report(self) -> None:
        self.firmware.receive(b"?")
        for line in self.firmware.transmit().decode().split("\r\n"):
            if line.startswith("<"):
                jitter = self.jitter_s * (self._random.random() - 0.5)
                self._take(self.reader.read(line, self.now + jitter))

    def _take(self, status: Status) -> None:
        letters = self.program.axis_letters
        joints = np.array([status.machine[letter] for letter in letters])
        told = status.line is not None and self.with_lines
        line = status.line - 1 if told and status.line is not None else max(self._sent - 1, 0)
        is_dwell = status.is_idle and self.firmware.machine.timer_s > 0.0
        self.follower.report(
            line, joints, status.at, is_run=status.state == "Run" or is_dwell, feed=status.feed_mm_min,
            override=status.overrides[0] / 100.0, is_line_told=told,
        )  # fmt: skip

    # -- truth ---------------------------------------------------------------------------------------------------------

    def _compare(self) -> None:
        motion = self.firmware.machine.motion
        if motion.line:
            self._true_line = motion.line - 1
        joints = motion.position
        fraction = share_of_line(self.program, self._true_line, joints)
        table_arc = self.timeline.arc_mm
        arc = table_arc[self._true_line] + fraction * (table_arc[self._true_line + 1] - table_arc[self._true_line])
        speed = (arc - self._before[1]) / (self.now - self._before[0])
        self._before = (self.now, arc)
        if self.follower.last is None or motion.speed == 0.0 or self.firmware.machine.is_suspended:
            return
        line, part = self.follower.predicted_place(self.now)
        tip = (self._inverse @ np.append(self.chain.tip_in_table(joints[None], self.firmware.machine.tool)[0], 1.0))[:3]
        self.errors_mm.append(self.timeline.arc_at(line, part) - arc)
        self.speeds.append(speed)
        self.tips_mm.append(float(np.linalg.norm(self.timeline.tip_at(line, part)[0] - tip)))
        self.where.append((self.now, self._true_line, fraction))
        self.claims_mm.append(self.follower.error_mm)


def share_of_line(program: Program, line: int, joints: np.ndarray) -> float:
    """Fraction of a line at exact joints on it, by angle for arcs: written apart from the follower's."""
    if line <= 0:
        return 0.0
    table = program.table
    start, end = table["joints_end"][line - 1], table["joints_end"][line]
    bulge = float(table["bulge"][line])
    if bulge == 0.0:
        length = float(np.linalg.norm(end - start))
        return min(float(np.linalg.norm(joints - start)) / length, 1.0) if length > 1e-6 else 1.0
    x, y = program.axis_letters.index("X"), program.axis_letters.index("Y")
    a, b, p = complex(start[x], start[y]), complex(end[x], end[y]), complex(joints[x], joints[y])
    sweep = 4.0 * np.arctan(bulge)
    centre = a + (b - a) / (1.0 - np.exp(1j * sweep))
    angle = float(np.angle((p - centre) / (a - centre))) * np.sign(bulge)
    return float(min(max((angle if angle > -1e-3 else angle + 2 * np.pi) / abs(sweep), 0.0), 1.0))
