"""Light against what was asked for: emission that nobody asks for behind a shut gate, and a pass that stays dark."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Protocol

from cellctl.cell.laser_hand import LaserHand
from cellctl.domain.sync import Follower
from config.cell import Cell
from drivers.laser import Laser

AROUND_S = 0.06  # a reading tells only when all lines from so long before it to so long behind it ask for the same
OLD_S = 0.5  # a reading older than that tells nothing any more
READINGS = 2  # in a row
LEAST_EMISSIONS = 4.0  # times the read-back that counts as none: a set power whose light a reading tells


class Watched(Protocol):
    """A run, as far as its light is watched."""

    follower: Follower


class LightWatch:
    """Judges readings of the laser's emission, one per status report, where the Program asks for the same all around their time.

    A gate in the stream is not read back by the control: the laser's own emission tells of it.
    """

    def __init__(self, cell: Cell, laser: Laser, hand: LaserHand) -> None:
        self._laser = laser
        self._hand = hand
        self._least_w = LEAST_EMISSIONS * cell.limits.emission_off_w
        self._reports: deque[tuple[float, int]] = deque(maxlen=16)  # wire time and line of those in a row that say Run
        self._readings: deque[tuple[float, bool]] = deque(maxlen=64)
        self._wrong = 0
        self._permitted_since: float | None = None

    def faults(self, run: Watched | None, now: float) -> Iterator[tuple[str, str, str]]:
        """(code, detail, remedy) of what has to latch; called at every tick, with the run while it is RUNNING, else with None."""
        laser = self._laser
        if not self._hand.is_permitted or laser.power_setpoint_w < self._least_w:
            self._permitted_since = None
        elif self._permitted_since is None:
            self._permitted_since = now
        reading = laser.client.readings.get("emission")
        if reading is not None and (not self._readings or reading.at > self._readings[-1][0]):
            self._readings.append((reading.at, reading.value != 0.0))
        last = run.follower.last if run is not None else None
        if run is None or last is None or not last.is_run:
            self._reports.clear()
            self._wrong = 0
        elif not self._reports or last.at > self._reports[-1][0]:
            self._reports.append((last.at, last.line))
            yield from self._judge(run)

    def _judge(self, run: Watched) -> Iterator[tuple[str, str, str]]:
        told_at, told_line = self._reports[-1]
        at, is_lit = max((each for each in self._readings if each[0] <= told_at - AROUND_S), default=(0.0, False))
        before = [line for report_at, line in self._reports if report_at <= at - AROUND_S]
        if not before or told_at - at > OLD_S:
            return
        asked = run.follower.timeline.is_emitting[before[-1] : told_line + 1]
        permitted = self._permitted_since is not None and at - self._permitted_since > AROUND_S + self._laser.client.latency.on.value_s
        is_wrong = permitted and ((bool(asked.all()) and not is_lit) or (not asked.any() and is_lit))
        self._wrong = self._wrong + 1 if is_wrong else 0
        if self._wrong < READINGS:
            return
        self._wrong = 0
        if is_lit:
            yield "laser_emitting", f"{self._laser.power_readback_w:.0f} W where the program has the gate shut", ""
        else:
            yield "dark_pass", f"0 of {self._laser.power_setpoint_w:.0f} W", ""
