"""Who watches the machine goes on seeing it while the shared database is away, and is told afterwards what changed meanwhile."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import URL

from cellctl.domain.jobs import JobState
from cellctl.domain.snapshot import Snapshot
from cellctl.store import Store, jobs
from tests.postgres import Cluster
from tests.unit.cellctl.conftest import Web, serving
from tests.unit.cellctl.test_api_events import WAIT_S, Reader, connected, happen
from tests.unit.cellctl.test_store import job_in, part_in, sharing


@pytest.fixture
async def web(tmp_path: Path, store: Store, database: URL) -> AsyncIterator[Web]:
    """The application on a store that is shared."""
    with sharing(store, database) as shared:
        async with serving(shared, tmp_path) as made:
            yield made


def tell(web: Web, number: int) -> None:
    web.service.feed.take_snapshot(Snapshot(seq=number, at=1.0, cell="c", mode="sim", state="RUNNING", execution="ACTIVE"))


async def watched_by(web: Web, count: int) -> None:
    async with asyncio.timeout(WAIT_S):
        while len(web.service.feed) < count:
            await asyncio.sleep(0.01)


async def heard(reader: Reader, kind: str) -> dict[str, Any]:
    while (message := await reader.next())["event"] != kind:
        pass
    return dict(message["data"])


async def test_a_console_sees_the_machine_while_the_shared_database_is_away_and_then_the_jobs(web: Web, postgres: Cluster) -> None:
    store = web.service.store
    job = job_in(store, part_in(store), state=JobState.WAITING_FOR_APPROVAL)
    assert (await web.viewer.get("/api/v1/jobs")).status_code == 200  # known from here on
    async with connected(web, query="snapshots=true") as before:
        await watched_by(web, 1)
        postgres.stop()
        try:
            web.service.feed.take_job(job.id)
            tell(web, 1)
            assert (await heard(before, "snapshot"))["snapshot"]["seq"] == 1
            happen(web, seen=True)
            assert (await heard(before, "event"))["event"]["text"] == "x"
            async with connected(web, query="snapshots=true") as meanwhile:
                await watched_by(web, 2)
                tell(web, 2)
                assert (await heard(meanwhile, "snapshot"))["snapshot"]["seq"] == 2
                assert (await heard(before, "snapshot"))["snapshot"]["seq"] == 2
        finally:
            postgres.start()
        with store.write() as rows:
            jobs.change(rows, job.id, why="looked at again")
        told = await heard(before, "job")
        while told["job"]["why"] != "looked at again":
            told = await heard(before, "job")
        assert told["job"]["id"] == job.id
