"""Nominal times of the moves of a pass: the asked speed, lowered smoothly to what axes and control take, long moves cut where it changes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Floats
from planner.kinematics.feed import AxisLimits, SpeedProfile, speed_profile
from planner.kinematics.timing import axis_limited_times
from planner.post.line_rate import LineRate

Ints = NDArray[np.int64]

STEP = 0.1
"""Relative: by how much the speed may change from move to move where it is lowered."""
_LEAST_WAY_MM = 1e-5  # shorter is a move of the rotary joints alone


@dataclass(frozen=True)
class Path:
    """The pass itself as the joints follow it, before moves were made of it.

    joints : (k, 5) float, mm or deg   arc_mm : (k,) float, increasing
    """

    joints: Floats
    arc_mm: Floats


@dataclass(frozen=True)
class Way:
    """Moves of one pass.

    joints : (n, 5) float, mm or deg, where they begin and end   arc_mm : (n,) float, along the pass
    length_mm : (n - 1,) float, way of the tip   bulge : (n - 1,) float, of arcs   asked_mm_s : (n - 1,) float
    """

    joints: Floats
    arc_mm: Floats
    length_mm: Floats
    bulge: Floats
    asked_mm_s: Floats


@dataclass(frozen=True)
class TimedWay:
    """The way, maybe cut finer, with time_s : (m - 1,) float for its moves; source : (m - 1,) int, which move each was."""

    way: Way
    time_s: Floats
    source: Ints


@dataclass
class PassTimer:
    """Times of passes for one cell; counts what the control's rate of blocks and the axes changed.

    slowed_blocks : moves lengthened to what the control takes per second   limited_blocks : moves whose speed an axis lowered
    shortest : operation, pass, way in mm and speed over the asked one of the move that the control's rates slowed most; none if none
    limiting : (operation, pass, way begin, way end in mm, 3 * axis + 0 velocity, 1 acceleration, 2 jerk) of the latter
    """

    cell: Cell
    slowed_blocks: int = 0
    limited_blocks: int = 0
    shortest: tuple[int, int, float, float] | None = None
    limiting: list[tuple[int, int, float, float, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._limits = AxisLimits.of(self.cell.axes)
        self._rate = LineRate.of(self.cell)

    def rapid(self, joints: Floats, *, turns: bool) -> Floats:
        """(n - 1,) s of a pass that goes as fast as the axes can; turns : it goes by inverse time."""
        steps = np.diff(joints, axis=0)
        times = axis_limited_times(steps, np.zeros(len(steps)), self._limits.velocity)
        return np.maximum(times, self._rate.least_s) if turns else times

    def timed(self, way: Way, path: Path, place: tuple[int, int]) -> TimedWay:
        """Times at the asked speed, as far as axes and control follow; place : operation and pass."""
        asked_s = way.length_mm / way.asked_mm_s
        profile = self._profile(way, path)
        if profile is None:
            timed = TimedWay(way, asked_s, np.arange(len(asked_s)))
        else:
            for stretch in np.flatnonzero(profile.limiting >= 0).tolist():
                begin, end = float(path.arc_mm[stretch]), float(path.arc_mm[stretch + 1])
                self.limiting.append((*place, begin, end, int(profile.limiting[stretch])))
            timed = _cut(way, profile, self._rate.least_s)
            self.limited_blocks += int(
                np.count_nonzero(timed.time_s > 1.0001 * timed.way.length_mm / timed.way.asked_mm_s)
            )
        steps = np.diff(timed.way.joints, axis=0)
        chords = np.where(timed.way.bulge[:, None] == 0.0, steps, 0.0)
        times = axis_limited_times(chords, timed.time_s, self._limits.velocity)
        return TimedWay(timed.way, self._taken(timed.way, times, place), timed.source)

    def _taken(self, way: Way, times_s: Floats, place: tuple[int, int]) -> Floats:
        """(n - 1,) s, lengthened to what the control and its line take."""
        least = self._rate.least_times(way.joints, way.bulge, times_s)
        slow = np.flatnonzero(self._rate.slow(times_s, least))
        if slow.size:
            self.slowed_blocks += len(slow)
            share = times_s[slow] / least[slow]
            k = int(np.argmin(share))
            if self.shortest is None or share[k] < self.shortest[3]:
                self.shortest = (*place, float(way.arc_mm[slow[k]]), float(share[k]))
        return np.maximum(times_s, least)

    def _profile(self, way: Way, path: Path) -> SpeedProfile | None:
        """Speed over the pass; None where it is the asked one throughout, or where the tip stands while rotary joints turn."""
        if (np.diff(way.arc_mm) < _LEAST_WAY_MM).any():
            return None
        kept = np.append(True, np.diff(path.arc_mm) > _LEAST_WAY_MM)
        joints, arcs = path.joints[kept], path.arc_mm[kept]
        middle = 0.5 * (arcs[1:] + arcs[:-1])
        asked = way.asked_mm_s[np.searchsorted(way.arc_mm, middle, side="right").clip(1, len(way.asked_mm_s)) - 1]
        profile = speed_profile(joints, arcs, asked, self._limits)
        return None if len(profile.way_mm) == len(arcs) and np.ptp(profile.speed_mm_s) == 0.0 else profile


def _cut(way: Way, profile: SpeedProfile, least_s: float) -> TimedWay:
    """Times by the profile; straight moves cut where the speed has changed by STEP, no piece shorter than least_s."""
    reached_s = np.append(0.0, np.cumsum(profile.stretch_times_s))
    log_speed = np.log(profile.speed_mm_s)
    at_s = np.interp(way.arc_mm, profile.way_mm, reached_s)
    inside = np.searchsorted(profile.way_mm, way.arc_mm)
    arcs, source = [way.arc_mm[:1]], []
    for move in range(len(way.asked_mm_s)):
        cells = slice(int(inside[move]), int(inside[move + 1]))
        cuts = np.zeros(0)
        if (
            way.bulge[move] == 0.0
            and cells.stop > cells.start
            and np.ptp(log_speed[cells]) > STEP
            and at_s[move + 1] - at_s[move] > 2.0 * least_s
        ):
            places = _cuts(log_speed[cells], reached_s[cells], at_s[move], at_s[move + 1], least_s)
            cuts = profile.way_mm[cells][places]
        arcs += [cuts, way.arc_mm[move + 1 : move + 2]]
        source += [move] * (len(cuts) + 1)
    arc_mm, of_move = np.concatenate(arcs), np.array(source, dtype=np.int64)
    span = np.diff(way.arc_mm)
    share = (arc_mm[:-1] - way.arc_mm[of_move]) / span[of_move]
    joints = way.joints[of_move] + share[:, None] * (way.joints[of_move + 1] - way.joints[of_move])
    length = np.diff(arc_mm) * (way.length_mm / span)[of_move]
    times = np.diff(np.interp(arc_mm, profile.way_mm, reached_s)) * (way.length_mm / span)[of_move]
    times = np.maximum(times, length / way.asked_mm_s[of_move])
    finer = Way(np.vstack([joints, way.joints[-1:]]), arc_mm, length, way.bulge[of_move], way.asked_mm_s[of_move])
    return TimedWay(finer, times, of_move)


def _cuts(log_speed: Floats, reached_s: Floats, begin_s: float, end_s: float, least_s: float) -> Ints:
    """Indices at which a move is cut: the speed has changed by STEP since the last cut, and least_s is between it, the last and the end."""
    at = []
    last_s, last = begin_s, log_speed[0]
    for k in range(1, len(log_speed)):
        if abs(log_speed[k] - last) >= STEP and reached_s[k] - last_s >= least_s and end_s - reached_s[k] >= least_s:
            at.append(k)
            last_s, last = reached_s[k], log_speed[k]
    return np.array(at, dtype=np.int64)
