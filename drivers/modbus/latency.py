"""How long a device takes, learnt from its own answers: medians of what was seen last, begun with the register map's figures.

One request is on the line at a time, so when a write takes effect is seen only between two requests. Of a request itself only its
begin and its end are known: a device that acts at the end of its own turn-around (it answers what it has done) is taken for granted
within it, and contradicted by readings alone. How far they leave it open is stated.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median

from config.device import Device

WINDOW = 25  # samples: medians follow a device that changes within half a minute
USUAL_SHARE = 0.9  # of the samples
LEAST = 3  # samples before they are believed
RATIO_MAX = 20.0  # a reaction is not believed to be longer than so many time-outs of a request


@dataclass(frozen=True, slots=True)
class Learnt:
    """A time in s; `samples` 0: the register map's word alone. open_s : by how much the readings leave it open, each way"""

    value_s: float
    samples: int
    open_s: float


class RequestTime:
    """Median of what requests take (s)."""

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s
        self._seen: deque[float] = deque(maxlen=WINDOW)
        self._usual_s = start_s

    def took(self, seconds: float) -> None:
        """A request took so long from its begin to its answer."""
        self._seen.append(seconds)
        self._usual_s = sorted(self._seen)[math.ceil(USUAL_SHARE * len(self._seen)) - 1]

    @property
    def value_s(self) -> float:
        """The median; to begin with the map's word."""
        return median(self._seen) if len(self._seen) >= LEAST else self._start_s

    @property
    def longest_s(self) -> float:
        """The longest of the last ones."""
        return max(self._seen, default=self._start_s)

    @property
    def usual_s(self) -> float:
        """What nine in ten of the last ones took at most: a single stall does not keep a line free for as long as it was."""
        return self._usual_s

    @property
    def samples(self) -> int:
        """How many are known."""
        return len(self._seen)


class Edge:
    """From the begin of a write to its effect, in brackets of readings: the last that shows the old, the first that shows the new."""

    def __init__(self, most_s: float) -> None:
        self._most_s = most_s
        self._brackets: deque[tuple[float, float]] = deque(maxlen=WINDOW)

    def bracket(self, earliest_s: float, latest_s: float) -> None:
        """Seen: not before `earliest_s`, not after `latest_s`, both from the begin of the write (s)."""
        if 0.0 <= earliest_s <= latest_s <= self._most_s:
            self._brackets.append((earliest_s, latest_s))

    @property
    def samples(self) -> int:
        """How many are known."""
        return len(self._brackets)

    def believed(self, nominal_s: float) -> Learnt:
        """The nominal time where the readings leave it open, else the middle of their bracket."""
        if self.samples < LEAST:
            return Learnt(nominal_s, 0, 0.0)
        earliest = median(low for low, _ in self._brackets)
        latest = median(high for _, high in self._brackets)
        half = 0.5 * (latest - earliest)
        value = nominal_s if earliest <= nominal_s <= latest else 0.5 * (earliest + latest)
        return Learnt(value, self.samples, half)


class Latency:
    """What is known of one device's times, from begin to end of what one has to wait for.

    answer_line_s : time that an answer to a write is on the line itself (RTU), after the device has acted
    """

    def __init__(self, device: Device, answer_line_s: float = 0.0) -> None:
        self._device = device
        self._answer_line_s = answer_line_s
        self.write = RequestTime(device.latency_s)
        self.read = RequestTime(device.latency_s)
        most_s = RATIO_MAX * device.timeout_s
        self.rise = Edge(most_s)
        self.fall = Edge(most_s)
        self.transport = Edge(math.inf)

    @property
    def acts_s(self) -> float:
        """From the begin of a write to the device's acting on it, its own turn-around included (s)."""
        return max(self.write.value_s - (self._answer_line_s if self.write.samples >= LEAST else 0.0), 0.0)

    @property
    def level_s(self) -> float:
        """From the begin of a write of a level to half of the change (s)."""
        return self.acts_s + self._half_s

    @property
    def on(self) -> Learnt:
        """From the begin of a write that switches on to half of the output."""
        return self.rise.believed(self.level_s)

    @property
    def off(self) -> Learnt:
        """From the begin of a write that switches off to half of the output."""
        return self.fall.believed(self.level_s)

    @property
    def _half_s(self) -> float:
        return math.log(2.0) * self._device.ramp_s
