"""The schedule's set-points between barriers, each at its own time: when the machine will be there once the device has reacted."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.sync import Follower, Timeline
from config.cell import Response
from drivers.cell_wires import CellDrivers
from planner.program import Channel, Program

LASER_CHANNELS = (Channel.LASER_W, Channel.EMISSION)
SLACK_S = 0.0005  # wire time by which a set-point may come early: finer than a timer
HORIZON_S = 2.0  # nothing later than this is looked for: predictions do not reach so far
TRANSPORT_MAX = 2.0  # times the cell file's powder delay: a hose that is learnt to take longer is not believed


class Leads:
    """How long before its effect each set-point has to be sent (wire s), as learnt."""

    def __init__(self, drivers: CellDrivers, response: Response) -> None:
        self._d = drivers
        self._response = response

    def of(self, channel: Channel, value: float, rate: float) -> float:
        """rate : program seconds per wire second, in which the cell file's delay of the hose counts; the post has put powder ahead by that"""
        laser, feeder = self._d.laser.client.latency, self._d.feeder.client.latency
        if channel == Channel.EMISSION:
            return laser.on.value_s if value else laser.off.value_s
        if channel == Channel.LASER_W:
            return laser.level_s
        if channel != Channel.POWDER_G_MIN:
            return feeder.acts_s
        said_s = self._response.powder_delay_s / max(rate, 1e-3)
        hose_s = feeder.transport.believed(said_s + feeder.acts_s).value_s
        return min(hose_s, TRANSPORT_MAX * said_s + feeder.acts_s) - said_s


class SetPoints:
    """Entries of the schedule that are no barriers, in their order per channel; entries of other channels do not hold them up."""

    def __init__(self, program: Program, timeline: Timeline, follower: Follower, leads: Leads) -> None:
        self._schedule = program.schedule
        self._timeline = timeline
        self._follower = follower
        self._leads = leads
        self._is_gated = program.gate == "stream"
        loose = np.flatnonzero(self._schedule["barrier"] == 0)
        channels = self._schedule["channel"][loose]
        self._rows: dict[Channel, NDArray[np.intp]] = {
            Channel(int(channel)): loose[channels == channel] for channel in np.unique(channels)
        }
        self._next = dict.fromkeys(self._rows, 0)

    def take(self, now: float, line: int, released: int) -> Iterator[tuple[Channel, float]]:
        """What is due at wire time `now`, with line index `line` executing, never of lines from `released` on."""
        for channel in self._rows:
            while (entry := self._coming(channel, released)) is not None:
                index, value = entry
                if index > self._sure(channel, line) and self._wait_s(channel, index, value, now) > SLACK_S:
                    break
                self._next[channel] += 1
                yield channel, value

    def take_up_to(self, n: int) -> Iterator[tuple[Channel, float]]:
        """Everything up to the N-word n that was not taken, in the schedule's order: the machine stands there."""
        rows: list[int] = []
        for channel, all_rows in self._rows.items():
            first = self._next[channel]
            last = first + int(np.searchsorted(self._schedule["n"][all_rows[first:]], n, side="right"))
            rows += all_rows[first:last].tolist()
            self._next[channel] = last
        for row in sorted(rows):
            yield Channel(int(self._schedule["channel"][row])), float(self._schedule["value"][row])

    def due_at(self, now: float, released: int, channels: tuple[Channel, ...] = tuple(Channel)) -> float | None:
        """Wire time (s) at which the next one of these channels is due, past for one that is overdue; None: none is in sight."""
        waits = []
        for channel in channels:
            entry = self._coming(channel, released) if channel in self._rows else None
            if entry is not None and (wait_s := self._wait_s(channel, *entry, now)) < HORIZON_S:
                waits.append(now + wait_s)
        return min(waits, default=None)

    def switches_on_at(self, now: float, released: int, within_s: float) -> float | None:
        """Wire time (s) at which light is to begin, if switching it on is next and has to be sent so soon; else None."""
        entry = self._coming(Channel.EMISSION, released) if Channel.EMISSION in self._rows else None
        if entry is None or not entry[1] or self._wait_s(Channel.EMISSION, *entry, now) > within_s:
            return None
        return self._follower.time_of_line(entry[0])

    def _coming(self, channel: Channel, released: int) -> tuple[int, float] | None:
        """Line index and value of the channel's next entry, if its line may execute."""
        rows, at = self._rows[channel], self._next[channel]
        if at >= len(rows):
            return None
        entry = self._schedule[rows[at]]
        index = int(entry["n"]) - 1
        return (index, float(entry["value"])) if index < released else None

    def _sure(self, channel: Channel, line: int) -> int:
        """Index of the line up to which entries are due whatever the time says.

        Where the stream gates the laser, its level is set as soon as the gate is shut before the pass that needs it.
        """
        if not (self._is_gated and channel == Channel.LASER_W):
            return line
        ahead = self._timeline.is_emitting[line:]
        first = int(ahead.argmax()) if len(ahead) else 0
        return line + first if len(ahead) and ahead[first] else line

    def _wait_s(self, channel: Channel, index: int, value: float, now: float) -> float:
        """Wire seconds until the entry has to be sent; infinite while the machine does not move."""
        follower = self._follower
        if follower.last is None or not follower.last.is_run:
            return math.inf
        return follower.time_of_line(index) - self._leads.of(channel, value, follower.rate) - now
