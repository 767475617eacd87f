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
import msgspec
import tomli_w
import uvicorn
from sqlalchemy import URL

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Service, Settings
from cellctl.api.wire import PatientProtocol
from cellctl.cell.stop_listener import StopListener
from cellctl.domain.messages import Command, Reply
from cellctl.domain.snapshot import Snapshot
from cellctl.store import tokens, upgrade
from cellctl.store.fleet import Told
from cellctl.store.owner import owner_of
from cellctl.store.schema import fleet
from cellctl.store.shared import Wanted, share
from cellctl.store.tokens import Role
from config import find_facts
from tests.unit.cellctl.far_cell import FarCell
from tests.unit.cellctl.idle_planner import plan_at_once

START_S = 60.0
POLL_S = 0.02
SHOWN_S = 0.2
PERSON = "127.0.0.2"  # where people are, beside the hosts' own 127.0.0.1
Result = TypeVar("Result")


@dataclass
class Heard(FarCell):
    """A far end that keeps the commands that it was given, and tells its listener of pages. shown : what it tells of itself, None: nothing"""

    commands: list[Command] = field(default_factory=list)
    shown: Snapshot | None = None
    listener: StopListener | None = None

    async def answer(self, command: Command) -> Reply:
        self.commands.append(command)
        if command.verb == "pages" and self.listener is not None:
            self.listener.allow_pages(frozenset(command.args["hosts"]))
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

    def tell(self, cell: str, url: str | None = None, stop_url: str | None = None, certificate: str = "") -> None:
        """Write the cell's row as its service does, and let both hosts read it."""
        host = self.hosts[cell]
        at = {"host_url": host.url if url is None else url, "stop_url": host.stop_url if stop_url is None else stop_url}
        doing = {"job": "", "because": f"{cell} waits", "alarms": 0}
        owner, secret = owner_of(host.service.settings.store), host.service.neighbours.secret
        told = Told(cell, owner, secret, state="IDLE", doing=doing, certificate=certificate, **at)
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


async def _host(folder: Path, name: str, store: Path, beats: bool, ending: asyncio.Event) -> OneHost:
    """Start one host; it ends with the event."""
    run = folder / f"run-{name}"
    run.mkdir()
    stops: list[tuple[str, str]] = []

    async def stop(_ident: str, who: str, because: str) -> str:
        stops.append((who, because))
        return "STOPPED"

    listener = StopListener(stop, lambda: "IDLE", "127.0.0.1")
    stop_url = f"http://127.0.0.1:{await listener.start(0)}/stop"
    listening = socket.create_server(("127.0.0.1", 0))
    url = f"http://127.0.0.1:{listening.getsockname()[1]}"
    told = {"host_url": url, "stop_url": stop_url} if beats else {}
    service = build_service(Settings(store, run, _cell_file(folder, name), upload_limit_bytes=2_000_000, **told))  # type: ignore[arg-type]
    plan_at_once(service, 0)
    if not beats:
        service.fleet.run = asyncio.Event().wait  # type: ignore[method-assign, assignment]
    far = Heard(store, service.store.clock)
    far.listener = listener
    await far.open(run / "cell.sock")
    host = OneHost(name, url, service, far, listener, stops, stop_url)
    config = uvicorn.Config(
        make_app(service, "127.0.0.1"), log_config=None, timeout_graceful_shutdown=1, http=PatientProtocol, ws="websockets-sansio",
        server_header=False,
    )  # fmt: skip
    host.server = uvicorn.Server(config)
    host.server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
    serving = asyncio.create_task(host.server.serve([listening]))
    showing = asyncio.create_task(_shown(host))

    async def end() -> None:
        await ending.wait()
        assert host.server is not None
        host.server.should_exit = True
        await serving
        showing.cancel()
        await listener.close()
        await far.close()

    host.ended = asyncio.create_task(end())  # type: ignore[attr-defined]
    while not host.server.started:
        await asyncio.sleep(POLL_S)
    return host


def stores_in_one_file(folder: Path, empty_store: Path) -> dict[str, Path]:
    """The stores of two hosts that are one folder."""
    shutil.copytree(empty_store, folder / "store")
    return dict.fromkeys(("near", "far"), folder / "store")


def stores_on(database: URL, folder: Path) -> dict[str, Path]:
    """The stores of two hosts that share a database and a folder of files."""
    stores = {name: folder / f"store-{name}" for name in ("near", "far")}
    for store in stores.values():
        share(store, Wanted(database.render_as_string(hide_password=False), folder / "files"))
        upgrade(store)
    return stores


async def _shown(host: OneHost) -> None:
    """The cell tells of itself all the time, if it does."""
    while True:
        if host.far.shown is not None:
            host.far.seq += 1
            host.far.server.publish(msgspec.structs.replace(host.far.shown, seq=host.far.seq, at=host.service.store.clock()))
        await asyncio.sleep(SHOWN_S)


@contextmanager
def house_of_two(folder: Path, stores: dict[str, Path], beats: bool = False) -> Iterator[House]:
    """Both hosts until left. stores : folder of each host's store   beats : hosts tell the fleet of themselves, else tests do

    No planner works: what is submitted stays so.
    """
    loop, ending, ready = asyncio.new_event_loop(), asyncio.Event(), threading.Event()
    hosts: dict[str, OneHost] = {}

    async def serve() -> None:
        for name in ("near", "far"):
            hosts[name] = await _host(folder, name, stores[name], beats, ending)
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
    for name in hosts if not beats else ():
        house.tell(name)
    for host in hosts.values():  # what each does once, before anything is measured
        httpx.get(f"{host.url}/openapi.json", timeout=START_S)
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
