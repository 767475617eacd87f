"""Where the machine is on the Program, and where it will be: reported line and position projected on time and arc length."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.arcs import along_and_across, arc_over_chord, fraction_of_arc

RATE_BOUNDS = (
    0.0,
    1000.0,
)  # program seconds per wire second; above 1 only where a simulated cell runs faster than life
STANDSTILL = 1e-3  # mm or deg: a joint that moved less between two reports did not move (firmware prints 3 decimals)


@dataclass(frozen=True)
class Timeline:
    """The line table of a Program as arrays that can be searched.

    time_start_s, time_end_s : (n,) float, predicted, from the start of the Program
    arc_mm : (n + 1,) float, path length of the tip in the build frame up to the start of each line, and at the end
    tip_end, axis_end : (n, 3) float; joints_end : (n, axes) float, machine coordinates
    is_emitting : (n,) bool, whether the gate is open on this line by the Program's own words
    bulge : (n,) float, tan(sweep / 4) of lines that are arcs of the joints of `plane`, 0: straight; none: all are
    bow : (n, 3) float, build frame, from the middle of the chord of the tip's way to the middle of the arc
    """

    time_start_s: NDArray[np.float64]
    time_end_s: NDArray[np.float64]
    arc_mm: NDArray[np.float64]
    tip_end: NDArray[np.float64]
    axis_end: NDArray[np.float64]
    joints_end: NDArray[np.float64]
    is_emitting: NDArray[np.bool_]
    bulge: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    bow: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    plane: tuple[int, int] = (0, 1)

    @classmethod
    def from_table(
        cls,
        table: NDArray[Any],
        is_emitting: NDArray[np.bool_],
        bow: NDArray[np.float64] | None = None,
        plane: tuple[int, int] = (0, 1),
    ) -> Timeline:
        """From a Program's table, (n,) of planner.program.LINE_DTYPE, and the gate of each line; bow, plane : of its arcs."""
        tip = np.ascontiguousarray(table["tip_end"], dtype=np.float64)
        bulge = np.ascontiguousarray(table["bulge"], dtype=np.float64)
        steps = np.linalg.norm(np.diff(tip, axis=0), axis=1) if len(tip) > 1 else np.zeros(0)
        steps *= arc_over_chord(bulge[1:])
        first = np.zeros(2 if len(tip) else 1)
        return cls(
            np.ascontiguousarray(table["time_start_s"], dtype=np.float64),
            np.ascontiguousarray(table["time_end_s"], dtype=np.float64),
            np.concatenate([first, np.cumsum(steps)]),
            tip,
            np.ascontiguousarray(table["axis_end"], dtype=np.float64),
            np.ascontiguousarray(table["joints_end"], dtype=np.float64),
            is_emitting,
            bulge,
            np.zeros((len(tip), 3)) if bow is None else bow,
            plane,
        )

    def __len__(self) -> int:
        return len(self.time_start_s)

    def fraction(self, line: int, joints: NDArray[np.float64]) -> float:
        """How much of the line is behind reported joints (axes,): projection on its chord or its arc, 0..1. A line without motion gives 0."""
        if line <= 0 or line >= len(self):
            return 0.0
        start = self.joints_end[line - 1]
        chord = self.joints_end[line] - start
        square = float(chord @ chord)
        if square < STANDSTILL**2:
            return 0.0
        if len(self.bulge) and self.bulge[line] != 0.0:
            xy = list(self.plane)
            return fraction_of_arc(start[xy], self.joints_end[line][xy], float(self.bulge[line]), joints[xy])
        return min(max(float((joints - start) @ chord) / square, 0.0), 1.0)

    def time_at(self, line: int, fraction: float) -> float:
        """Program time (s) at a fraction of a line."""
        if not len(self):
            return 0.0
        line = min(max(line, 0), len(self) - 1)
        return float(self.time_start_s[line] + fraction * (self.time_end_s[line] - self.time_start_s[line]))

    def arc_at(self, line: int, fraction: float) -> float:
        """Path length of the tip (mm) at a fraction of a line."""
        if not len(self):
            return 0.0
        line = min(max(line, 0), len(self) - 1)
        return float(self.arc_mm[line] + fraction * (self.arc_mm[line + 1] - self.arc_mm[line]))

    def tip_at(self, line: int, fraction: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Tip (3,) mm and tool axis (3,) in the build frame at a fraction of a line."""
        line = min(max(line, 0), len(self) - 1)
        before = max(line - 1, 0)
        bulge = float(self.bulge[line]) if len(self.bulge) else 0.0
        along, across = along_and_across(bulge, fraction)
        tip = self.tip_end[before] + along * (self.tip_end[line] - self.tip_end[before])
        if bulge != 0.0:
            tip += across * 2.0 / abs(bulge) * self.bow[line]
        axis = self.axis_end[before] + fraction * (self.axis_end[line] - self.axis_end[before])
        length = float(np.linalg.norm(axis))
        return tip, axis / length if length > 0 else self.axis_end[line]

    def line_at(self, time_s: float) -> int:
        """Index of the line that is executing at a program time."""
        return int(min(max(int(np.searchsorted(self.time_end_s, time_s, side="right")), 0), max(len(self) - 1, 0)))


@dataclass(frozen=True)
class Report:
    """What one status report said, projected. line : index of the executing line; at : wire time (s)."""

    line: int
    fraction: float
    time_s: float
    arc_mm: float
    joints: NDArray[np.float64]
    at: float
    is_run: bool
    feed: float


class Follower:
    """Follows the machine along a Timeline from reports, and predicts between them.

    Program time runs at a measured rate: 1 at programmed speed, less at reduced override or on corners, 0 at standstill.
    """

    def __init__(self, timeline: Timeline, period_s: float) -> None:
        self.timeline = timeline
        self.period_s = period_s
        self.rate = 1.0
        self.last: Report | None = None
        self.speed_mm_s = 0.0
        self.is_joint_moving = False

    def report(self, line: int, joints: NDArray[np.float64], at: float, *, is_run: bool, feed: float) -> None:
        """Take a status report in. joints : (axes,) machine coordinates; at : wire time (s), later than the one before."""
        fraction = self.timeline.fraction(line, joints)
        before = self.last
        time_s = self.timeline.time_at(line, fraction)
        if before is not None and line == before.line and fraction == before.fraction == 0.0 and is_run:
            # A line without motion (dwell): only time passes on it.
            time_s = min(self.predicted_time(at), self.timeline.time_at(line, 1.0))
        now = Report(line, fraction, time_s, self.timeline.arc_at(line, fraction), joints, at, is_run, feed)
        if before is not None and at > before.at:
            span = at - before.at
            self.is_joint_moving = bool(np.max(np.abs(joints - before.joints), initial=0.0) > STANDSTILL)
            self.speed_mm_s = max(now.arc_mm - before.arc_mm, 0.0) / span if is_run else 0.0
            if is_run and before.is_run and now.time_s > before.time_s:
                measured = (now.time_s - before.time_s) / span
                self.rate = min(max(0.5 * self.rate + 0.5 * measured, RATE_BOUNDS[0]), RATE_BOUNDS[1])
        self.last = now

    def predicted_time(self, at: float) -> float:
        """Program time (s) at a wire time: at the measured rate for at most two status periods beyond the last report."""
        if self.last is None:
            return 0.0
        if not self.last.is_run:
            return self.last.time_s
        return self.last.time_s + self.rate * min(max(at - self.last.at, 0.0), 2.0 * self.period_s)

    def power_factor(self, override: float) -> float:
        """Share of the set power that keeps energy per length when the feed override is below 100 %: never above 1, never below 0.3.

        Corners are slower than a report can tell; they are the firmware's (M4) or the Program's to handle.
        """
        return min(max(override, 0.3), 1.0)


class MotionJudge:
    """Whether the tip moves, from reports and, between them, from what was sent: robust to the coarse rhythm of status reports.

    Measured: the last report says Run, feed above 0, and the position differs from the report before. A standstill in a report is
    believed at once. Expected: lines were just released, or a dwell is about to end, while the gate is shut by the Program's own words
    (so nothing can be emitted at standstill); for `grace_s` motion is taken for granted so that the permit is there when the pass begins.
    """

    def __init__(self, moving_mm_s: float, grace_s: float) -> None:
        self.moving_mm_s = moving_mm_s
        self.grace_s = grace_s
        self.expected_until = -1.0
        self.is_measured = False
        self.why = "the tip stands still"

    def expect(self, now: float) -> None:
        """Motion is about to begin with the gate shut."""
        self.expected_until = now + self.grace_s

    def standstill(self, why: str) -> None:
        """Nothing moves, and nothing is expected to."""
        self.expected_until = -1.0
        self.is_measured = False
        self.why = why

    def report(self, follower: Follower) -> None:
        """Judge the follower's last report."""
        last = follower.last
        if last is None:
            return
        emitting = bool(follower.timeline.is_emitting[last.line]) if last.line < len(follower.timeline) else False
        is_fast = follower.speed_mm_s >= self.moving_mm_s if emitting else follower.is_joint_moving
        self.is_measured = last.is_run and last.feed > 0.0 and is_fast
        if self.is_measured:
            self.why = ""
        elif not last.is_run:
            self.why = "the CNC does not run"
        else:
            self.why = f"the tip moves at {follower.speed_mm_s:.2f} mm/s"

    def is_moving(self, now: float) -> bool:
        """Whether the tip moves, or is about to with the gate shut."""
        return self.is_measured or now < self.expected_until
