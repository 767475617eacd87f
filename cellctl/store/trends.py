"""Trends of any past moment: every channel in steps of time, from the samples themselves or from the level that fits the question."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sqlalchemy import Connection, func, select

from cellctl.domain.channels import NAMES
from cellctl.store.schema import journal, trend_levels
from cellctl.store.trend_levels import (
    BATCH_ROWS,
    GREATEST,
    LEAST,
    LEVELS_S,
    Buckets,
    Floats,
    Numbers,
    columns_of,
    gather,
    of_values,
    unpack,
    upto,
)

RAW_ROWS_MAX = 12_000  # twenty minutes of a run are read sample by sample; more comes from a level
FINER = 2  # a level is at least so many times finer than the buckets asked for, as these are made of whole ones
SILENCE_S = 25.0  # two and a half times the longest time between two samples of a cell that is alive


@dataclass(frozen=True)
class Trend:
    """What a question got. step_s : width of a bucket, 0 : one per sample; made_of : level in s, 0 : the samples themselves

    at : (n,) Unix s, begin of each bucket, or its only sample's time; samples : (n,), 0 : a gap before the next, with no values
    least, greatest, mean : (n, channels asked), NaN where nobody knows
    """

    channels: tuple[str, ...]
    step_s: float
    made_of: int
    at: Floats
    samples: Numbers
    least: Floats
    greatest: Floats
    mean: Floats


def trend(rows: Connection, from_at: float, to_at: float, points: int, channels: tuple[str, ...] = NAMES) -> Trend:
    """Least, greatest and mean of channels between two times (Unix, s) in at most `points` buckets; silence of the cell is a gap.

    Raises ValueError for a channel that there is not.
    """
    picked = [NAMES.index(name) for name in channels]
    step_s = (to_at - from_at) / points
    level = _level(rows, from_at, to_at, step_s)
    found = _of_samples(rows, from_at, to_at) if level == 0 else _of_level(rows, level, from_at, to_at)
    if level == 0 and len(found.start_at) <= points:
        step_s = 0.0
        buckets = found
    else:
        origin = from_at if level == 0 else np.floor(from_at / level) * level
        if level > 0:  # a stored bucket lies within one that is asked for
            step_s = float(np.ceil((to_at - origin) / points / level)) * level
        keys = np.floor((found.start_at - origin) / step_s).astype(np.int64)
        keys, samples, figures = gather(keys, found.samples, found.figures)
        buckets = Buckets(np.asarray(origin + keys * step_s, dtype=np.float64), samples, figures)
    buckets = _with_gaps(buckets, _silences(found.start_at, max(SILENCE_S, 1.5 * level)), max(step_s, float(level)))
    figures = buckets.figures[:, picked]
    return Trend(
        channels, step_s, level, buckets.start_at, buckets.samples, figures[:, :, LEAST], figures[:, :, GREATEST], buckets.mean[:, picked]
    )  # fmt: skip


def _level(rows: Connection, from_at: float, to_at: float, step_s: float) -> int:
    """The coarsest level that is fine enough for the step; 0 for the samples, if they are few, else the finest level that is kept."""
    fitting = [level for level in LEVELS_S if FINER * level <= step_s]
    c = journal.c
    few = select(c.id).where(c.at >= from_at, c.at < to_at).limit(RAW_ROWS_MAX + 1).subquery()
    count = rows.execute(select(func.count()).select_from(few)).scalar_one()
    if not fitting and 0 < count <= RAW_ROWS_MAX:
        return 0
    t = trend_levels.c
    for level in [*reversed(fitting), *(other for other in LEVELS_S if other not in fitting)]:
        is_there = select(t.start_at).where(t.level_s == level, t.start_at > from_at - level, t.start_at < to_at).limit(1)
        if rows.execute(is_there).first() is not None:
            return level
    return 0 if count <= RAW_ROWS_MAX else LEVELS_S[0]


def _of_samples(rows: Connection, from_at: float, to_at: float, after: int = -1, limit: int = RAW_ROWS_MAX) -> Buckets:
    """Every sample as a bucket of its own, in order of time."""
    c = journal.c
    query = select(c.at, *(c[name] for name in NAMES)).where(c.at >= from_at, c.at < to_at, c.id > after).order_by(c.at).limit(limit)
    found = columns_of([tuple(row) for row in rows.execute(query)], 1 + len(NAMES))
    return Buckets(found[:, 0], np.ones(len(found), dtype=np.int64), of_values(found[:, 1:]))


def _of_level(rows: Connection, level: int, from_at: float, to_at: float) -> Buckets:
    """The buckets of a level that begin within the time asked, and what of the newest samples it does not hold yet."""
    t = trend_levels.c
    query = select(t.start_at, t.samples, t.figures).where(t.level_s == level, t.start_at > from_at - level, t.start_at < to_at)
    found = [tuple(row) for row in rows.execute(query.order_by(t.start_at))]
    start = np.array([row[0] for row in found], dtype=np.float64)
    samples = np.array([row[1] for row in found], dtype=np.int64)
    figures = unpack([row[2] for row in found])
    newest = _of_samples(rows, np.floor(from_at / level) * level, to_at, after=upto(rows), limit=BATCH_ROWS)
    keys = np.concatenate([start, np.floor(newest.start_at / level) * level]).astype(np.int64)
    keys, samples, figures = gather(keys, np.concatenate([samples, newest.samples]), np.concatenate([figures, newest.figures]))
    return Buckets(keys.astype(np.float64), samples, figures)


def _silences(at: Floats, longest_s: float) -> Floats:
    """(k, 2) begin and end of each time in which nothing was heard for longer than `longest_s`."""
    where = np.flatnonzero(np.diff(at) > longest_s)
    return np.stack([at[where], at[where + 1]], axis=1)


def _with_gaps(buckets: Buckets, silences: Floats, width_s: float) -> Buckets:
    """The buckets with an empty one in each silence that does not lie within a bucket."""
    after = np.searchsorted(buckets.start_at, silences[:, 1], side="right") - 1
    apart = (after > 0) & (buckets.start_at[np.maximum(after - 1, 0)] <= silences[:, 0])
    after, silences = after[apart], silences[apart]
    where = np.minimum(silences[:, 0] + width_s + 1e-3, 0.5 * (silences[:, 0] + silences[:, 1]))
    where = np.maximum(where, buckets.start_at[np.maximum(after - 1, 0)] + 1e-3)
    empty = of_values(np.full((len(after), len(NAMES)), np.nan))
    return Buckets(
        np.insert(buckets.start_at, after, where), np.insert(buckets.samples, after, 0), np.insert(buckets.figures, after, empty, axis=0)
    )
