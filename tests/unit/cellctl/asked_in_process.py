"""The whole application in this process, with a part, a job and a simulated far end, asked from code that is not asynchronous."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import requests
import tomli_w
import trimesh
from fastapi import FastAPI

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Service, Settings
from cellctl.store import jobs, open_store, parts, tokens
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.tokens import Role
from config import find_facts
from planner.recipe import Recipe
from tests.unit.cellctl.far_cell import FarCell
from tests.unit.cellctl.idle_planner import plan_at_once
from tests.unit.cellctl.test_store import part_in

URL = "http://127.0.0.1:8000"
ANSWER_S = 60.0
FRESH_S = 0.2  # a cell shows itself more often than this


@dataclass
class InProcess:
    """The application, its loop and what is in its store. token : of an admin"""

    app: FastAPI
    service: Service
    runner: asyncio.Runner
    token: str
    part_id: str
    job_id: str
    far: FarCell | None

    def ask(self, request: requests.PreparedRequest) -> httpx.Response:
        """The answer to one request; of an event stream the begin."""
        return self.runner.run(asyncio.wait_for(self._ask(request), ANSWER_S))

    async def _ask(self, request: requests.PreparedRequest) -> httpx.Response:
        link = self.service.link
        if self.far is not None and (link.snapshot is None or link.age_s > FRESH_S):
            await self.far.show(lambda seq: link.snapshot is not None and link.snapshot.seq >= seq)
        body = request.body or b""
        sent = httpx.Request(str(request.method), str(request.url), headers=dict(request.headers), content=body)
        raw = [(name.lower(), value) for name, value in sent.headers.raw]
        scope = {
            "type": "http", "method": sent.method, "path": httpx.URL(str(request.url)).path, "raw_path": sent.url.raw_path.partition(b"?")[0],
            "query_string": sent.url.query, "headers": raw, "http_version": "1.1", "scheme": "http", "server": ("127.0.0.1", 8000),
            "client": ("127.0.0.1", 1), "root_path": "", "state": {},
        }  # fmt: skip
        content, start, over = bytearray(), {}, asyncio.Event()
        messages: list[dict[str, Any]] = [{"type": "http.request", "body": sent.content, "more_body": False}]

        async def receive() -> dict[str, Any]:
            if messages:
                return messages.pop()
            await over.wait()
            return {"type": "http.disconnect"}

        async def send(message: Any) -> None:
            if message["type"] == "http.response.start":
                start.update(message)
                return
            content.extend(message.get("body", b""))
            if content and (b"content-type", b"text/event-stream") in [(name, value.partition(b";")[0]) for name, value in start["headers"]]:
                over.set()

        answering = asyncio.ensure_future(self.app(scope, receive, send))
        await asyncio.wait([answering])
        if answering.exception() is None or not start:  # a fault that was answered by 500 is raised again for the server's log
            answering.result()
        over.set()
        answer = httpx.Response(start["status"], headers=start["headers"], content=bytes(content), request=sent)
        answer.elapsed = timedelta(0)
        return answer


@contextmanager
def in_process(
    folder: Path, empty_store: Path, is_joined: bool = True, prepare: Callable[[Service], None] = lambda service: None
) -> Iterator[InProcess]:
    """Serve until left. is_joined : a cell answers at the other end of the socket. No planner works: what is submitted stays so.

    prepare : called with the service before anything of it runs
    """
    shutil.copytree(empty_store, folder / "store")
    (folder / "run").mkdir()
    store = open_store(folder / "store")
    with store.write() as rows:
        token = tokens.create(rows, "the admin", Role.ADMIN, store.clock())[1]
    part_id = part_in(store)
    with store.read() as rows:
        part = parts.get(rows, part_id)
    mesh = bytes(trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl"))
    store.blobs.mesh(part.inspection.mesh_sha256).write_bytes(mesh)
    store.blobs.part(part.sha256, part.suffix).write_bytes(mesh)
    toml = tomli_w.dumps(Recipe(process="deposit").model_dump(mode="json", exclude_none=True))
    with store.write() as rows:
        job = jobs.add(rows, JobRow(new_id("job", store.clock()), "a job", part_id, "trunnion-tcp", toml, "316L", store.clock(), "me"))
    store.close()
    service = build_service(Settings(folder / "store", folder / "run", find_facts("cells", "trunnion_tcp"), upload_limit_bytes=2_000_000))
    plan_at_once(service, 0)
    prepare(service)
    app = make_app(service, "127.0.0.1")
    far = FarCell(folder / "store", service.store.clock)
    with asyncio.Runner() as runner:
        lifespan = app.router.lifespan_context(app)
        if is_joined:
            runner.run(far.open(folder / "run" / "cell.sock"))
        runner.run(lifespan.__aenter__())
        try:
            yield InProcess(app, service, runner, token, part_id, job.id, far if is_joined else None)
        finally:
            runner.run(lifespan.__aexit__(None, None, None))
            if is_joined:
                runner.run(far.close())
