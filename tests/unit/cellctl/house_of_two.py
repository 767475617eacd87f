"""Two web processes on one store at two ports of loopback, each with its own cell, and what tests do to them; no cell process but a far end."""

from __future__ import annotations

import asyncio
import secrets
import shutil
import socket
import threading
import time
import tomllib
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import httpx
import tomli_w
import uvicorn

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Service, Settings
from cellctl.api.wire import PatientProtocol
from cellctl.cell.stop_listener import StopListener
from cellctl.domain.messages import Command, Reply
from cellctl.store import tokens
from cellctl.store.fleet import Told
from cellctl.store.owner import owner_of
from cellctl.store.schema import fleet
from cellctl.store.tokens import Role
from config import find_facts
from tests.unit.cellctl.far_cell import FarCell

START_S = 60.0
POLL_S = 0.02
PERSON = "127.0.0.2"  # where people are, beside the hosts' own 127.0.0.1
Result = TypeVar("Result")


@dataclass
class Heard(FarCell):
    """A far end that keeps the commands that it was given."""

    commands: list[Command] = field(default_factory=list)

    async def answer(self, command: Command) -> Reply:
        self.commands.append(command)
        return await super().answer(command)


@dataclass
class OneHost:
    """A cell's host. stops : (who, because) of each STOP that its listener took"""

    cell: str
    url: str
    service: Service
    far: Heard
    listener: StopListener
    stops: list[tuple[str, str]]
    stop_url: str = ""
    server: uvicorn.Server | None = None


@dataclass
class House:
    """Hosts "near" and "far", people's tokens, and the loop that both run in."""

    hosts: dict[str, OneHost]
    loop: asyncio.AbstractEventLoop
    tokens: dict[Role, str]
    clients: list[httpx.Client] = field(default_factory=list)

    @property
    def near(self) -> OneHost:
        return self.hosts["near"]

    @property
    def far(self) -> OneHost:
        return self.hosts["far"]

    def run(self, work: Coroutine[Any, Any, Result]) -> Result:
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(START_S)

    def tell(self, cell: str, url: str | None = None, stop_url: str | None = None) -> None:
        """Write the cell's row as its service does, and let both hosts read it."""
        host = self.hosts[cell]
        at = {"host_url": host.url if url is None else url, "stop_url": host.stop_url if stop_url is None else stop_url}
        doing = {"job": "", "because": f"{cell} waits", "alarms": 0}
        told = Told(cell, owner_of(host.service.settings.store), secret=host.service.neighbours.secret, state="IDLE", doing=doing, **at)
        host.service.fleet._told = lambda: told
        host.service.fleet.take()
        for one in self.hosts.values():
            self.run(one.service.neighbours.read())

    def age(self, cell: str, seconds: float) -> None:
        """The cell was heard so long ago."""
        with self.hosts[cell].service.store.write() as rows:
            rows.execute(fleet.update().where(fleet.c.cell == cell).values(heard_at=self.hosts[cell].service.store.clock() - seconds))

    def person(self, role: Role | None = Role.OPERATOR, at: str = "near", address: str = PERSON, **headers: str) -> httpx.Client:
        """A person with a token, who comes from this address."""
        sent = {"Authorization": f"Bearer {self.tokens[role]}"} if role else {}
        wire = httpx.HTTPTransport(local_address=address)
        client = httpx.Client(base_url=self.hosts[at].url, headers={**sent, **headers}, transport=wire, timeout=START_S)
        self.clients.append(client)
        return client

    def audited(self) -> list[dict[str, Any]]:
        """The audit trail, newest first."""
        with self.person(Role.ADMIN) as admin:
            return list(admin.get("/api/v1/audit").json()["items"])

    def until(self, is_so: Callable[[], bool]) -> None:
        end = time.monotonic() + START_S
        while not is_so():
            assert time.monotonic() < end
            time.sleep(POLL_S)


def _cell_file(folder: Path, name: str) -> Path:
    facts = tomllib.loads(find_facts("cells", "trunnion_tcp").read_text(encoding="utf-8"))
    path = folder / f"{name}.toml"
    path.write_text(tomli_w.dumps({**facts, "name": name}), encoding="utf-8")
    return path


async def _host(folder: Path, name: str, ending: asyncio.Event) -> OneHost:
    """Start one host; it ends with the event."""
    run = folder / f"run-{name}"
    run.mkdir()
    settings = Settings(folder / "store", run, _cell_file(folder, name), upload_limit_bytes=2_000_000)
    service = build_service(settings)
    service.queue._slots = 0
    service.fleet.run = asyncio.Event().wait  # type: ignore[method-assign, assignment]  # rows are written by the tests alone
    far = Heard(folder / "store", service.store.clock)
    await far.open(run / "cell.sock")
    stops: list[tuple[str, str]] = []

    async def stop(_ident: str, who: str, because: str) -> str:
        stops.append((who, because))
        return "STOPPED"

    listener = StopListener(stop, lambda: "IDLE", "127.0.0.1")
    listening = socket.create_server(("127.0.0.1", 0))
    host = OneHost(name, f"http://127.0.0.1:{listening.getsockname()[1]}", service, far, listener, stops)
    host.stop_url = f"http://127.0.0.1:{await listener.start(0)}/stop"
    config = uvicorn.Config(
        make_app(service, "127.0.0.1"), log_config=None, timeout_graceful_shutdown=1, http=PatientProtocol, ws="websockets-sansio",
        server_header=False,
    )  # fmt: skip
    host.server = uvicorn.Server(config)
    host.server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
    serving = asyncio.create_task(host.server.serve([listening]))

    async def end() -> None:
        await ending.wait()
        assert host.server is not None
        host.server.should_exit = True
        await serving
        await listener.close()
        await far.close()

    host.ended = asyncio.create_task(end())  # type: ignore[attr-defined]
    while not host.server.started:
        await asyncio.sleep(POLL_S)
    return host


@contextmanager
def house_of_two(folder: Path, empty_store: Path) -> Iterator[House]:
    """Both hosts until left. No planner works: what is submitted stays so."""
    shutil.copytree(empty_store, folder / "store")
    loop, ending, ready = asyncio.new_event_loop(), asyncio.Event(), threading.Event()
    hosts: dict[str, OneHost] = {}

    async def serve() -> None:
        for name in ("near", "far"):
            hosts[name] = await _host(folder, name, ending)
        ready.set()
        await asyncio.gather(*(host.ended for host in hosts.values()))  # type: ignore[attr-defined]

    def work() -> None:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.run(serve())

    thread = threading.Thread(target=work, name="house", daemon=True)
    thread.start()
    assert ready.wait(START_S)
    store = hosts["near"].service.store
    with store.write() as rows:
        found = {role: tokens.create(rows, f"the {role.value}", role, store.clock())[1] for role in Role}
    house = House(hosts, loop, found)
    for name in hosts:
        house.tell(name)
    try:
        yield house
    finally:
        for client in house.clients:
            client.close()
        loop.call_soon_threadsafe(ending.set)
        thread.join(START_S)
        assert not thread.is_alive()


def once() -> str:
    return secrets.token_hex(8)
