"""How many samples of runs the store keeps: the newest whole, of older ones each tenth, the oldest not; a few hundred rows at a time.

Events, commands, alarms and runs are kept for ever: a person makes those, a few at a time; samples come ten times a second.
"""

from __future__ import annotations

import sqlite3

KEPT_WHOLE = 2_000_000  # rows: more than two days of metal without a pause; with as many thinned ones behind them about 0.7 GB
EACH = 10  # of the older ones one in so many is kept: samples_of(every=10) tells the same before and after
STEP_ROWS = 500  # removed at most in one transaction: a few milliseconds
STEP_IDS = 20_000  # looked through at most in one step

THIN = f"DELETE FROM journal WHERE id IN (SELECT id FROM journal WHERE id > ? AND id <= ? AND id % {EACH} <> 0 LIMIT {STEP_ROWS})"
DROP = f"DELETE FROM journal WHERE id IN (SELECT id FROM journal WHERE id <= ? ORDER BY id LIMIT {STEP_ROWS})"


class SampleKeeping:
    """Thins the samples of a store, step by step. whole : rows that are kept whole, newest first; as many thinned ones stay behind them"""

    def __init__(self, db: sqlite3.Connection, whole: int = KEPT_WHOLE) -> None:
        self._db = db
        self._whole = whole
        first = db.execute("SELECT min(id) FROM journal").fetchone()[0]
        self._thinned_to = (first or 1) - 1  # what an earlier process has thinned is looked through again, and nothing found

    def step(self) -> int:
        """Remove what is beyond the bounds, at most STEP_ROWS of each kind, in one transaction; how many were removed.

        A store that another process writes to, or that refuses, is left alone until the next step.
        """
        try:
            return self._step()
        except sqlite3.Error:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            return 0

    def _step(self) -> int:
        newest = self._db.execute("SELECT max(id) FROM journal").fetchone()[0] or 0
        whole_from = newest - self._whole
        upto = min(self._thinned_to + STEP_IDS, whole_from)
        oldest = whole_from - EACH * self._whole
        if upto <= self._thinned_to and oldest <= 0:
            return 0
        removed = thinned = 0
        (patience_ms,) = self._db.execute("PRAGMA busy_timeout").fetchone()
        self._db.execute("PRAGMA busy_timeout = 0")  # what waits to be written is not kept waiting
        try:
            self._db.execute("BEGIN IMMEDIATE")
            if upto > self._thinned_to:
                removed = thinned = self._db.execute(THIN, (self._thinned_to, upto)).rowcount
            if oldest > 0:
                removed += self._db.execute(DROP, (oldest,)).rowcount
            self._db.execute("COMMIT")
        finally:
            self._db.execute(f"PRAGMA busy_timeout = {patience_ms}")
        if thinned < STEP_ROWS:
            self._thinned_to = max(upto, self._thinned_to)
        return removed
