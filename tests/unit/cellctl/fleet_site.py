"""Three services on one store in this process, each with a far cell at its socket: they are killed and come back as hosts do.

What planning makes is there already, as of a part that was made before: no worker is started.
"""

from __future__ import annotations

import asyncio
import json
import tomllib
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import tomli_w
from sqlalchemy import update

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Service, Settings
from cellctl.planning import keys
from cellctl.store import Store, made, parts
from cellctl.store.fleet import members, now_of
from cellctl.store.made import Made
from cellctl.store.schema import fleet
from config import Cell, find_facts, load_cell
from planner.recipe import Recipe
from tests.unit.cellctl.far_cell import FarCell

RECIPE = {"process": "deposit", "build_direction": [0.0, 0.0, 1.0]}
PATIENCE_S = 120.0  # of a machine that runs other tests beside
LOOK_S = 0.05


@dataclass
class Site:
    """One host. store : its store folder; token : an admin's"""

    name: str
    store: Path
    run: Path
    token: str
    service: Service | None = None
    tasks: list[asyncio.Task[Any]] = field(default_factory=list)
    client: httpx.AsyncClient | None = None
    far: FarCell | None = None

    @property
    def cell_file(self) -> Path:
        return self.run / "cell.toml"

    def make_cell(self) -> Cell:
        """The shipped cell under the host's name."""
        self.run.mkdir()
        facts = tomllib.loads(find_facts("cells", "trunnion_tcp").read_text())
        del facts["machine"]
        self.cell_file.write_text(tomli_w.dumps({**facts, "name": self.name}))
        return load_cell(self.cell_file)

    async def power_up(self) -> None:
        """The cell process, which no death of a service disturbs."""
        self.far = FarCell(self.store, self._unix)
        await self.far.open(self.run / "cell.sock")

    def _unix(self) -> float:
        import time

        return time.time()

    async def serve(self) -> None:
        """Start the service. Raises LeaseHeldError."""
        self.service = service = await asyncio.to_thread(build_service, Settings(self.store, self.run, self.cell_file))
        transport = httpx.ASGITransport(make_app(service, "127.0.0.1"), raise_app_exceptions=False)
        headers = {"Authorization": f"Bearer {self.token}", "X-Client-Id": self.name}
        self.client = httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000", headers=headers)
        for work in (service.link.run(), service.queue.run(), service.runs.run(), service.fleet.run(), self._shown()):
            self._begin(work)

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        self.tasks.append(asyncio.create_task(work))

    async def _shown(self) -> None:
        """The cell tells of itself all the time."""
        assert self.far is not None and self.service is not None
        link = self.service.link
        while True:
            await self.far.show(lambda seq: not link.is_connected or (link.snapshot is not None and link.snapshot.seq >= seq))
            await asyncio.sleep(LOOK_S)

    async def kill(self) -> None:
        """As kill -9 leaves it: nothing is given back."""
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        self.tasks.clear()
        if self.service is not None:
            assert self.client is not None
            await self.client.aclose()
            await self.service.previews.close()
            await self.service.deeds.close()
            self.service.turnstile.close()
            await asyncio.to_thread(self.service.store.close)
            self.service = self.client = None

    async def get(self, path: str) -> Any:
        assert self.client is not None
        answer = await self.client.get(f"/api/v1{path}")
        assert answer.status_code == 200, answer.text
        return answer.json()

    async def post(self, path: str, body: dict[str, Any], status: int = 200) -> Any:
        assert self.client is not None
        answer = await self.client.post(f"/api/v1{path}", json=body)
        assert answer.status_code == status, answer.text
        return answer.json()

    async def until(self, job: str, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The job, once something holds of it."""
        shown: dict[str, Any] = {}
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not holds(shown := await self.get(f"/jobs/{job}")):
                    await asyncio.sleep(LOOK_S)
        except TimeoutError:
            life = [f"{step['state']}: {step['why']}" for step in (await self.get(f"/jobs/{job}/life"))["items"]]
            raise AssertionError(f"{shown['state']} at {shown['cell']!r}, {shown['why']}; {life}") from None
        return shown


async def all_answer(store: Store, names: Sequence[str]) -> None:
    """Return once every cell was heard to answer: jobs are given to those first."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with store.read() as rows:
                told = members(rows, now_of(rows, store.clock))
            if {one.cell for one in told if one.state} >= set(names):
                return
            await asyncio.sleep(LOOK_S)


def make_before(store: Store, part_id: str, cells: list[Cell]) -> None:
    """Plan, programs and proofs of a part, as if each of the cells had been asked for it before."""
    recipe = tomli_w.dumps(Recipe.model_validate(RECIPE).model_dump(mode="json", exclude_none=True))
    with store.write() as rows:
        part = parts.get(rows, part_id)
        plan = Made("1" * 64, {"layers": 2})
        store.blobs.plan(plan.sha256).write_bytes(b"plan")
        made.add(rows, "plan", keys.plan_key(part.sha256, part.units, part.name, recipe, ""), plan, 1.0)
        for number, cell in enumerate(cells):
            program = Made(f"{number}a" * 32, {"lines": 10, "duration_s": 60.0})
            store.blobs.program(program.sha256).mkdir(parents=True)
            made.add(rows, "program", keys.program_key(plan.sha256, cell), program, 1.0)
            proof = Made(f"{number}b" * 32, {"passed": True})
            store.blobs.proof(proof.sha256).write_text(json.dumps({"passed": True}))
            made.add(rows, "proof", keys.proof_key(program.sha256, part.sha256, part.units, cell), proof, 1.0)


def grow_silent(store: Store, cell: str, s: float) -> None:
    """So much time goes by for one cell, of which nothing is heard."""
    with store.write() as rows:
        rows.execute(update(fleet).where(fleet.c.cell == cell).values(heard_at=fleet.c.heard_at - s))
