"""Where the machine is on the Program, and where it will be: reports matched with the line table, and what happens between them."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.matching import Candidate, candidates
from cellctl.domain.profile import SpeedProfile
from cellctl.domain.timeline import STANDSTILL, MotionLimits, Timeline

__all__ = ["Follower", "MotionJudge", "MotionLimits", "Report", "Timeline"]

Floats = NDArray[np.float64]
Place = tuple[int, float]  # line index, fraction of it

RATE_BOUNDS = (
    0.0,
    1000.0,
)  # process seconds per wire second; above 1 only where a simulated cell runs faster than life
HORIZON_PERIODS = 2.0  # status periods beyond the last report after which nothing is predicted any more
SPANS = 10  # between reports, from which the rate is taken
NOISE_S = 0.012  # reports may be late by so much (USB bridges 1-16 ms, a loaded host); what is more is a change of speed
CHANGE = 0.15  # of the rate: a change
REACH_SLACK = 1.3  # on what may have been covered since the last report
REACH_S = 0.05
WINDOW_LINES = 4096  # looked at once at most
LOST_MM = 0.5  # a place farther from the Program than this is none of it
COMMANDED_S = 0.5  # an override that was commanded is believed for so long against reports that do not know it yet
CHUNKS_AHEAD = 4  # looked at in detail; the table tells what is beyond
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


@dataclass(frozen=True)
class Ramp:
    """From the speed that the machine has to that of the profile: a start from a hold, or a changed override.

    speed, goal : in the norm of all joints, per process second; acceleration > 0
    """

    speed: float
    goal: float
    acceleration: float

    def lost_s(self, seconds: float) -> float:
        """How far the profile is ahead after so many process seconds, in its own time (s)."""
        gap = self.goal - self.speed
        span = min(seconds, abs(gap) / self.acceleration)
        return (gap * span - math.copysign(0.5 * self.acceleration * span * span, gap)) / self.goal


class Follower:
    """Follows the machine along a Timeline from reports, and predicts between them.

    Every line has its trapezoid of speed (SpeedProfile) at the feed override that is reported; process time runs at a measured rate on it:
    1 for a control that moves as predicted. `source` tells what the place rests on: "Ln", or "position" alone (then matched in a window
    that only goes forward). `error_mm` is what the last reports were away from their prediction.
    """

    def __init__(self, timeline: Timeline, period_s: float) -> None:
        self.timeline = timeline
        self.period_s = period_s
        self.rate = 1.0
        self.last: Report | None = None
        self.speed_mm_s = 0.0
        self.is_joint_moving = False
        self.source = "position"
        self.override = 1.0
        self.error_mm = math.inf
        self._profile = SpeedProfile(timeline)
        self._place: Place = (0, 0.0)
        self._at = 0.0  # wire time at which the machine was there
        self._ramp: Ramp | None = None
        self._is_still = False  # the place is on a line without motion
        self._commanded: tuple[float, float] | None = None  # override and until when it is believed
        self._spans: deque[tuple[float, float]] = deque(maxlen=SPANS)
        self._late: tuple[float, float] | None = None  # a span that did not fit

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
        before = self.last
        if is_line_told and is_run:
            self.source = "Ln"
        self._take_override(override, at)
        guess = self._place_at(at)
        place, is_still, miss = self._match(line, joints, at, guess, is_line_told)
        now = Report(place[0], place[1], self.timeline.time_at(*place), self.timeline.arc_at(*place), joints, at, is_run, feed)
        if before is not None and at > before.at:
            self.is_joint_moving = bool(np.max(np.abs(joints - before.joints), initial=0.0) > STANDSTILL)
            self.speed_mm_s = max(now.arc_mm - before.arc_mm, 0.0) / (at - before.at) if is_run else 0.0
        self._learn(place, is_still, guess, before, now, miss)
        self.last = now

    def command_override(self, override: float, at: float) -> None:
        """The feed override was commanded at wire time `at` (s): reports tell it only later."""
        self._change_override(override, at)
        self._commanded = (override, at + COMMANDED_S)

    def _take_override(self, override: float, at: float) -> None:
        if self._commanded is not None and (override == self._commanded[0] or at > self._commanded[1]):
            self._commanded = None
        if self._commanded is None and override != self.override:
            self._change_override(override, at)

    def _change_override(self, override: float, at: float) -> None:
        place = self._place_at(at)
        speed, acceleration = self._profile.chunk(place[0], self.override).speed(*place)
        self.override = override
        goal = self._profile.chunk(place[0], override).speed(*place)[0]
        self._place, self._at = place, max(at, self._at)
        self._ramp = Ramp(speed, goal, acceleration) if goal > 0.0 else None

    def _match(
        self, line: int, joints: Floats, at: float, guess: Place, is_line_told: bool
    ) -> tuple[Place, bool, float]:
        """The place of a report, whether it is on a line without motion, and how far the joints are from it."""
        first = self._place[0]
        last = max(line, first) if is_line_told else min(max(line, first), self._reach(at))
        if self.last is None:
            first = max(last - 1, 0) if is_line_told else 0
        found, miss = candidates(self.timeline, max(first, last - WINDOW_LINES), last, joints)
        if miss > LOST_MM and not is_line_told:
            found, miss = candidates(self.timeline, first, min(max(line, first), first + WINDOW_LINES), joints)
            if miss > LOST_MM:
                return self._place, self._is_still, miss
        best: tuple[float, Place, bool] | None = None
        for each in found:
            place = self._within(each, guess)
            if place[0] == self._place[0] and place[1] < self._place[1] and not each.is_still:
                place = place if self._place[1] - place[1] > 1e-2 else self._place
            away = abs(self._between(guess, place))
            if best is None or away < best[0]:
                best = (away, place, each.is_still)
        assert best is not None
        return best[1], best[2], miss

    def _within(self, each: Candidate, guess: Place) -> Place:
        """The candidate's place; on a line without motion as far as it was expected."""
        if not each.is_still or each.line > guess[0]:
            return each.line, each.fraction
        return each.line, guess[1] if each.line == guess[0] else 1.0

    def _reach(self, at: float) -> int:
        """Index of the line that the machine cannot have left behind since the last report."""
        timeline = self.timeline
        line, fraction = self._place
        passed = at - self._at if self.last is not None and self.last.is_run else 0.0
        ahead = (min(max(passed, self.period_s), 2.0) * max(self.rate, 1.0) * REACH_SLACK + REACH_S) * max(self.override, 1.0)
        upto = timeline.time_at(line, fraction) + ahead
        last = timeline.line_at(upto)
        for _ in range(8):  # pauses may be shorter than the table has them
            if last >= len(timeline) - 1 or self._profile.is_moving(last, self.override):
                break
            upto = float(timeline.time_end_s[last]) + ahead
            last = max(timeline.line_at(upto), last + 1)
        return last

    # -- rate and error ------------------------------------------------------------------------------------------------

    def _learn(
        self, place: Place, is_still: bool, guess: Place, before: Report | None, now: Report, miss: float
    ) -> None:
        """Take the place over, and the rate from how far it is from the one before."""
        if before is None or now.at <= before.at:
            self._settle(place, now.at, is_still)
            return
        span = now.at - self._at
        was_still = self._is_still or not before.is_run
        progress = self._between(self._place, place)
        ahead = self._between(guess, place)  # process seconds that the prediction was short of
        if now.is_run and before.is_run:
            off = abs(now.arc_mm - self.timeline.arc_at(*guess)) + miss
            self.error_mm = max(off, FADE * self.error_mm) if math.isfinite(self.error_mm) else off
        ramp = self._ramp_from(was_still and not is_still, place) if now.is_run else None
        if now.is_run and not was_still and not is_still and self._ramp is None and span > 0.0 and progress > 0.0:
            self._take_span(progress, span, ahead)
        self._settle(place, now.at, is_still)
        self._ramp = ramp

    def _take_span(self, progress: float, span: float, ahead: float) -> None:
        measured = min(max(progress / span, RATE_BOUNDS[0]), RATE_BOUNDS[1])
        is_off = bool(self._spans) and abs(ahead) > max(NOISE_S * self.rate, CHANGE * self.rate * span)
        if is_off and self._late is None:
            self._late = (progress, span)  # believed when the next one says the same
            return
        if is_off or not self._spans:
            self._spans.clear()
        self._late = None
        self._spans.append((measured * span, span))
        self.rate = sum(p for p, _ in self._spans) / sum(s for _, s in self._spans)

    def _settle(self, place: Place, at: float, is_still: bool) -> None:
        self._place, self._at, self._is_still, self._ramp = place, at, is_still, None

    def _ramp_from(self, has_stood: bool, place: Place) -> Ramp | None:
        """The ramp that a machine is on which stood at the place before."""
        chunk = self._profile.chunk(place[0], self.override)
        goal, acceleration = chunk.speed(*place)
        if not has_stood or goal <= 0.0:
            return None
        speed = math.sqrt(2.0 * acceleration * self._way(self._place, place))
        return Ramp(speed, goal, acceleration) if speed < goal else None

    def _way(self, here: Place, there: Place) -> float:
        """Length from one place to a later one in the norm of all joints; that of the last line alone if they are not in one chunk."""
        chunk = self._profile.chunk(there[0], self.override)
        first = max(here[0], chunk.first) - chunk.first
        k = there[0] - chunk.first
        done = chunk.length[first] * here[1] if here[0] >= chunk.first else 0.0
        return max(sum(chunk.length[first:k]) + chunk.length[k] * there[1] - done, 0.0)

    # -- prediction ----------------------------------------------------------------------------------------------------

    def predicted_place(self, at: float) -> Place:
        """Line index and fraction at a wire time (s); stands still two status periods beyond the last report."""
        if self.last is None or not len(self.timeline):
            return 0, 0.0
        if not self.last.is_run:
            return self._place
        return self._place_at(min(at, self.last.at + HORIZON_PERIODS * self.period_s))

    def predicted_time(self, at: float) -> float:
        """Program time (s, of the table) at a wire time."""
        return self.timeline.time_at(*self.predicted_place(at)) if self.last is not None else 0.0

    def predicted_arc(self, at: float) -> float:
        """Path length of the tip (mm) at a wire time."""
        return self.timeline.arc_at(*self.predicted_place(at)) if self.last is not None else 0.0

    def time_of_line(self, line: int) -> float:
        """Wire time (s) at which the machine begins the line of this index, or began it; inf while it does not run and has it before it."""
        if self.last is None:
            return math.inf
        if not self.last.is_run:
            return self._at if line <= self._place[0] else math.inf
        seconds = self._between(self._place, (line, 0.0))
        if self._ramp is not None and seconds > 0.0:
            seconds += self._ramp.lost_s(seconds)
        return self._at + seconds / self.rate if self.rate > 0.0 else math.inf

    def _place_at(self, at: float) -> Place:
        seconds = self.rate * max(at - self._at, 0.0)
        if self.last is not None and not self.last.is_run:
            return self._place
        if self._ramp is not None:
            seconds -= self._ramp.lost_s(seconds)
        chunk = self._profile.chunk(self._place[0], self.override)
        seconds += chunk.time(*self._place)
        while seconds > chunk.tau[-1] and chunk.last < len(self.timeline) - 1:
            seconds -= chunk.tau[-1]
            chunk = self._profile.chunk(chunk.last + 1, self.override)
        return chunk.place(seconds)

    def _between(self, here: Place, there: Place) -> float:
        """Process seconds from one place to another by the profile; beyond some chunks by the table."""
        if there < here:
            return -self._between(there, here)
        chunk = self._profile.chunk(here[0], self.override)
        seconds = -chunk.time(*here)
        for _ in range(CHUNKS_AHEAD):
            if there[0] <= chunk.last:
                return seconds + chunk.time(*there)
            seconds += chunk.tau[-1]
            chunk = self._profile.chunk(chunk.last + 1, self.override)
        if there[0] <= chunk.last:
            return seconds + chunk.time(*there)
        table = self.timeline.time_at(*there) - float(self.timeline.time_start_s[chunk.first])
        return seconds + table / max(self.override, 1e-2)

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
