"""The application at a port of loopback, in a thread of its own, for clients that are not asynchronous."""

from __future__ import annotations

import asyncio
import shutil
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import uvicorn

from cellctl.api import wire
from cellctl.api.app import build_service, make_app
from cellctl.api.context import Service, Settings
from cellctl.store import tokens
from cellctl.store.tokens import Role
from config import find_facts
from tests.unit.cellctl.idle_planner import plan_at_once

START_S = 60.0


@dataclass(frozen=True)
class AtPort:
    """Where it is served. token : of an engineer"""

    url: str
    token: str
    service: Service


@contextmanager
def at_port(folder: Path, empty_store: Path, behind_proxy: str = "") -> Iterator[AtPort]:
    """Serve until left, with the wires of the real process. No planner works: what is submitted stays so."""
    shutil.copytree(empty_store, folder / "store")
    (folder / "run").mkdir()
    service = build_service(Settings(folder / "store", folder / "run", find_facts("cells", "trunnion_tcp"), upload_limit_bytes=2_000_000))
    plan_at_once(service, 0)
    with service.store.write() as rows:
        token = tokens.create(rows, "an engineer", Role.ENGINEER, service.store.clock())[1]
    with socket.create_server(("127.0.0.1", 0)) as listening:
        config = uvicorn.Config(make_app(service, "127.0.0.1"), log_config=None, timeout_graceful_shutdown=1, **wire.options(behind_proxy))
        server = uvicorn.Server(config)
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([listening])), name="served", daemon=True)
        thread.start()
        end = time.monotonic() + START_S
        while not server.started:
            assert time.monotonic() < end and thread.is_alive(), "it did not start"
            threading.Event().wait(0.02)
        try:
            yield AtPort(f"http://127.0.0.1:{listening.getsockname()[1]}", token, service)
        finally:
            server.should_exit = True
            thread.join(START_S)
            assert not thread.is_alive()
