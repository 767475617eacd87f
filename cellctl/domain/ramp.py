"""What a machine is on that does not yet have the speed of the profile: a start from a hold, a changed override, braking."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Ramp:
    """From the speed that the machine has to another one, where the profile has `goal` (with `stops`: to a standstill).

    speed, goal : in the norm of all joints, per process second, goal > 0; acceleration > 0
    """

    speed: float
    goal: float
    acceleration: float
    stops: bool = False

    def passed_s(self, seconds: float) -> float:
        """Time on the profile (s) that is done after so many process seconds."""
        end = 0.0 if self.stops else self.goal
        gap = end - self.speed
        span = min(seconds, abs(gap) / self.acceleration)
        way = self.speed * span + math.copysign(0.5 * self.acceleration * span * span, gap) + end * (seconds - span)
        return way / self.goal

    def needed_s(self, passed: float) -> float:
        """Process seconds until so much of the profile's time (s) is done: the inverse; inf behind a standstill."""
        end = 0.0 if self.stops else self.goal
        gap = end - self.speed
        whole = abs(gap) / self.acceleration
        reached = self.passed_s(whole)
        if passed >= reached:
            return math.inf if self.stops else whole + passed - reached
        signed = math.copysign(self.acceleration, gap)
        root = math.sqrt(max(self.speed**2 + 2.0 * signed * passed * self.goal, 0.0))
        return (root - self.speed) / signed
