"""The share of the set power that keeps energy per length where the machine runs slower than the Program: override, long slow stretches."""

from __future__ import annotations

from collections import deque

from cellctl.domain.sync import Follower

AGREE = 0.05  # reports in a row whose rates differ less tell a speed that lasts
REPORTS = 3
LEAST = 0.1  # the least feed override that firmware has


class PowerShare:
    """Power at each place of the Program already follows the speed that is planned there; what remains is how much slower the machine is.

    Between two status reports nobody knows the speed: a stretch slower than planned and shorter than three reports is not followed.
    """

    def __init__(self, follower: Follower) -> None:
        self._follower = follower
        self._rates: deque[float] = deque(maxlen=REPORTS)

    def report(self) -> None:
        """The follower has taken a report in."""
        last = self._follower.last
        if last is None or not last.is_run:
            self._rates.clear()
        else:
            self._rates.append(self._follower.rate)

    def share(self, override: float) -> float:
        """0.1..1: the feed override (a share, as reported), or the lasting rate where that is clearly lower. Never above 1."""
        rates = self._rates
        told = min(max(override, LEAST), 1.0)
        if len(rates) < REPORTS or max(rates) - min(rates) > AGREE * max(rates):
            return told
        lasting = rates[-1]
        return told if lasting >= (1.0 - AGREE) * told else max(lasting, LEAST)
