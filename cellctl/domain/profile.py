"""How fast the machine is within each line: the speeds that lead to the times in the table, at any feed override, in chunks of lines.

Source: grbl 1.1 planner.c (junction deviation, two passes over the blocks); the passes here are running minima over cumulated 2 a L.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.arcs import arc_over_chord
from cellctl.domain.timeline import STANDSTILL, MotionLimits, Timeline

Floats = NDArray[np.float64]
Place = tuple[int, float]  # line index, fraction of it

CHUNK = 128  # lines
MARGIN = 64  # lines looked at on both sides: more than it takes to brake from any feed
ROUNDS = 4  # of speeds and times against each other; on real programs the fourth changes nothing
KEPT = 16  # chunks
CHUNKS_AHEAD = 4  # looked at in detail; the table tells what is beyond
AT_ONCE = 1e12  # mm/s2: an acceleration that takes no time


@dataclass(frozen=True)
class Chunk:
    """Lines first .. first + len(tau) - 2 at one override: model time at each line's start (s from the chunk's start) and its trapezoid.

    length, entry, peak, acceleration : per line in the norm of all joints, mm and deg alike; length 0: a line without motion
    """

    first: int
    tau: list[float]
    length: list[float]
    entry: list[float]
    leave: list[float]
    peak: list[float]
    acceleration: list[float]

    @property
    def last(self) -> int:
        """Index of the last line."""
        return self.first + len(self.length) - 1

    def time(self, line: int, fraction: float) -> float:
        """Model time (s from the chunk's start) at a fraction of a line."""
        k = line - self.first
        length, begin, end = self.length[k], self.tau[k], self.tau[k + 1]
        if length == 0.0:
            return begin + fraction * (end - begin)
        v0, v1, v, a = self.entry[k], self.leave[k], self.peak[k], self.acceleration[k]
        way = fraction * length
        up, down = (v * v - v0 * v0) / (2.0 * a), (v * v - v1 * v1) / (2.0 * a)
        if way < up:
            return begin + (math.sqrt(v0 * v0 + 2.0 * a * way) - v0) / a
        if way > length - down:
            return end - (math.sqrt(v1 * v1 + 2.0 * a * (length - way)) - v1) / a
        return begin + (v - v0) / a + (way - up) / v

    def place(self, tau: float) -> tuple[int, float]:
        """Line and fraction at a model time within the chunk."""
        k = min(max(bisect_right(self.tau, tau) - 1, 0), len(self.length) - 1)
        begin, end, length = self.tau[k], self.tau[k + 1], self.length[k]
        past = min(max(tau - begin, 0.0), end - begin)
        if length == 0.0:
            return self.first + k, past / (end - begin) if end > begin else 1.0
        v0, v1, v, a = self.entry[k], self.leave[k], self.peak[k], self.acceleration[k]
        left = end - begin - past
        if past * a < v - v0:
            way = v0 * past + 0.5 * a * past * past
        elif left * a < v - v1:
            way = length - v1 * left - 0.5 * a * left * left
        else:
            way = (v * v - v0 * v0) / (2.0 * a) + v * (past - (v - v0) / a)
        return self.first + k, min(max(way / length, 0.0), 1.0)

    def speed(self, line: int, fraction: float) -> tuple[float, float]:
        """Speed and acceleration at a fraction of a line, in the norm of all joints; 0 on a line without motion."""
        k = line - self.first
        length = self.length[k]
        if length == 0.0:
            return 0.0, AT_ONCE
        a, way = self.acceleration[k], fraction * length
        rising = math.sqrt(self.entry[k] ** 2 + 2.0 * a * way)
        falling = math.sqrt(self.leave[k] ** 2 + 2.0 * a * (length - way))
        return min(rising, falling, self.peak[k]), a


class SpeedProfile:
    """Places on a Timeline and the process time between them, in chunks made where they are needed: constant memory for any Program.

    override : of the feed, 1 as programmed    agility : how much better the control accelerates than the Timeline's limits
    """

    def __init__(self, timeline: Timeline) -> None:
        self.override = 1.0
        self.agility = 1.0
        self._timeline = timeline
        self._chunks: OrderedDict[tuple[int, float, float], Chunk] = OrderedDict()

    def chunk(self, line: int, agility: float | None = None) -> Chunk:
        """The chunk that a line is in."""
        key = (line // CHUNK, self.override, agility or self.agility)
        found = self._chunks.get(key)
        if found is None:
            first = key[0] * CHUNK
            found = self._chunks[key] = make_chunk(self._timeline, first, min(first + CHUNK, len(self._timeline)), *key[1:])
            if len(self._chunks) > KEPT:
                self._chunks.popitem(last=False)
        return found

    def is_moving(self, line: int) -> bool:
        """Whether a line has motion."""
        chunk = self.chunk(line)
        return chunk.length[line - chunk.first] > 0.0

    def speed(self, place: Place) -> tuple[float, float]:
        """Speed and acceleration at a place, in the norm of all joints per process second; 0 on a line without motion."""
        return self.chunk(place[0]).speed(*place)

    def advance(self, place: Place, seconds: float) -> Place:
        """The place that is reached after so many process seconds (not below 0)."""
        chunk = self.chunk(place[0])
        seconds += chunk.time(*place)
        while seconds > chunk.tau[-1] and chunk.last < len(self._timeline) - 1:
            seconds -= chunk.tau[-1]
            chunk = self.chunk(chunk.last + 1)
        return chunk.place(seconds)

    def between(self, here: Place, there: Place, agility: float | None = None) -> float:
        """Process seconds from one place to another, negative backwards; by the table beyond CHUNKS_AHEAD."""
        if there < here:
            return -self.between(there, here, agility)
        chunk = self.chunk(here[0], agility)
        seconds = -chunk.time(*here)
        for _ in range(CHUNKS_AHEAD):
            if there[0] <= chunk.last:
                return seconds + chunk.time(*there)
            seconds += chunk.tau[-1]
            if chunk.last >= len(self._timeline) - 1:
                return seconds
            chunk = self.chunk(chunk.last + 1, agility)
        if there[0] <= chunk.last:
            return seconds + chunk.time(*there)
        table = self._timeline.time_at(*there) - float(self._timeline.time_start_s[chunk.first])
        return seconds + table / max(self.override, 1e-2)

    def way(self, here: Place, there: Place) -> float:
        """Length from one place to a later one in the norm of all joints; from the begin of the later one's chunk if they are not in one."""
        chunk = self.chunk(there[0])
        first, k = max(here[0], chunk.first) - chunk.first, there[0] - chunk.first
        done = chunk.length[first] * here[1] if here[0] >= chunk.first else 0.0
        return max(sum(chunk.length[first:k]) + chunk.length[k] * there[1] - done, 0.0)


def make_chunk(timeline: Timeline, first: int, end: int, override: float, agility: float = 1.0) -> Chunk:
    """Lines first .. end - 1 with every feed multiplied by `override` and every acceleration by `agility`."""
    low, high = max(first - MARGIN, 0), min(end + MARGIN, len(timeline))
    start, finish, length = _moves(timeline, low, high)
    seconds = timeline.time_end_s[low:high] - timeline.time_start_s[low:high]
    is_motion = length > STANDSTILL
    at = np.flatnonzero(is_motion)
    entry, leave, peak = np.zeros(high - low), np.zeros(high - low), np.zeros(high - low)
    acceleration = np.full(high - low, AT_ONCE)
    lasting = np.where(is_motion, 0.0, seconds)
    if at.size:
        ways = length[at]
        stands = _stands(timeline, low, high, at, seconds)
        a, corner2 = _limits_of(timeline.limits, start[at], finish[at], stands)
        is_end = high == len(timeline)
        cruise = override * _cruise(ways, seconds[at], a, corner2, is_end)
        if timeline.actual is not None:
            a, corner2 = _limits_of(timeline.actual, start[at], finish[at], stands)
        a, corner2 = a * agility, corner2 * agility
        speed = _boundary_speeds(ways, cruise, a, corner2, is_end)
        v0, v1 = speed[:-1], speed[1:]
        v = np.maximum(np.minimum(cruise, np.sqrt(a * ways + 0.5 * (v0 * v0 + v1 * v1))), np.maximum(v0, v1))
        ramps = (2.0 * v * v - v0 * v0 - v1 * v1) / (2.0 * a)
        lasting[at] = (2.0 * v - v0 - v1) / a + np.maximum(ways - ramps, 0.0) / v
        entry[at], leave[at], peak[at], acceleration[at] = v0, v1, v, a
    mine = slice(first - low, end - low)
    tau = np.concatenate([[0.0], np.cumsum(lasting[mine])])
    length = np.where(is_motion, length, 0.0)
    return Chunk(first, tau.tolist(), *(column[mine].tolist() for column in (length, entry, leave, peak, acceleration)))


def _moves(timeline: Timeline, low: int, high: int) -> tuple[Floats, Floats, Floats]:
    """(m, axes) unit vectors at the start and at the end of each line, (m,) its length in the norm of all joints."""
    ends = timeline.joints_end[max(low - 1, 0) : high]
    moves = np.diff(ends, axis=0, prepend=ends[:1]) if low == 0 else np.diff(ends, axis=0)
    bulge = timeline.bulge[low:high] if len(timeline.bulge) else np.zeros(high - low)
    bent = np.flatnonzero(bulge)
    start = finish = moves
    if bent.size:
        columns = list(timeline.plane)
        flat = moves[bent[:, None], np.array(columns)] * arc_over_chord(bulge[bent])[:, None]
        half = 2.0 * np.arctan(bulge[bent])
        start, finish = moves.copy(), moves.copy()
        for unit, turn in ((start, -half), (finish, half)):
            cos, sin = np.cos(turn), np.sin(turn)
            unit[bent, columns[0]] = cos * flat[:, 0] - sin * flat[:, 1]
            unit[bent, columns[1]] = sin * flat[:, 0] + cos * flat[:, 1]
    length = np.sqrt(np.einsum("ij,ij->i", start, start))
    over = 1.0 / np.maximum(length, 1e-12)[:, None]
    return start * over, finish * over, length


def _limits_of(
    limits: MotionLimits | None, start: Floats, finish: Floats, stands: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """(k,) acceleration of each move and (k,) greatest squared speed at its start by the corner before it (grbl 1.1 planner.c)."""
    count = len(start)
    corner2 = np.full(count, np.inf)
    if limits is None:
        corner2[stands] = 0.0
        return np.full(count, AT_ONCE), corner2
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.min(limits.acceleration / np.maximum(np.abs(start), np.abs(finish)), axis=1)
        change = start[1:] - finish[:-1]
        size = np.sqrt(np.einsum("ij,ij->i", change, change))
        aside = np.min(limits.acceleration * size[:, None] / np.maximum(np.abs(change), 1e-12), axis=1)
        half = 0.5 * size  # cosine of half the angle between the two legs
        half_sine = np.sqrt(np.maximum(1.0 - half * half, 0.0))
        rounded = aside * limits.junction_deviation * half_sine / (1.0 - half_sine)
    corner2[1:] = np.where(size < 2e-3, np.inf, np.where(half_sine < 1e-3, 0.0, rounded))
    corner2[stands] = 0.0
    return a, corner2


def _stands(timeline: Timeline, low: int, high: int, at: NDArray[np.int64], seconds: Floats) -> NDArray[np.int64]:
    """Which of the moves `at` begin at a standstill: a barrier or a line that takes time without motion stands before them."""
    pause = np.zeros(high - low, dtype=np.bool_)
    if len(timeline.stops):
        pause |= timeline.stops[low:high]
    still = np.ones(high - low, dtype=np.bool_)
    still[at] = False
    stood = np.concatenate([[0], np.cumsum(pause | (still & (seconds > 0.0)))])[1:]
    return np.flatnonzero(np.diff(stood[at], prepend=stood[at[0]] if low else -1))


def _boundary_speeds(ways: Floats, cruise: Floats, a: Floats, corner2: Floats, is_end: bool) -> Floats:
    """(k + 1,) speed at the start of each move, and at the end of the last: a standstill if that is the Program's end."""
    square = cruise * cruise
    cap = np.append(np.minimum(corner2, square), 0.0 if is_end else square[-1])
    cap[1:-1] = np.minimum(cap[1:-1], square[:-1])
    gain = np.concatenate([[0.0], np.cumsum(2.0 * a * ways)])
    cap = np.minimum.accumulate((cap + gain)[::-1])[::-1] - gain
    cap = np.minimum.accumulate(cap - gain) + gain
    return np.asarray(np.sqrt(np.maximum(cap, 0.0)), dtype=np.float64)


def _cruise(ways: Floats, seconds: Floats, a: Floats, corner2: Floats, is_end: bool) -> Floats:
    """(k,) speed between the ramps of each move that makes it last as long as the table says."""
    mean = ways / np.maximum(seconds, 1e-9)
    cruise = mean
    for _ in range(ROUNDS):
        speed = _boundary_speeds(ways, cruise, a, corner2, is_end)
        v0, v1 = speed[:-1], speed[1:]
        total = seconds + (v0 + v1) / a
        room = ways + (v0 * v0 + v1 * v1) / (2.0 * a)
        root = np.sqrt(np.maximum(total * total - 4.0 * room / a, 0.0))
        cruise = np.maximum(2.0 * room / (total + root), np.maximum(mean, np.maximum(v0, v1)))
    return np.asarray(cruise, dtype=np.float64)
