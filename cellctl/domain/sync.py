"""Where the machine is on the Program, and where it will be: reports matched with the line table, and what happens between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.judge import MotionJudge
from cellctl.domain.matching import Candidate, candidates
from cellctl.domain.pace import PROBE, Pace
from cellctl.domain.profile import Place, SpeedProfile
from cellctl.domain.ramp import Ramp
from cellctl.domain.timeline import STANDSTILL, MotionLimits, Timeline

__all__ = ["Follower", "MotionJudge", "MotionLimits", "Report", "Timeline"]

Floats = NDArray[np.float64]

HORIZON_PERIODS = 2.0  # status periods beyond the last report after which nothing is predicted any more
REACH_SLACK = 1.3  # on what may have been covered since the last report
REACH_S = 0.05
PAUSES_MAX = 8  # that one report may be found to have passed
WINDOW_LINES = 4096  # looked at once at most
LOST_MM = 0.5  # a place farther from the Program than this is none of it
COMMANDED_S = 0.5  # what was commanded is believed for so long against reports that do not know it yet
FADE = 0.8  # of an earlier error in the estimate, per report


@dataclass(frozen=True)
class Report:
    """What one status report said, projected. line : index of the executing line; at : wire time (s)."""

    line: int
    fraction: float
    time_s: float
    arc_mm: float
    joints: Floats
    at: float
    is_run: bool
    feed: float

    @property
    def place(self) -> Place:
        """Line index and fraction."""
        return self.line, self.fraction


class Follower:
    """Follows the machine along a Timeline from reports, and predicts between them.

    Every line has its trapezoid of speed (SpeedProfile) at the feed override that is reported; the measured pace goes on top of it: rate 1
    and agility 1 for a control that moves as predicted. `source` tells what the place rests on: "Ln", or "position" alone (then matched in
    a window that only goes forward). `error_mm` is what the last reports were away from their prediction, inf before the first.
    """

    def __init__(self, timeline: Timeline, period_s: float) -> None:
        self.timeline = timeline
        self.period_s = period_s
        self.pace = Pace()
        self.last: Report | None = None
        self.speed_mm_s = 0.0
        self.is_joint_moving = False
        self.source = "position"
        self.error_mm = math.inf
        self._profile = SpeedProfile(timeline)
        self._place: Place = (0, 0.0)  # estimated, as of _at (wire time)
        self._at = 0.0
        self._ramp: Ramp | None = None
        self._is_running = False
        self._is_still = False  # the last report was of a line without motion
        self._commanded: tuple[float, float] | None = None  # override and until when it is believed

    @property
    def rate(self) -> float:
        """Process seconds per wire second."""
        return self.pace.rate

    @property
    def override(self) -> float:
        """Feed override that the prediction is for, 1 as programmed."""
        return self._profile.override

    # -- reports -------------------------------------------------------------------------------------------------------

    def report(
        self,
        line: int,
        joints: Floats,
        at: float,
        *,
        is_run: bool,
        feed: float,
        override: float = 1.0,
        is_line_told: bool = True,
    ) -> None:
        """Take a status report in.

        line : index of the executing line, or, where the report does not tell it, of the last one that may execute
        joints : (axes,) machine coordinates    at : wire time (s) at which the report was formed    override : of the feed, 1 as programmed
        """
        if not len(self.timeline):
            return
        if is_line_told and is_run:
            self.source = "Ln"
        self._take_override(override, at)
        guess = self._place_at(at)
        place, is_still, miss_mm = self._match(line, joints, at, guess, is_line_told)
        before, timeline = self.last, self.timeline
        now = Report(*place, timeline.time_at(*place), timeline.arc_at(*place), joints, at, is_run, feed)
        if before is not None and at > before.at:
            self.is_joint_moving = bool(np.max(np.abs(joints - before.joints), initial=0.0) > STANDSTILL)
            self.speed_mm_s = max(now.arc_mm - before.arc_mm, 0.0) / (at - before.at) if is_run else 0.0
        self._learn(now, is_still, guess, miss_mm)
        self.last = now

    def command_override(self, override: float, at: float) -> None:
        """The feed override is commanded at wire time `at` (s): reports tell it only later."""
        self._change_override(override, at)
        self._commanded = (override, at + COMMANDED_S)

    def command_hold(self, at: float) -> None:
        """A hold goes out at wire time `at` (s): the machine brakes."""
        self._move_to(at)
        speed, acceleration = self._profile.speed(self._place)
        self._ramp = Ramp(speed, speed, acceleration, stops=True) if speed > 0.0 else None

    def command_resume(self, at: float) -> None:
        """The machine is let go at wire time `at` (s): it accelerates from standstill."""
        self._place, self._at = self._place_at(at), max(at, self._at)
        goal, acceleration = self._profile.speed(self._place)
        self._ramp = Ramp(0.0, goal, acceleration) if goal > 0.0 else None
        self._is_running = True

    def _move_to(self, at: float) -> None:
        self._place, self._at, self._ramp = self._place_at(at), max(at, self._at), None

    def _take_override(self, override: float, at: float) -> None:
        if self._commanded is not None and (override == self._commanded[0] or at > self._commanded[1]):
            self._commanded = None
        if self._commanded is None and override != self.override:
            self._change_override(override, at)

    def _change_override(self, override: float, at: float) -> None:
        self._move_to(at)
        speed, acceleration = self._profile.speed(self._place)
        self._profile.override = override
        goal, _ = self._profile.speed(self._place)
        self._ramp = Ramp(speed, goal, acceleration) if goal > 0.0 and speed != goal else None

    # -- matching ------------------------------------------------------------------------------------------------------

    def _match(self, line: int, joints: Floats, at: float, guess: Place, is_line_told: bool) -> tuple[Place, bool, float]:
        """The place of a report, whether it is on a line without motion, and how far the joints are from it (mm, deg)."""
        before = self.last.place if self.last is not None else (max(line - 1, 0) if is_line_told else 0, 0.0)
        if is_line_told and line < before[0]:  # the control's own word on the line goes before what was matched
            before = (line, 0.0)
        first, upto = before[0], max(line, before[0])
        last = upto if is_line_told else min(upto, self._reach(at, before))
        found, miss = candidates(self.timeline, max(first, last - WINDOW_LINES), last, joints)
        if miss > LOST_MM and last < upto and self.last is not None and self.last.is_run:
            found, miss = candidates(self.timeline, first, min(upto, first + WINDOW_LINES), joints)
        if miss > LOST_MM and not is_line_told:
            return before, self._is_still, miss
        best, best_away = before, math.inf
        is_still = False
        for each in found:
            place = max(self._within(each, guess), before)  # never back: reports are rounded
            away = abs(self._profile.between(guess, place))
            if away < best_away:
                best, best_away, is_still = place, away, each.is_still
        return best, is_still, miss

    def _within(self, each: Candidate, guess: Place) -> Place:
        """The candidate's place; on a line without motion as far as it was expected."""
        if not each.is_still or each.line > guess[0]:
            return each.line, each.fraction
        return each.line, guess[1] if each.line == guess[0] else 1.0

    def _reach(self, at: float, before: Place) -> int:
        """Index of the line that the machine cannot have left behind since the last report."""
        timeline = self.timeline
        passed = at - self.last.at if self.last is not None and self.last.is_run else 0.0
        seconds = min(max(passed, self.period_s), 2.0) * max(self.rate, 1.0) * REACH_SLACK + REACH_S
        seconds *= max(self.override, 1.0)
        last = timeline.line_at(timeline.time_at(*before) + seconds)
        for _ in range(PAUSES_MAX):  # pauses may be shorter than the table has them
            if last >= len(timeline) - 1 or self._profile.is_moving(last):
                break
            last = max(timeline.line_at(float(timeline.time_end_s[last]) + seconds), last + 1)
        return last

    # -- pace and error ------------------------------------------------------------------------------------------------

    def _learn(self, now: Report, is_still: bool, guess: Place, miss_mm: float) -> None:
        """Take the place over, as far as the time stamp can be trusted, and the pace from how far it is from the one before."""
        before, was_still, had_ramp = self.last, self._is_still, self._ramp is not None
        self._is_running, self._is_still, self._ramp = now.is_run, is_still, None
        if before is None or now.at <= before.at or not now.is_run or not before.is_run:
            has_stood = before is not None and now.is_run and not is_still
            self._place, self._at = now.place, now.at
            self._ramp = self._ramp_from(before.place, now.place) if before is not None and has_stood else None
            return
        off = abs(now.arc_mm - self.timeline.arc_at(*guess)) + miss_mm
        self.error_mm = max(off, FADE * self.error_mm) if math.isfinite(self.error_mm) else off
        ahead = self._profile.between(guess, now.place)
        is_steady = not (was_still or is_still or had_ramp)
        gain = self.pace.gain(ahead) if is_steady else 1.0
        if gain < 1.0:
            whole = self._profile.between(before.place, guess) + gain * ahead
            self._place = self._profile.advance(before.place, whole) if whole > 0.0 else now.place
        else:
            self._place = now.place
        self._at = now.at
        if is_steady:
            self._take_span(before, now, ahead)
        elif was_still and not is_still:
            self._ramp = self._ramp_from(before.place, now.place)

    def _take_span(self, before: Report, now: Report, ahead: float) -> None:
        profile, span = self._profile, now.at - before.at
        progress = profile.between(before.place, now.place)
        if progress <= 0.0:
            return
        slower = profile.between(before.place, now.place, self.pace.agility * PROBE)
        self.pace.take_ramps(self.rate * span - progress, slower - progress)
        self.pace.take(progress, span, ahead, slower - progress)
        profile.agility = self.pace.agility

    def _ramp_from(self, stood: Place, place: Place) -> Ramp | None:
        """The ramp that a machine is on which stood at the place before."""
        goal, acceleration = self._profile.speed(place)
        if goal <= 0.0:
            return None
        speed = math.sqrt(2.0 * acceleration * self._profile.way(stood, place))
        return Ramp(speed, goal, acceleration) if speed < goal else None

    # -- prediction ----------------------------------------------------------------------------------------------------

    def predicted_place(self, at: float) -> Place:
        """Line index and fraction at a wire time (s); nothing goes on two status periods beyond the last report."""
        if self.last is None or not len(self.timeline):
            return 0, 0.0
        return self._place_at(min(at, max(self.last.at, self._at) + HORIZON_PERIODS * self.period_s))

    def predicted_time(self, at: float) -> float:
        """Program time (s, of the table) at a wire time."""
        return self.timeline.time_at(*self.predicted_place(at)) if self.last is not None else 0.0

    def predicted_arc(self, at: float) -> float:
        """Path length of the tip (mm) at a wire time."""
        return self.timeline.arc_at(*self.predicted_place(at)) if self.last is not None else 0.0

    def time_of_line(self, line: int) -> float:
        """Wire time (s) at which the machine begins the line of this index, or began it; inf while it stands before it."""
        if self.last is None or not len(self.timeline):
            return math.inf
        seconds = self._profile.between(self._place, (min(line, len(self.timeline) - 1), 0.0))
        if seconds > 0.0 and not self._is_running:
            return math.inf
        if self._ramp is not None and seconds > 0.0:
            seconds = self._ramp.needed_s(seconds)
        return self._at + seconds / self.rate if self.rate > 0.0 else math.inf

    def _place_at(self, at: float) -> Place:
        seconds = self.rate * max(at - self._at, 0.0)
        if not self._is_running or not len(self.timeline):
            return self._place
        return self._profile.advance(self._place, self._ramp.passed_s(seconds) if self._ramp is not None else seconds)
