"""What only a server can show: the trail's triggers, writers in turn, readers of one state, times to the microsecond, text in any order."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Barrier, Event

import pytest
from sqlalchemy import URL, func, select
from sqlalchemy.exc import DBAPIError, InternalError, OperationalError

from cellctl.domain.jobs import JobState
from cellctl.store import Store, audit, jobs, made, tokens
from cellctl.store.audit import Deed
from cellctl.store.made import Made
from cellctl.store.schema import audit as trail
from cellctl.store.schema import jobs as job_table
from cellctl.store.tokens import Role
from tests.unit.cellctl.test_store import job_in, part_in, sharing

DEED = Deed("me", "operator", "127.0.0.1", "stop", "cell", "smoke")
WRITERS, DEEDS = 8, 12  # threads, and what each of them writes down


@pytest.fixture
def shared(store: Store, database: URL) -> Iterator[Store]:
    """A store with what is shared on a server."""
    with sharing(store, database) as opened:
        yield opened


@pytest.mark.parametrize("statement", ["UPDATE audit SET who = 'x'", "DELETE FROM audit", "TRUNCATE audit"])
def test_audit_trail_on_a_server_only_grows(shared: Store, statement: str) -> None:
    with shared.write() as rows:
        audit.add(rows, DEED, 1.0, "ok")
    with pytest.raises(DBAPIError, match="the audit trail only grows"), shared.write() as rows:
        rows.exec_driver_sql(statement)
    with pytest.raises(DBAPIError, match="duplicate key"), shared.write() as rows:
        rows.execute(trail.insert().values(seq=1, at=1.0, outcome="other", **DEED.__dict__))
    with shared.read() as rows:
        assert audit.verify(rows).rows == 1 and audit.verify(rows).fault == ""


def test_chain_of_the_trail_is_whole_under_eight_writers_at_once(shared: Store) -> None:
    together = Barrier(WRITERS)

    def write(number: int) -> None:
        together.wait()
        for k in range(DEEDS):
            with shared.write() as rows:
                audit.add(rows, replace(DEED, who=f"writer {number}"), 1.0 + k, "ok")

    with ThreadPoolExecutor(WRITERS) as pool:
        list(pool.map(write, range(WRITERS)))
    with shared.read() as rows:
        found = audit.verify(rows)
        assert (found.rows, found.fault) == (WRITERS * DEEDS, "")
        told = {row.who: row.deeds for row in rows.execute(select(trail.c.who, func.count().label("deeds")).group_by(trail.c.who))}
    assert told == {f"writer {number}": DEEDS for number in range(WRITERS)}


def test_writers_come_one_at_a_time_and_the_second_sees_what_the_first_wrote(shared: Store) -> None:
    part_id = part_in(shared)
    job = job_in(shared, part_id)
    has_lock, goes_on = Event(), Event()

    def first() -> None:
        with shared.write() as rows:
            has_lock.set()
            goes_on.wait(10.0)
            jobs.move(rows, job.id, JobState.CANCELLED, at=1.0)

    def second() -> JobState:
        has_lock.wait(10.0)
        goes_on.set()
        with shared.write() as rows:
            return jobs.get(rows, job.id).state

    with ThreadPoolExecutor(2) as pool:
        begun, seen = pool.submit(first), pool.submit(second)
        assert seen.result() is JobState.CANCELLED and begun.result() is None


def test_writer_that_is_kept_waiting_for_too_long_is_refused(shared: Store) -> None:
    with shared.write(), pytest.raises(OperationalError, match="lock timeout"), shared.engine.connect() as other:
        other.exec_driver_sql("SET lock_timeout = 50")
        other.exec_driver_sql("SELECT pg_advisory_xact_lock(%s)", (0x63656C6C,))


def test_reader_sees_one_state_waits_for_no_writer_and_cannot_write(shared: Store) -> None:
    part_id = part_in(shared)
    job = job_in(shared, part_id)
    with shared.read() as rows:
        assert jobs.get(rows, job.id).state is JobState.SUBMITTED
        with shared.write() as others:
            jobs.move(others, job.id, JobState.CANCELLED, at=1.0)
        assert jobs.get(rows, job.id).state is JobState.SUBMITTED
    with shared.read() as rows:
        assert jobs.get(rows, job.id).state is JobState.CANCELLED
    with pytest.raises(InternalError, match="read-only"), shared.read() as rows:
        jobs.change(rows, job.id, name="changed")
    with shared.write() as rows:  # a connection that was used for reading writes again
        assert jobs.change(rows, job.id, name="changed").name == "changed"


def test_times_are_kept_to_the_microsecond(shared: Store) -> None:
    at = 1_795_392_000.123457
    with shared.write() as rows:
        row, _secret = tokens.create(rows, "me", Role.VIEWER, at)
        assert [one.created_at for one in tokens.every(rows)] == [row.created_at] == [at]


def test_numbers_of_rows_go_on_where_the_trail_gave_its_own(shared: Store) -> None:
    part_id = part_in(shared)
    with shared.write() as rows:
        assert [audit.add(rows, DEED, 1.0, "ok") for _ in range(3)] == [1, 2, 3]
    assert [job_in(shared, part_id).seq for _ in range(3)] == [1, 2, 3]
    with shared.read() as rows:
        assert [row.changed for row in rows.execute(select(job_table.c.changed).order_by(job_table.c.seq))] == [1, 2, 3]


def test_what_is_made_twice_is_kept_once_with_its_last_figures(shared: Store) -> None:
    with shared.write() as rows:
        for figure in (1, 2):
            made.add(rows, "plan", "key", Made("s" * 64, {"figure": figure}), 1.0)
        found = made.find(rows, "plan", "key")
    assert found is not None and found.summary == {"figure": 2}
