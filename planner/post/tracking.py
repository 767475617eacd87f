"""Laser power and powder that follow the tip's actual speed, so that energy and powder per length stay as planned (tracking control)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config.cell import Cell
from config.material import Deposition
from planner.kinematics.chain import Floats
from planner.plan import Operation
from planner.post.process_state import Emission
from planner.post.tape import Entry, Move
from planner.program import Channel, LineKind

Ints = NDArray[np.int64]

TOLERANCE = 0.025
"""Relative: what a level may be off over the stretch for which it holds; two stretches that meet are off by twice that at most."""
POWDER_RISE = 1.2
"""Greatest step up of the powder: the nozzle then never gives less than 0.83 of the set rate."""
_SLACK = 0.25  # of the time of a write: what the planned power gives in it is worth no change of the level
_SAME_ARC_MM = 1e-6
_DIGITS = 3  # significant ones of a level: 0.5 % at worst


@dataclass(frozen=True)
class ActualSpeed:
    """Of the items that follow passes at feed.

    item : (k,) int, of the tape   share : (k,) float, of the planned speed, at most 1   time_s : (k,) float   length_mm : (k,) float
    planned : (k, 5) float, the set-points of the plan there
    """

    item: Ints
    share: Floats
    time_s: Floats
    length_mm: Floats
    planned: Floats


def actual_speed(items: NDArray[np.void], times: Floats, posted: Mapping[int, Operation]) -> ActualSpeed:
    """Speed of the tip along the passes as predicted, against the set-points of the operations as posted.

    items : (n,) ITEM_DTYPE   times : (n,) float, s, as the control runs them
    """
    moving = np.flatnonzero((items["move"] == Move.FEED) & (items["kind"] == LineKind.PROCESS) & (items["pass_"] >= 0))
    key = items["operation"][moving].astype(np.int64) * (1 << 31) + items["pass_"][moving]
    edges = np.flatnonzero(np.diff(key, prepend=-1)) if moving.size else moving
    planned = np.empty((len(moving), 5))
    for begin, end in zip(edges, np.append(edges[1:], len(moving)), strict=True):
        first = items[moving[begin]]
        rows = posted[int(first["operation"])].passes[int(first["pass_"])].setpoints
        at = np.searchsorted(rows[:, 0], items["arc_start_mm"][moving[begin:end]] + _SAME_ARC_MM, side="right") - 1
        planned[begin:end] = rows[at]
    length = items["arc_end_mm"][moving] - items["arc_start_mm"][moving]
    share = np.minimum(length / np.maximum(times[moving] * planned[:, 1], 1e-12), 1.0)
    return ActualSpeed(moving, share, times[moving], length, planned)


def tracked(
    entries: list[Entry],
    emissions: list[Emission],
    speed: ActualSpeed,
    starts_s: Floats,
    cell: Cell,
    window: Deposition,
) -> list[Entry]:
    """The schedule with the laser's power, and powder as far as it follows, scaled to the actual speed.

    entries : without laser power   emissions : stretches with the gate open   starts_s : (n,) s, when each item of the tape begins
    """
    kept = [entry for entry in entries if entry.channel != Channel.POWDER_G_MIN or entry.is_barrier]
    return (
        kept
        + _power_entries(emissions, speed, cell, window)
        + _powder_entries(kept, emissions, speed, starts_s, cell, window)
    )


def _power_entries(emissions: list[Emission], speed: ActualSpeed, cell: Cell, window: Deposition) -> list[Entry]:
    """Level of each stretch as early as the laser is dark before it, then at the moves where it changes."""
    in_stream = cell.cnc.power_output is not None
    slack_s = _SLACK * cell.response.laser_write_s
    least_s = 0.0 if in_stream else cell.response.laser_write_s
    found: list[Entry] = []
    level_w = 0.0
    for stretch in emissions:
        level_w = 0.0 if stretch.is_fresh else level_w
        rows = slice(*np.searchsorted(speed.item, (stretch.begin, stretch.end)))
        planned = speed.planned[rows, 2]
        if planned.size == 0:
            continue
        floor = np.minimum(planned, window.laser_w.min)
        levels = track(planned, speed.share[rows], speed.time_s[rows], floor, slack_s, least_s, 0.0)
        for row in np.flatnonzero(np.diff(levels, prepend=np.nan) != 0.0).tolist():
            if levels[row] != level_w:
                item = stretch.dark if row == 0 else int(speed.item[rows][row])
                found.append(Entry(item, Channel.LASER_W, float(levels[row]), is_barrier=False))
                level_w = levels[row]
    return found


def _powder_entries(
    kept: list[Entry], emissions: list[Emission], speed: ActualSpeed, starts_s: Floats, cell: Cell, window: Deposition
) -> list[Entry]:
    """Changes of the rate where slow stretches last long enough, ahead by what it takes to the nozzle, behind the barrier before."""
    response = cell.response
    ahead_s = response.powder_delay_s + response.powder_settle_s * float(np.log(2.0))
    least_s = response.powder_delay_s + 2.0 * response.powder_settle_s
    is_lit = np.zeros(len(speed.item), dtype=np.bool_)
    for stretch in emissions:
        is_lit[slice(*np.searchsorted(speed.item, (stretch.begin, stretch.end)))] = True
    lit = np.flatnonzero(is_lit)
    barriers = sorted(
        (entry.item, entry.value if entry.channel == Channel.POWDER_G_MIN else 0.0)
        for entry in kept
        if entry.is_barrier and entry.channel in (Channel.POWDER_G_MIN, Channel.MODE)
    )
    found: list[Entry] = []
    for (begin, rate), end in zip(barriers, [item for item, _ in barriers[1:]] + [len(starts_s)], strict=True):
        rows = lit[slice(*np.searchsorted(speed.item[lit], (begin, end)))]
        if rows.size == 0:
            continue
        planned = speed.planned[rows, 3]
        floor = np.minimum(planned, window.powder_g_min.min)
        levels = track(planned, speed.share[rows], speed.time_s[rows], floor, 0.5 * least_s, least_s, POWDER_RISE)
        for row in np.flatnonzero(np.diff(levels, prepend=rate) != 0.0).tolist():
            item = int(speed.item[rows[row]])
            early = int(np.searchsorted(starts_s, starts_s[item] - ahead_s))
            found.append(
                Entry(min(max(early, begin + 1), item), Channel.POWDER_G_MIN, float(levels[row]), is_barrier=False)
            )
    return found


def track(
    planned: Floats, share: Floats, time_s: Floats, floor: Floats, slack_s: float, least_s: float, rise: float
) -> Floats:
    """(n,) levels, constant over stretches as long as may be, whose integral over time follows that of planned * share.

    planned : (n,) what is set at the planned speed   share : (n,) actual speed over planned   time_s : (n,) of each move
    floor : (n,) least level   slack_s : what the planned level gives in this time may be too much or too little in a stretch, besides
    TOLERANCE   least_s : a level holds for so long at least, but where the planned one changes   rise : greatest ratio of a step up
    that the plan does not ask for, 0: any
    """
    levels = _track(planned, np.maximum(planned * share, floor), time_s, slack_s, least_s, rise)
    own = levels == planned
    place = 10.0 ** (_DIGITS - 1 - np.floor(np.log10(np.maximum(levels, 1e-9))))
    return np.asarray(np.where(own, levels, np.maximum(np.rint(levels * place) / place, floor)))


@njit(cache=True)
def _track(planned: Floats, wanted: Floats, time_s: Floats, slack_s: float, least_s: float, rise: float) -> Floats:
    """Levels as in `track`: the planned one for as long as it is right, else the mean over the least time, for as long as that is."""
    n = len(planned)
    levels = np.empty(n)
    i = 0
    while i < n:
        soonest, amount, time = i, 0.0, 0.0
        while soonest < n and planned[soonest] == planned[i] and (soonest == i or time < least_s):
            amount, time = amount + wanted[soonest] * time_s[soonest], time + time_s[soonest]
            soonest += 1
        level, slack = planned[i], slack_s * planned[i]
        j = _right_until(level, planned, wanted, time_s, i, slack)
        if j < soonest:
            level = amount / time if time > 0.0 else level
            j = max(soonest, _right_until(level, planned, wanted, time_s, i, slack))
        if rise > 0.0 and i > 0 and planned[i] == planned[i - 1] and level > rise * levels[i - 1]:
            level, j = rise * levels[i - 1], soonest
        levels[i:j] = level
        i = j
    return levels


@njit(cache=True)
def _right_until(level: float, planned: Floats, wanted: Floats, time_s: Floats, begin: int, slack: float) -> int:
    """Where the first stretch begins over which a level gives more than the slack and TOLERANCE too much or too little."""
    much, little, since_much, since_little = 0.0, 0.0, begin, begin
    k = begin
    while k < len(planned) and planned[k] == planned[begin]:
        much += (level - (1.0 + TOLERANCE) * wanted[k]) * time_s[k]
        little += ((1.0 - TOLERANCE) * wanted[k] - level) * time_s[k]
        if much > slack:
            return since_much
        if little > slack:
            return since_little
        if much <= 0.0:
            much, since_much = 0.0, k + 1
        if little <= 0.0:
            little, since_little = 0.0, k + 1
        k += 1
    return k
