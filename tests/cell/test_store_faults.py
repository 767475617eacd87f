"""A store that refuses: the cell holds dark and says why, a stop does not wait for it, and what was queued is there once it takes rows again."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest

from cellctl.cell.answering import STOP_WRITTEN_S, written
from cellctl.cell.record import Journal, StoreError
from cellctl.domain.messages import Command, Event, Reply
from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


def event(text: str) -> Event:
    return Event(0, 1.0, "note", text, "", {})


def refuse(cell: CellUnderTest, is_refusing: bool) -> None:
    cell.journal._db.execute(f"PRAGMA query_only = {'ON' if is_refusing else 'OFF'}")


async def test_store_that_refuses_while_depositing_latches_dark_and_loses_no_row(cell: CellUnderTest) -> None:
    await cell.deposit()
    cell.witness.forget()
    refuse(cell, True)
    await cell.forward(until=cell.is_state(State.FAULT), seconds=1.0)
    await cell.forward(ticks=13)
    assert cell.is_dark and cell.latched == ["store"] and "free the store" in cell.snapshot.alarms[0].remedy + cell.snapshot.alarms[0].cause
    await cell.forward(until=lambda: cell.is_still, seconds=2.0)
    again = await cell.command("reset")
    assert not again.ok and again.kind == "store"
    refuse(cell, False)
    await cell.forward(ticks=15)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=5.0)
    assert (await cell.command("resume")).ok
    await cell.hurry(cell.is_state(State.IDLE))
    cell.journal.commit()
    numbers = [one.seq for one in cell.journal.events_since(0, 10_000)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert cell.outcome == "completed" and cell.has_event("alarm", "journal cannot be written") and cell.has_event("state", "HELD")


async def test_start_that_the_store_refuses_leaves_the_job_to_be_started_again(cell: CellUnderTest) -> None:
    refuse(cell, True)
    program = one_wall(cell.facts, layers=1, mill=False)
    first = await cell.start(program, ident="start-1")
    assert not first.ok and first.kind == "store" and cell.controller.run is None
    refuse(cell, False)
    await cell.forward(ticks=15)
    if cell.state is State.FAULT:
        assert (await cell.command("reset")).ok
        await cell.forward(until=cell.is_state(State.IDLE), seconds=5.0)
    assert (await cell.start(program, ident="start-2")).ok
    with closing(sqlite3.connect(cell.store)) as db:
        assert db.execute("SELECT job, command_id FROM cell_runs").fetchall() == [("job-1", "start-2")]


async def test_stop_is_answered_while_another_program_has_the_store_locked_and_written_down_after(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    journal.start()
    with closing(sqlite3.connect(tmp_path / "s.db", isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        journal.event(event("stopped"))
        async with asyncio.timeout(10 * STOP_WRITTEN_S):
            reply = await written(journal, Command("1", "stop", "me", "test"), Reply("1", True, data={"state": "STOPPED"}))
        other.execute("ROLLBACK")
    assert reply.ok and reply.data == {"state": "STOPPED", "is_written": False}
    await journal.durable()
    assert [one.text for one in journal.events_since(0)] == ["stopped"]
    journal.close()


def test_store_whose_folder_is_moved_away_refuses_and_takes_what_was_queued_when_it_is_back(tmp_path: Path) -> None:
    folder, away = tmp_path / "store", tmp_path / "away"
    folder.mkdir()
    journal = Journal(folder / "s.db")
    folder.rename(away)
    journal.event(event("kept"))
    with pytest.raises(StoreError, match="removed or replaced"):
        journal.commit()
    assert "removed" in journal.failure
    away.rename(folder)
    journal.commit()
    assert not journal.failure and [one.text for one in journal.events_since(0)] == ["kept"]
    journal.close()


def test_full_store_is_said_with_its_remedy_and_takes_the_rows_when_there_is_room(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    pages = journal._db.execute("PRAGMA page_count").fetchone()[0]
    journal._db.execute(f"PRAGMA max_page_count = {pages}")
    for k in range(200):
        journal.event(event(f"{k} {'x' * 200}"))
    with pytest.raises(StoreError) as refused:
        journal.commit()
    assert "full" in refused.value.message and "make room on the disk" in refused.value.hint
    journal._db.execute("PRAGMA max_page_count = 100000")
    journal.commit()
    assert [one.text.split()[0] for one in journal.events_since(0)] == [str(k) for k in range(200)]
    journal.close()


async def test_slow_disk_keeps_neither_the_loop_nor_the_order_of_rows(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "s.db")
    transact, gate = journal._transact, threading.Event()

    def slow(batch: object) -> list[Event]:
        gate.wait(5.0)
        return transact(batch)  # type: ignore[arg-type]

    journal._transact = slow  # type: ignore[method-assign]
    journal.start()
    for k in range(50):
        journal.event(event(str(k)))
        await asyncio.sleep(0)  # the loop goes on though the commit stands
    waiting = asyncio.create_task(journal.durable())
    await asyncio.sleep(0)
    assert not waiting.done() and journal.commits == 0
    gate.set()
    await waiting
    assert [one.text for one in journal.events_since(0)] == [str(k) for k in range(50)]
    journal.close()
