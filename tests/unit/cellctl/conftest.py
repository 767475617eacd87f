"""A store of one's own, and the web application in this process with a client per role; no cell process is at its other end."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path

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


@pytest.fixture
def store(tmp_path: Path, empty_store: Path) -> Iterator[Store]:
    shutil.copytree(empty_store, tmp_path / "store")
    opened = open_store(tmp_path / "store")
    yield opened
    opened.close()


@pytest.fixture
async def web(tmp_path: Path, store: Store) -> AsyncIterator[Web]:
    (tmp_path / "run").mkdir()
    with store.write() as rows:
        secrets = {role: tokens.create(rows, f"the {role.value}", role, store.clock())[1] for role in Role}
    settings = Settings(
        tmp_path / "store", tmp_path / "run", find_facts("cells", "trunnion_tcp"), upload_limit_bytes=UPLOAD_LIMIT
    )
    service = build_service(settings)
    app = make_app(service, "127.0.0.1")
    async with app.router.lifespan_context(app):
        made = Web(app, service, secrets, {})
        yield made
        for client in made.clients.values():
            await client.aclose()


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A block of 12 × 8 × 2 mm."""
    path = tmp_path / "block.stl"
    trimesh.creation.box((12.0, 8.0, 2.0)).export(path)
    return path
