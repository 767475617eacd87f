"""The share of the set power that keeps energy per length: how fast the machine is where it will be, against what the Program has there."""

from __future__ import annotations

from cellctl.domain.sync import HORIZON_PERIODS, Follower

SPAN_S = 0.02  # over which the speed is taken
LEAST = 0.1  # the least feed override that firmware has
DEADBAND = 0.02  # of the share: a smaller change is worth no write
WRITES_APART = 4.0  # times what a write takes: the line is there for readings too
FULL = 0.98  # what is hardly slower than planned is as planned


class PowerShare:
    """The Program's own power already follows the speed that is planned on each line; what remains is override, and ramps within a line.

    The speed is the follower's at the time when the level will have come; so a stretch slower than that and than the control's profile
    tells is known only from the next status report on, and a change shorter than the device takes is not followed. Never above 1.

    write_s : least time between two writes of the level
    """

    def __init__(self, follower: Follower, write_s: float) -> None:
        self._follower = follower
        self._write_s = write_s
        self._share = 1.0
        self._changed_at = 0.0

    def at(self, now: float, effect_at: float, request_s: float) -> float:
        """0.1..1 for a level that is sent at wire time `now` and has come at `effect_at` (s). request_s : that one write takes"""
        follower = self._follower
        last = follower.last
        if last is None or not last.is_run or effect_at + SPAN_S > last.at + HORIZON_PERIODS * follower.period_s:
            return self._share
        gap_s = max(self._write_s, WRITES_APART * request_s)
        share = max(self._speed(effect_at), self._speed(effect_at + gap_s))  # a ramp that is over before the next write is none
        share = 1.0 if share > FULL else max(share, LEAST)
        is_worth = abs(share - self._share) > DEADBAND * self._share or (share == 1.0 and self._share != 1.0)
        if is_worth and now - self._changed_at >= gap_s:
            self._share, self._changed_at = share, now
        return self._share

    def _speed(self, at: float) -> float:
        """Program seconds per wire second at wire time `at`, of those at full speed."""
        follower = self._follower
        return (follower.predicted_time(at + SPAN_S) - follower.predicted_time(at)) / (SPAN_S * max(follower.rate, 1.0))
