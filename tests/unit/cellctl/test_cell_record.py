"""The journal: durable before the answer, seq without gaps, from its own thread."""

from __future__ import annotations

import json
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import pytest

from cellctl.cell import record
from cellctl.cell.record import END, GROUP_S, RUN, SAMPLE, Journal, Sample, StoreError
from cellctl.domain.channels import NAMES
from cellctl.domain.messages import Event

FIGURES = tuple(float(k) for k in range(len(NAMES)))


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
    sample = Sample(1.0, "j", "RUNNING", 3, 0, 1.5, FIGURES, (1.0, 2.0, 3.0), 31)
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


def test_a_row_that_can_never_be_written_is_set_aside_and_told_and_the_others_go_on(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    told: list[Event] = []
    journal.on_committed = told.extend
    journal.event(event("before"))
    sample = Sample(1.0, "j", "RUNNING", 1 << 70, 0, 1.5, FIGURES, (1.0, 2.0, 3.0), 31)
    journal.write(SAMPLE, sample.row)
    journal.event(event("behind"))
    journal.commit()
    texts = [e.text for e in journal.events_since(0)]
    journal.close()
    assert texts[:2] == ["before", "behind"] and "s.db.refused.jsonl" in texts[2]
    assert [e.text for e in told] == texts
    kept = [json.loads(line) for line in (tmp_path / "s.db.refused.jsonl").read_text().splitlines()]
    assert [row["row"][3] for row in kept] == [1 << 70]


async def test_a_start_whose_row_is_refused_is_answered_so_and_the_command_behind_it_is_not(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    row = ("a", "A", "dir", "sha", 1.0, 100, "me", "id-a")
    journal.write(RUN, row)
    await journal.durable()
    journal.write(RUN, row)
    journal.start()
    with pytest.raises(StoreError, match="refused a row"):
        await journal.durable()
    journal.event(event("hold", "command"))
    await journal.durable()
    journal.close()


async def test_a_locked_store_is_told_and_takes_all_that_was_queued_once_it_is_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record, "BUSY_TIMEOUT_S", 0.01)
    monkeypatch.setattr(record, "RETRY_S", 0.01)
    journal = Journal(tmp_path / "s.db")
    failed: list[str] = []
    journal.on_failure = failed.append
    with closing(sqlite3.connect(tmp_path / "s.db", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        journal.start()
        journal.event(event("one"))
        with pytest.raises(StoreError, match="locked"):
            await journal.durable()
        journal.event(event("two"))
        other.execute("ROLLBACK")
    await journal.durable()
    texts = [e.text for e in journal.events_since(0)]
    journal.close()
    assert texts == ["one", "two"] and "locked" in failed[0]


def test_a_full_store_keeps_what_was_queued_until_there_is_room(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    pages = journal._db.execute("PRAGMA page_count").fetchone()[0]
    journal._db.execute(f"PRAGMA max_page_count = {pages}")
    for k in range(50):
        journal.event(event(f"{k} {'x' * 500}"))
    with pytest.raises(StoreError, match="full"):
        journal.commit()
    journal._db.execute("PRAGMA max_page_count = 100000")
    journal.commit()
    assert len(journal.events_since(0)) == 50
    journal.close()
