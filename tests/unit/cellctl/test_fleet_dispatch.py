"""Jobs and cells on one store: who gets a job, who may move it, what a dead cell gives back; and three hosts at once on PostgreSQL."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Barrier

import pytest
from sqlalchemy import URL

from cellctl.domain.fleet import DEAD_S
from cellctl.domain.jobs import JobState, WrongJobStateError
from cellctl.planning import dispatcher
from cellctl.store import Store, claims, fleet, jobs
from cellctl.store.claims import ClaimedError
from cellctl.store.fleet import Seat, WrongCellError
from cellctl.store.postgres import open_postgres
from tests.unit.cellctl.fleet_of import PLANNED, Host, job_of, made_ready, submit

J = JobState
T = 1_800_000_000.0
JOBS = 200


class Clock:
    """Turned by hand."""

    def __init__(self) -> None:
        self.now = T

    def __call__(self) -> float:
        return self.now


@pytest.fixture(params=["sqlite", "postgres"])
def shared(request: pytest.FixtureRequest, store: Store) -> Iterator[Store]:
    """A store of several cells, on either database."""
    if request.param == "sqlite":
        yield store
        return
    opened = replace(store, engine=open_postgres(request.getfixturevalue("database")))
    yield opened
    opened.engine.dispose()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def pair(shared: Store, clock: Clock) -> tuple[Host, Host]:
    """Two cells that are heard."""
    hosts = Host(shared, "a", clock), Host(shared, "b", clock)
    for host in hosts:
        host.beat()
    return hosts


def test_jobs_for_any_go_round_and_named_ones_where_they_were_meant_to(pair: tuple[Host, Host]) -> None:
    a, b = pair
    part = made_ready(a.store)
    named = [submit(a.store, part, "b"), submit(a.store, part, "b")]
    any_ = [submit(a.store, part) for _ in range(4)]
    assert set(a.beat()) == set(any_) and b.beat() == []
    cells = [job_of(a.store, one).cell for one in any_]
    assert cells == ["a", "a", "a", "b"] and all(job_of(a.store, one).cell == "b" for one in named)  # b had two before
    with a.store.read() as rows:
        assert [step.why for step in jobs.steps_of(rows, any_[0])] == ["submitted", "given to a: 0 jobs before it, the least of those that it fits"]
        assert [job.id for job in jobs.first_in(rows, J.SUBMITTED, 9, "b")] == [*named, any_[3]]


def test_a_dead_cell_gives_back_what_it_has_not_started_and_keeps_the_rest(pair: tuple[Host, Host], clock: Clock) -> None:
    a, b = pair
    part = made_ready(a.store)
    ids = {name: submit(a.store, part, "a") if name == "named" else submit(a.store, part) for name in (
        "submitted", "planning", "queued", "claimed", "running", "interrupted", "named", "continuing")}  # fmt: skip
    with a.store.write() as rows:
        for job_id in ids.values():
            jobs.change(rows, job_id, cell="a")
        jobs.change(rows, ids["continuing"], continues_job=ids["interrupted"])
    a.move(ids["planning"], J.PLANNING)
    for name in ("queued", "claimed", "running", "interrupted", "named", "continuing"):
        a.move(ids[name], *PLANNED, approved_by="eve", program_sha256="0" * 64)
    a.claim(ids["claimed"])
    a.move(ids["running"], J.RUNNING)
    a.move(ids["interrupted"], J.RUNNING, J.INTERRUPTED)

    clock.now += DEAD_S - 0.1
    assert b.beat() == []
    clock.now += 0.1
    freed = ["submitted", "planning", "queued"]
    assert set(b.beat()) == {ids[name] for name in freed}
    for name, job_id in ids.items():
        job = job_of(b.store, job_id)
        assert job.cell == ("b" if name in freed else "a"), name
        assert (job.state is J.SUBMITTED) == (name in freed)
    queued = job_of(b.store, ids["queued"])
    assert (queued.approved_by, queued.program_sha256, queued.table_clear) == ("", None, False)
    with b.store.read() as rows:
        assert [step.why for step in jobs.steps_of(rows, ids["queued"])][-2:] == [
            "a is not heard: it waits for another cell", "given to b: 2 jobs before it"]  # fmt: skip

    with pytest.raises(WrongCellError, match="it is b's"):  # it comes back late and goes on where it was
        a.move(ids["planning"], J.PLANNED)
    with pytest.raises(WrongCellError):
        a.claim(ids["queued"])
    a.claim(ids["claimed"])
    a.move(ids["claimed"], J.RUNNING)
    assert job_of(a.store, ids["claimed"]).claimed_by == ""


def test_a_claim_holds_off_everybody_until_it_is_withdrawn(pair: tuple[Host, Host]) -> None:
    a, _ = pair
    part = made_ready(a.store)
    job_id = submit(a.store, part, "a")
    with pytest.raises(WrongJobStateError):
        a.claim(job_id)
    a.move(job_id, *PLANNED)
    a.claim(job_id)
    a.claim(job_id)  # the answer was lost: asked again
    assert job_of(a.store, job_id).claimed_by == a.seat.owner
    with a.store.write() as rows:
        fleet.leave(rows, "a", a.seat.owner)
        fleet.tell(rows, fleet.Told("a", "another"), T)
        with pytest.raises(ClaimedError, match="was about to be started by another service of a"):
            claims.claim(rows, job_id, Seat("a", "another"), T)
        claims.withdraw(rows, job_id, Seat("a", "another"))  # not its own: nothing happens
    assert job_of(a.store, job_id).claimed_by == a.seat.owner
    with pytest.raises(WrongCellError, match="another service has that cell"):
        a.move(job_id, J.RUNNING)
    a.withdraw(job_id)
    assert (job_of(a.store, job_id).claimed_by, job_of(a.store, job_id).claimed_at) == ("", None)


def test_a_job_that_fits_none_says_so_once_and_goes_when_one_comes(pair: tuple[Host, Host], clock: Clock) -> None:
    a, b = pair
    part = made_ready(a.store)
    clock.now += 20.0  # neither is heard
    job_id = submit(a.store, part)
    with a.store.write() as rows:
        members = fleet.members(rows, clock.now)
        assert dispatcher.is_needed(rows, members)
        assert dispatcher.dispatch(rows, members, clock.now) == [job_id] and dispatcher.dispatch(rows, members, clock.now) == []
    assert job_of(a.store, job_id).why == "waits for a cell: none is heard"
    b.beat()
    assert (job_of(a.store, job_id).cell, job_of(a.store, job_id).why) == ("b", "")


def test_three_hosts_at_once_take_each_of_two_hundred_jobs_once(store: Store, database: URL) -> None:
    engines = [open_postgres(database) for _ in range(3)]
    stores = [replace(store, engine=engine) for engine in engines]
    clock = Clock()
    part = made_ready(stores[0])
    hosts = [Host(one, name, clock) for one, name in zip(stores, "abc", strict=True)]
    for host in hosts:
        host.beat()
    ids = [submit(stores[0], part) for _ in range(JOBS)]
    together = Barrier(len(hosts))

    def work(host: Host) -> list[str]:
        together.wait()
        taken: list[str] = []
        while True:
            host.beat()
            job = host.first(J.SUBMITTED)
            if job is None:
                return taken
            for other in hosts:  # all reach for it at once; it is only one's to claim
                try:
                    if other is host:
                        host.move(job.id, *PLANNED)
                        host.claim(job.id)
                        host.move(job.id, J.RUNNING, J.COMPLETED)
                        taken.append(job.id)
                    else:
                        other.on(host.store).claim(job.id)
                        raise AssertionError("a job was claimed by a cell that it is not of")
                except WrongCellError:
                    assert other is not host

    try:
        with ThreadPoolExecutor(len(hosts)) as pool:
            taken = list(pool.map(work, hosts))
        assert sorted(job for one in taken for job in one) == sorted(ids)
        assert min(map(len, taken)) > JOBS / 6  # all three had their share
        with stores[0].read() as rows:
            for job_id in ids:
                steps = jobs.steps_of(rows, job_id)
                assert [step.state for step in steps].count("running") == 1 and steps[-1].state == "completed"
                assert len([step for step in steps if step.why.startswith("given to")]) == 1
            assert jobs.count_by_state(rows) == {"completed": JOBS}
    finally:
        for engine in engines:
            engine.dispose()
