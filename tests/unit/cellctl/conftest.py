"""A store of one's own, and the web application in this process with a client per role; no cell process is at its other end."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import trimesh
from fastapi import FastAPI
from sqlalchemy import Engine, event

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Service, Settings
from cellctl.store import Store, open_store, tokens, upgrade
from cellctl.store.sides import check_side
from cellctl.store.tokens import Role
from config import find_facts

event.listen(Engine, "before_cursor_execute", check_side)  # as in a store that is shared: what one file forgives fails here
URL = "http://127.0.0.1:8000"
UPLOAD_LIMIT = 2_000_000


@dataclass
class Web:
    """The application, what is behind it, and clients that are signed in."""

    app: FastAPI
    service: Service
    secrets: dict[Role, str]
    clients: dict[str, httpx.AsyncClient]

    def client(self, role: Role | None) -> httpx.AsyncClient:
        name = role.value if role else ""
        if name not in self.clients:
            headers = {"Authorization": f"Bearer {self.secrets[role]}"} if role else {}
            transport = httpx.ASGITransport(self.app, raise_app_exceptions=False)
            self.clients[name] = httpx.AsyncClient(transport=transport, base_url=URL, headers=headers)
        return self.clients[name]

    @property
    def nobody(self) -> httpx.AsyncClient:
        return self.client(None)

    @property
    def viewer(self) -> httpx.AsyncClient:
        return self.client(Role.VIEWER)

    @property
    def operator(self) -> httpx.AsyncClient:
        return self.client(Role.OPERATOR)

    @property
    def engineer(self) -> httpx.AsyncClient:
        return self.client(Role.ENGINEER)

    @property
    def admin(self) -> httpx.AsyncClient:
        return self.client(Role.ADMIN)


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store as it is after its first start; tests copy it."""
    folder = tmp_path_factory.mktemp("store") / "store"
    upgrade(folder)
    return folder


@asynccontextmanager
async def serving(store: Store, folder: Path) -> AsyncIterator[Web]:
    """The application over a store that is open; its run directory is made in the folder."""
    (folder / "run").mkdir()
    with store.write() as rows:
        secrets = {role: tokens.create(rows, f"the {role.value}", role, store.clock())[1] for role in Role}
    settings = Settings(store.folder, folder / "run", find_facts("cells", "trunnion_tcp"), upload_limit_bytes=UPLOAD_LIMIT)
    service = build_service(settings)
    app = make_app(service, "127.0.0.1")
    async with app.router.lifespan_context(app):
        made = Web(app, service, secrets, {})
        yield made
        for client in made.clients.values():
            await client.aclose()


@pytest.fixture(scope="session")
def stocked(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> tuple[Path, dict[str, Any]]:
    """A store to which a block of 12 × 8 × 2 mm was uploaded, and what the upload was answered; tests copy it."""
    folder = tmp_path_factory.mktemp("stocked")
    shutil.copytree(empty_store, folder / "store")

    async def upload() -> dict[str, Any]:
        opened = open_store(folder / "store")
        try:
            async with serving(opened, folder) as web:
                data = trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl")
                answer = await web.operator.post("/api/v1/parts", files={"file": ("block.stl", data)}, timeout=60)
                assert answer.status_code == 201, answer.text
                return dict(answer.json())
        finally:
            opened.close()

    with ThreadPoolExecutor(1) as aside:  # this thread's event loop is the tests'
        part = aside.submit(asyncio.run, upload()).result()
    return folder / "store", part


@pytest.fixture
def uploaded(stocked: tuple[Path, dict[str, Any]]) -> dict[str, Any]:
    """A block of 12 × 8 × 2 mm that is in the store: what its upload was answered."""
    return stocked[1]


@pytest.fixture
def store(request: pytest.FixtureRequest, tmp_path: Path, empty_store: Path) -> Iterator[Store]:
    origin = request.getfixturevalue("stocked")[0] if "uploaded" in request.fixturenames else empty_store
    shutil.copytree(origin, tmp_path / "store")
    opened = open_store(tmp_path / "store")
    yield opened
    opened.close()


@pytest.fixture
async def web(tmp_path: Path, store: Store) -> AsyncIterator[Web]:
    async with serving(store, tmp_path) as made:
        yield made


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A block of 12 × 8 × 2 mm."""
    path = tmp_path / "block.stl"
    trimesh.creation.box((12.0, 8.0, 2.0)).export(path)
    return path
