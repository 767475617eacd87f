"""Samples are bounded: the newest stay whole, older ones each tenth, the oldest go; nothing else goes, and nobody waits for it."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import pytest

from cellctl.cell import record
from cellctl.cell.record import END, RUN, SAMPLE, Journal, Sample
from cellctl.cell.sample_keeping import EACH, STEP_ROWS, SampleKeeping
from cellctl.domain.channels import NAMES
from cellctl.domain.messages import Event

WHOLE = 1000


def row(k: int) -> tuple[object, ...]:
    return Sample(float(k), "job", "RUNNING", k, 0, 0.0, (0.0,) * len(NAMES), (0.0, 0.0, 0.0), 31).row


def filled(store: Path, rows: int) -> None:
    """A store with a run, an event and so many samples."""
    journal = Journal(store)
    journal.write(RUN, ("job", "job", "p", "d" * 64, 1.0, rows, "who", "c1"))
    journal.event(Event(0, 1.0, "command", "start", "job", {"id": "c1", "reply": {"id": "c1", "ok": True}}))
    for k in range(rows):
        journal.write(SAMPLE, row(k))
    journal.write(END, (2.0, "completed", rows, "job"))
    journal.commit()
    journal.close()


def numbers(db: sqlite3.Connection) -> list[int]:
    return [number for (number,) in db.execute("SELECT id FROM journal ORDER BY id")]


def test_the_newest_stay_whole_older_ones_each_tenth_and_the_oldest_go_in_small_steps(tmp_path: Path) -> None:
    newest = 15 * WHOLE
    filled(tmp_path / "store.db", newest)
    with closing(sqlite3.connect(tmp_path / "store.db", isolation_level=None)) as db:
        keeping, most, steps = SampleKeeping(db, WHOLE), 0, 0
        while removed := keeping.step():
            most, steps = max(most, removed), steps + 1
        oldest = newest - WHOLE - EACH * WHOLE
        kept = numbers(db)
        assert kept == [*range(oldest + EACH, newest - WHOLE + 1, EACH), *range(newest - WHOLE + 1, newest + 1)]
        assert most <= 2 * STEP_ROWS and steps >= (newest - len(kept)) / (2 * STEP_ROWS)
        assert len(kept) <= 2 * WHOLE
        again = SampleKeeping(db, WHOLE)
        assert again.step() == 0 and numbers(db) == kept
        assert [db.execute(f"SELECT count(*) FROM {table}").fetchone()[0] for table in ("events", "cell_runs")] == [1, 1]
        assert db.execute("PRAGMA busy_timeout").fetchone()[0] == 5000


def test_a_store_that_another_process_writes_to_is_left_alone_at_once(tmp_path: Path) -> None:
    filled(tmp_path / "store.db", 3 * WHOLE)
    with closing(sqlite3.connect(tmp_path / "store.db", isolation_level=None)) as db, closing(sqlite3.connect(tmp_path / "store.db")) as other:
        keeping = SampleKeeping(db, WHOLE)
        other.execute("BEGIN IMMEDIATE")
        began = time.monotonic()
        assert keeping.step() == 0 and time.monotonic() - began < 1.0
        other.rollback()
        assert keeping.step() == STEP_ROWS


def test_a_store_that_cannot_be_read_is_left_alone_too(tmp_path: Path) -> None:
    filled(tmp_path / "store.db", 2 * WHOLE)
    with closing(sqlite3.connect(tmp_path / "store.db", isolation_level=None)) as db:
        keeping = SampleKeeping(db, WHOLE)
        db.execute("ALTER TABLE journal RENAME TO gone")
        assert keeping.step() == 0
        db.execute("ALTER TABLE gone RENAME TO journal")
        assert keeping.step() > 0


async def test_the_journals_own_thread_keeps_samples_bounded_while_commands_are_made_durable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record, "KEEPING_S", 0.0)
    journal = Journal(tmp_path / "store.db", samples_kept=WHOLE)
    journal.start()
    longest = 0.0
    for k in range(6):
        for number in range(WHOLE):
            journal.write(SAMPLE, row(k * WHOLE + number))
        began = time.monotonic()
        await journal.durable()
        longest = max(longest, time.monotonic() - began)
    for number in range(15):  # as a run goes on
        journal.write(SAMPLE, row(number))
        await asyncio.sleep(record.GROUP_S)
    journal.close()
    with closing(sqlite3.connect(tmp_path / "store.db")) as db:
        kept = numbers(db)
    assert len(kept) <= WHOLE + 5 * WHOLE / EACH + 15 and kept[-WHOLE:] == list(range(kept[-1] - WHOLE + 1, kept[-1] + 1))
    assert longest < 2.0
