"""Whether the tip moves, judged by the follower's reports and by what was sent."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellctl.domain.sync import Follower


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
