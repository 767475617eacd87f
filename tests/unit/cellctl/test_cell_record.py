"""The journal: durable before the answer, seq without gaps, from its own thread."""

from __future__ import annotations

import sqlite3
import time
from contextlib import closing
from pathlib import Path

import pytest

from cellctl.cell.record import END, GROUP_S, RUN, SAMPLE, Journal, Sample, StoreError
from cellctl.domain.messages import Event


def event(text: str, kind: str = "state") -> Event:
    return Event(0, 1.0, kind, text)


async def test_durable_returns_when_another_connection_can_read_what_was_queued(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    seen: list[Event] = []
    journal.on_committed = seen.extend
    journal.start()
    journal.event(event("one"))
    journal.event(event("two"))
    await journal.durable()
    with closing(sqlite3.connect(tmp_path / "s.db")) as db, db:
        assert db.execute("SELECT seq, text FROM events").fetchall() == [(1, "one"), (2, "two")]
    journal.close()
    assert [(e.seq, e.text) for e in seen] == [(1, "one"), (2, "two")]


async def test_rows_come_to_the_disk_in_groups_without_anybody_waiting(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    journal.start()
    sample = Sample(1.0, "j", "RUNNING", 3, 0, 1.5, 800.0, 799.0, 10.0, 9.9, (1.0, 2.0, 3.0))
    began = time.monotonic()
    for _ in range(500):
        journal.write(SAMPLE, sample.row)
    await journal.durable()
    journal.close()
    took_s = time.monotonic() - began
    with closing(sqlite3.connect(tmp_path / "s.db")) as db, db:
        assert db.execute("SELECT count(*), max(tip_z) FROM journal").fetchone() == (500, 3.0)
    assert journal.commits <= 5 + took_s / GROUP_S


def test_what_was_left_unfinished_is_found_and_what_was_ended_is_not(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    for job in ("a", "b"):
        journal.write(RUN, (job, job.upper(), "dir", "sha", 1.0, 100, "me", f"id-{job}"))
    journal.write(END, (2.0, "completed", 100, "a"))
    journal.commit()
    journal.close()
    again = Journal(tmp_path / "s.db")
    found = again.find()
    again.close()
    assert [(run.job, run.last_line, run.total_lines) for run in found.unfinished] == [("b", 0, 100)]
    assert found.jobs == {"a", "b"}


def test_a_commit_that_fails_keeps_what_was_queued(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    journal._db.execute("PRAGMA query_only = ON")
    journal.event(event("kept"))
    with pytest.raises(StoreError, match="cannot be written"):
        journal.commit()
    journal._db.execute("PRAGMA query_only = OFF")
    journal.event(event("later"))
    journal.commit()
    assert [e.text for e in journal.events_since(0)] == ["kept", "later"]
    journal.close()


def test_a_store_in_a_directory_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="cannot be opened") as caught:
        Journal(tmp_path / "no" / "s.db")
    assert caught.value.hint
