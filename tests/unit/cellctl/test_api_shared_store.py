"""A service whose shared database goes away and comes back, as a client of REST sees it; the cell's own tables are there all the time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from sqlalchemy import URL, insert

from cellctl.domain.jobs import JobState
from cellctl.store import Store, jobs
from cellctl.store.schema import events
from tests.postgres import Cluster
from tests.unit.cellctl.conftest import Web, serving
from tests.unit.cellctl.test_store import job_in, part_in, sharing

BACK_S = 30.0
JOBS, EVENTS = "/api/v1/jobs", "/api/v1/cell/events"


@pytest.fixture
async def web(tmp_path: Path, store: Store, database: URL) -> AsyncIterator[Web]:
    """The application on a store that is shared."""
    with sharing(store, database) as shared:
        async with serving(shared, tmp_path) as made:
            yield made


async def test_database_that_is_away_is_told_with_what_to_do_and_all_goes_on_when_it_is_back(web: Web, postgres: Cluster) -> None:
    store = web.service.store
    job = job_in(store, part_in(store), state=JobState.WAITING_FOR_APPROVAL)
    assert (await web.operator.get(JOBS)).status_code == 200
    postgres.stop()
    try:
        for answer in (
            await web.operator.get(JOBS),
            await web.operator.post(f"{JOBS}/{job.id}/cancel", json={"because": "test"}),
            await web.admin.get(JOBS),  # not known yet: nobody can say who this is
        ):
            assert answer.status_code == 503 and answer.headers["content-type"] == "application/problem+json"
            assert "shared database" in answer.json()["title"] and "PostgreSQL" in answer.json()["hint"]
        with store.write_cell() as rows:
            rows.execute(insert(events).values(at=1.0, kind="state", text="RUNNING"))
        answer = await web.operator.get(EVENTS)  # who was known goes on with the cell
        assert answer.status_code == 200 and [one["text"] for one in answer.json()["items"]] == ["RUNNING"]
        assert (await web.operator.get("/api/v1/users")).status_code == 403  # and is no more than before
    finally:
        postgres.start()
    async with asyncio.timeout(BACK_S):
        while (await web.admin.get(JOBS)).status_code != 200:
            await asyncio.sleep(0.1)
        assert (await web.operator.post(f"{JOBS}/{job.id}/cancel", json={"because": "test"})).status_code == 200
        waiting = job_in(store, part_in(store), "planned again", JobState.SUBMITTED)
        with store.write() as rows:
            jobs.change(rows, waiting.id, cell=web.service.cell.name)
        while True:
            web.service.queue.wake()
            with store.read() as rows:
                if jobs.get(rows, waiting.id).state is not JobState.SUBMITTED:
                    return
            await asyncio.sleep(0.1)


async def test_text_that_the_database_cannot_keep_is_refused_and_changes_nothing(web: Web) -> None:
    job = job_in(web.service.store, part_in(web.service.store), state=JobState.WAITING_FOR_APPROVAL)
    answer = await web.operator.post(f"{JOBS}/{job.id}/cancel", json={"because": "a\0b"})
    assert answer.status_code == 422 and "NUL" in answer.json()["detail"]
    with web.service.store.read() as rows:
        assert jobs.get(rows, job.id) == job
