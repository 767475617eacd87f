"""Whether the store tells the same as those who were there: events without gaps, runs with their ends, progress that never goes back."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path


def errors_in(store: Path, started: Sequence[str], sent: Counter[str], seen: Sequence[int]) -> list[str]:
    """What does not agree, in words.

    store : SQLite file, of processes that have ended   started : jobs in their order   sent : commands by verb that were answered
    seen : seq of the events that a console got
    """
    with closing(sqlite3.connect(store)) as db:
        found = [text for (text,) in db.execute("PRAGMA integrity_check") if text != "ok"]
        numbers = [seq for (seq,) in db.execute("SELECT seq FROM events ORDER BY seq")]
        if numbers != list(range(1, len(numbers) + 1)):
            found.append(f"{len(numbers)} events up to number {numbers[-1]}")
        if seen and list(seen) != list(range(seen[0], seen[-1] + 1)):
            found.append(f"a console got {len(seen)} events between {seen[0]} and {seen[-1]}")
        told: Counter[str] = Counter(
            verb for (verb,) in db.execute("SELECT json_extract(data, '$.verb') FROM events WHERE kind = 'command'")
        )
        found += [f"{verb}: {sent[verb]} sent, {told[verb]} written down" for verb in sent | told if sent[verb] != told[verb]]
        found += _runs(db, started)
        return found


def _runs(db: sqlite3.Connection, started: Sequence[str]) -> list[str]:
    found = []
    runs = db.execute("SELECT job, outcome, ended_at, last_line, total_lines FROM cell_runs ORDER BY started_at").fetchall()
    if [job for job, *_ in runs] != list(started):
        found.append(f"{len(started)} jobs started, {len(runs)} runs written down")
    for job, outcome, ended_at, last_line, total in runs:
        if ended_at is None or not outcome:
            found.append(f"{job} has no end")
        if outcome == "completed" and last_line != total:
            found.append(f"{job} completed at line {last_line} of {total}")
        (told,) = db.execute("SELECT count(*) FROM events WHERE kind = 'job' AND job = ?", (job,)).fetchone()
        if told != 2:
            found.append(f"{job}: {told} events of begin and end")
    back = db.execute(
        "SELECT count(*) FROM (SELECT executed_line, lag(executed_line) OVER (PARTITION BY job ORDER BY id) AS before FROM journal)"
        " WHERE executed_line < before"
    ).fetchone()[0]
    if back:
        found.append(f"progress went back {back} times")
    return found


def outcomes(store: Path) -> dict[str, int]:
    """How many runs had which end."""
    with closing(sqlite3.connect(store)) as db:
        return dict(db.execute("SELECT outcome, count(*) FROM cell_runs GROUP BY outcome"))


def sizes(store: Path) -> dict[str, int]:
    """Rows of the tables that grow with time."""
    with closing(sqlite3.connect(store)) as db:
        return {table: int(db.execute(f"SELECT count(*) FROM {table}").fetchone()[0]) for table in ("events", "journal", "cell_runs")}
