"""Thinned levels of the samples: least, greatest, sum and count of every channel in steps of 10 s to an hour.

The web process makes them from the journal's rows, each row once, so that the cell process has no work with them. A question about a
year is answered from a few thousand rows, and the least and greatest stay exact; levels outlive the samples that they were made of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, delete, func, insert, select, update

from cellctl.domain.channels import NAMES
from cellctl.store.schema import journal, trend_levels

LEVELS_S = (10, 60, 600, 3600)
KEPT_S = {10: 60 * 86_400.0, 60: 730 * 86_400.0}
"""How long the two finest levels are kept: about 110 MB each at most; the others stay for ever, 15 MB in a year."""
BATCH_ROWS = 2000  # read and written at a time
LEAST, GREATEST, SUM, COUNT = range(4)
WORDS = 4  # per channel
Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Buckets:
    """Figures of some steps of time. start_at : (n,) Unix s; samples : (n,); figures : (n, channels, 4) as LEAST .. COUNT; least and greatest
    are NaN where a channel has no value."""

    start_at: Floats
    samples: Numbers
    figures: Floats

    @property
    def mean(self) -> Floats:
        """(n, channels) mean of the samples; NaN where there are none."""
        with np.errstate(invalid="ignore"):
            mean: Floats = self.figures[:, :, SUM] / np.where(self.figures[:, :, COUNT] > 0, self.figures[:, :, COUNT], np.nan)
        return mean


def gather(keys: Numbers, samples: Numbers, figures: Floats) -> tuple[Numbers, Numbers, Floats]:
    """Put together what has the same key. keys : (n,); samples : (n,); figures : (n, channels, 4). Keys come back in order, each once."""
    order = np.argsort(keys, kind="stable")
    unique, begins = np.unique(keys[order], return_index=True)
    if len(unique) == 0:
        return unique, samples[:0], figures[:0]
    sorted_ = figures[order]
    together = np.empty((len(unique), *figures.shape[1:]))
    together[:, :, LEAST] = np.fmin.reduceat(sorted_[:, :, LEAST], begins)
    together[:, :, GREATEST] = np.fmax.reduceat(sorted_[:, :, GREATEST], begins)
    together[:, :, SUM:] = np.add.reduceat(sorted_[:, :, SUM:], begins)
    return unique, np.add.reduceat(samples[order], begins), together


def of_values(values: Floats) -> Floats:
    """(n, channels, 4) figures of single samples; NaN: no value. values : (n, channels)"""
    is_known = np.isfinite(values)
    return np.stack([np.where(is_known, values, np.nan)] * 2 + [np.where(is_known, values, 0.0), is_known.astype(float)], axis=2)


def pack(figures: Floats) -> bytes:
    """One bucket's (channels, 4) figures as 32-bit floats, little-endian."""
    return figures.astype("<f4").tobytes()


def unpack(blobs: list[bytes]) -> Floats:
    """(n, channels, 4) figures; channels that an older version did not have are empty."""
    width = 4 * WORDS * len(NAMES)
    empty = pack(of_values(np.full((1, 1), np.nan))[0])
    whole = b"".join(blob if len(blob) == width else (blob + empty * len(NAMES))[:width] for blob in blobs)
    return np.frombuffer(whole, dtype="<f4").astype(np.float64).reshape(len(blobs), len(NAMES), WORDS)


def columns_of(rows: list[tuple[float | None, ...]], width: int) -> Floats:
    """(n, width) rows of numbers as an array; None becomes NaN."""
    return np.array(rows, dtype=np.float64).reshape(len(rows), width)


def upto(rows: Connection) -> int:
    """Number of the last sample that the levels hold, 0 if they hold none."""
    query = select(func.coalesce(func.max(trend_levels.c.last_id), 0)).where(trend_levels.c.level_s == LEVELS_S[-1])
    return int(rows.execute(query).scalar_one())


def newest(rows: Connection) -> int:
    """Number of the newest sample, 0 if there is none."""
    return int(rows.execute(select(func.coalesce(func.max(journal.c.id), 0))).scalar_one())


def advance(rows: Connection, after: int) -> tuple[int, int]:
    """Take the next samples behind number `after` into the levels; the number of the last that was taken, and how many there were."""
    c = journal.c
    query = select(c.id, c.at, *(c[name] for name in NAMES)).where(c.id > after, c.at.is_not(None)).order_by(c.id).limit(BATCH_ROWS)
    found = columns_of([tuple(row) for row in rows.execute(query)], 2 + len(NAMES))
    if len(found) == 0:
        return after, 0
    last = int(found[-1, 0])
    figures, ones = of_values(found[:, 2:]), np.ones(len(found), dtype=np.int64)
    for level in LEVELS_S:
        keys, samples, together = gather(np.floor(found[:, 1] / level).astype(np.int64), ones, figures)
        for k, key in enumerate(keys):
            _merge(rows, level, int(key) * level, int(samples[k]), last, together[k])
    return last, len(found)


def _merge(rows: Connection, level_s: int, start_at: int, samples: int, last_id: int, figures: Floats) -> None:
    """Add to one bucket what has come."""
    t = trend_levels.c
    here = (t.level_s == level_s) & (t.start_at == start_at)
    known = rows.execute(select(t.samples, t.figures).where(here)).first()
    if known is None:
        values = {"level_s": level_s, "start_at": start_at, "samples": samples, "last_id": last_id, "figures": pack(figures)}
        rows.execute(insert(trend_levels).values(**values))
        return
    both = np.stack([unpack([known.figures])[0], figures])
    _, _, together = gather(np.zeros(2, dtype=np.int64), np.zeros(2, dtype=np.int64), both)
    changed = {"samples": known.samples + samples, "last_id": last_id, "figures": pack(together[0])}
    rows.execute(update(trend_levels).where(here).values(**changed))


def forget(rows: Connection, now: float) -> int:
    """Remove what of the finest levels is older than they are kept, a few thousand at most; how many were removed. now : Unix time (s)"""
    t, removed = trend_levels.c, 0
    for level, kept_s in KEPT_S.items():
        oldest = rows.execute(select(func.min(t.start_at)).where(t.level_s == level)).scalar_one()
        if oldest is not None and oldest < now - kept_s:
            until = min(now - kept_s, oldest + BATCH_ROWS * level)
            removed += rows.execute(delete(trend_levels).where(t.level_s == level, t.start_at < until)).rowcount
    return removed
