"""When the next heartbeat of a device goes: so often that its dead-man outlasts a lost answer, and not just before a set-point that is due."""

from __future__ import annotations

import math
from collections.abc import Callable

from config.device import Device

SHARE = 0.2  # of the dead-man's time between two heartbeats: four may be lost
LATEST_SHARE = 1.0 / 3.0  # the same where a set-point that is due goes first: three within the dead-man's time
LATE_SHARE = 2.0 / 3.0  # the same where readings that are about to grow stale go first
LOST_TIMEOUTS = 2.0  # of a request: an answer that is lost, and waited out before the line is used again
SPARE_SHARE = 0.7  # of what is left of the dead-man's time beside these: the request under way, and the heartbeat itself
COSTLY_SHARE = 0.1  # of the dead-man's time: a write that takes longer goes no oftener than it has to
LEAST_SHARE = 0.1  # a short dead-man does not fill the line with heartbeats


class Beats:
    """Heartbeats of one device. `at`: wire time (s) at which the last one went out; `on_sent` is called then."""

    def __init__(self, device: Device) -> None:
        self._dead_man_s = device.dead_man_s
        self._timeout_s = device.timeout_s
        self.at = -math.inf
        self.on_sent: Callable[[], None] = lambda: None

    def sent(self, at: float) -> None:
        """One goes out at wire time `at` (s)."""
        self.at = at
        self.on_sent()

    def period_s(self, *, is_shared: bool) -> float:
        """Time (s) after which the next one goes. On a line that others share their lost answers take time from the dead-man too."""
        usual_s = SHARE * self._dead_man_s
        if not is_shared:
            return usual_s
        left_s = SPARE_SHARE * (self._dead_man_s - LOST_TIMEOUTS * self._timeout_s)
        return min(usual_s, max(left_s, LEAST_SHARE * self._dead_man_s))

    @property
    def latest_at(self) -> float:
        """Wire time (s) at which the next one goes whatever is due."""
        return self.at + LATEST_SHARE * self._dead_man_s

    def is_due(self, now: float, *, is_shared: bool, can_wait: bool) -> bool:
        """Whether one goes now, wire time `now` (s). can_wait : something else goes before it"""
        return now >= self.latest_at if can_wait else now - self.at >= self.period_s(is_shared=is_shared)

    def is_costly(self, takes_s: float) -> bool:
        """Whether writes take so long, `takes_s` (s), that heartbeats would leave readings too little of the line."""
        return takes_s > COSTLY_SHARE * self._dead_man_s

    def is_late(self, now: float) -> bool:
        """Whether nothing but a gate that is shut goes before it."""
        return now - self.at >= LATE_SHARE * self._dead_man_s

    def trips_in_s(self, now: float) -> float:
        """Seconds until the device's dead-man has tripped if it hears none from now on."""
        return max(0.0, self.at + self._dead_man_s - now)
