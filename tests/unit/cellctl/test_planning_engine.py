"""The planning queue and whoever carries its tasks out: how many it asks for, what a job says while it waits, what a cancelled one leaves."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Settings
from cellctl.planning.engine import Progress, Waits, unheard
from cellctl.planning.pool.wire import PoolWire
from cellctl.planning.process import WorkerError
from cellctl.planning.task import Failed, Task
from cellctl.store import Store, tokens
from cellctl.store.tokens import Role
from config import find_facts
from tests.unit.cellctl.conftest import Web
from tests.unit.cellctl.planning_house import free_port

WHY = "no planning machine is in the pool"
PATIENCE_S = 90.0  # of a loaded machine that has to start processes


class SlowEngine:
    """An engine of two places whose machines are away until `come`."""

    places = 2

    def __init__(self) -> None:
        self.come = asyncio.Event()
        self.running = 0

    async def run(self, task: Task, progress: Progress, waits: Waits = unheard) -> dict[str, Any]:
        self.running += 1
        waits(WHY)
        try:
            await self.come.wait()
            waits("")
            raise WorkerError(Failed("The mesh cannot be used", f"{task.part_name}: no"))
        finally:
            self.running -= 1


@pytest.fixture
async def engine(web: Any) -> AsyncIterator[SlowEngine]:
    made = SlowEngine()
    web.service.queue._work = replace(web.service.queue._work, workers=made)
    yield made
    made.come.set()


@pytest.fixture
async def part_id(web: Any, block: Path) -> str:
    answer = await web.operator.post("/api/v1/parts", files={"file": ("block.stl", block.read_bytes())})
    return str(answer.json()["id"])


async def jobs_until(web: Any, holds: Any) -> list[dict[str, Any]]:
    """All jobs, newest last, as soon as they are as wanted."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            items: list[dict[str, Any]] = list(reversed((await web.viewer.get("/api/v1/jobs")).json()["items"]))
            if holds(items):
                return items
            await asyncio.sleep(0.02)


async def test_jobs_fill_the_places_of_their_engine_and_say_what_they_wait_for(web: Any, engine: SlowEngine, part_id: str) -> None:
    ids = [(await web.operator.post("/api/v1/jobs", json={"part_id": part_id, "recipe": {"cusp_mm": cusp}})).json()["id"] for cusp in (0.1, 0.2, 0.3)]
    jobs = await jobs_until(web, lambda items: [job["why"] for job in items[:2]] == [WHY, WHY])
    assert [job["state"] for job in jobs] == ["planning", "planning", "submitted"] and engine.running == 2
    await web.operator.post(f"/api/v1/jobs/{ids[0]}/cancel", json={"because": "wrong part"})
    jobs = await jobs_until(web, lambda items: items[2]["why"] == WHY)
    assert [job["state"] for job in jobs] == ["cancelled", "planning", "planning"] and engine.running == 2
    assert jobs[0]["why"] == "wrong part"
    engine.come.set()
    jobs = await jobs_until(web, lambda items: {job["state"] for job in items[1:]} == {"failed"})
    assert [job["why"] for job in jobs[1:]] == ["", ""] and engine.running == 0


@pytest.fixture
async def pooled(tmp_path: Path, store: Store) -> AsyncIterator[Web]:
    """A service with a pool whose scheduler is away."""
    (tmp_path / "run").mkdir()
    with store.write() as rows:
        secrets = {role: tokens.create(rows, f"the {role.value}", role, store.clock())[1] for role in Role}
    wire = PoolWire(f"tcp://127.0.0.1:{free_port()}")
    service = build_service(Settings(tmp_path / "store", tmp_path / "run", find_facts("cells", "trunnion_tcp"), pool=wire))
    app = make_app(service, "127.0.0.1")
    async with app.router.lifespan_context(app):
        made = Web(app, service, secrets, {})
        yield made
        for client in made.clients.values():
            await client.aclose()


async def test_service_whose_scheduler_is_away_inspects_parts_itself_and_keeps_jobs_waiting(pooled: Any, block: Path) -> None:
    answer = await pooled.operator.post("/api/v1/parts", files={"file": ("block.stl", block.read_bytes())})
    assert answer.status_code in (200, 201)
    await pooled.operator.post("/api/v1/jobs", json={"part_id": answer.json()["id"], "recipe": {}})
    jobs = await jobs_until(pooled, lambda items: "cannot be reached" in items[0]["why"])
    assert jobs[0]["state"] == "planning" and pooled.service.settings.pool.address in jobs[0]["why"]
    assert (await pooled.operator.post(f"/api/v1/jobs/{jobs[0]['id']}/cancel", json={})).json()["state"] == "cancelled"
