"""What the routes work with: one object, made when the web process starts."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from starlette.requests import HTTPConnection

from cellctl.api.acquaintance import Acquaintance
from cellctl.api.cell_link import CellLink
from cellctl.api.deeds import Deeds
from cellctl.api.feed import Feed
from cellctl.api.fleet_keeper import FleetKeeper
from cellctl.api.fleet_telling import SECRET
from cellctl.api.incoming import Receiving
from cellctl.api.metrics import Metrics
from cellctl.api.neighbours import Neighbours
from cellctl.api.page_hosts import PageHosts
from cellctl.api.presence import Presence
from cellctl.api.runs import Runs
from cellctl.api.security import own_names
from cellctl.api.stop_trail import StopTrail
from cellctl.api.turnstile import Turnstile
from cellctl.api.vouched import word_of
from cellctl.planning.pool.near import Pool
from cellctl.planning.pool.wire import PoolWire
from cellctl.planning.previews import Previews
from cellctl.planning.process import Workers
from cellctl.planning.queue import PlanningQueue
from cellctl.planning.standing_cell import StandingCell
from cellctl.record.keeping import Keeping
from cellctl.store import Store
from cellctl.tls import names_of
from config import Cell

UPLOAD_LIMIT_BYTES = 200 * 10**6
RESUMABLE_LIMIT_BYTES = 2**30  # of an upload that comes in pieces
WORKER_MEMORY_BYTES = 8 * 2**30


@dataclass(frozen=True)
class Settings:
    """Where the web process finds and keeps things, and its limits. pool : of planning machines; None: tasks are done on this machine

    stop_url : where pages reach the stop listener, if that is not on the page's own host; names : hosts that the service is called by
    host_url : where the other hosts of the fleet reach this web process
    """

    store: Path
    run: Path
    cell_file: Path
    stop_port: int | None = None
    upload_limit_bytes: int = UPLOAD_LIMIT_BYTES
    worker_memory_bytes: int = WORKER_MEMORY_BYTES
    planning_slots: int = 1
    tls_cert: Path | None = None
    stop_url: str = ""
    names: tuple[str, ...] = ()
    resumable_limit_bytes: int = RESUMABLE_LIMIT_BYTES
    host_url: str = ""
    pool: PoolWire | None = None


@dataclass(frozen=True)
class Service:
    """Everything that the routes use."""

    settings: Settings
    standing: StandingCell
    store: Store
    workers: Workers
    feed: Feed
    link: CellLink
    queue: PlanningQueue
    runs: Runs
    inspections: asyncio.Semaphore
    metrics: Metrics
    previews: Previews
    fleet: FleetKeeper
    page_hosts: PageHosts
    stops: StopTrail
    pool: Pool | None = None
    deeds: Deeds = field(default_factory=Deeds)
    keeping: Keeping = field(init=False)
    neighbours: Neighbours = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "keeping", Keeping(self.store, self.workers))
        object.__setattr__(self, "neighbours", Neighbours(self.standing.cell.name, self.store, SECRET))
    receiving: Receiving = field(default_factory=Receiving)
    presence: Presence = field(default_factory=Presence)
    turnstile: Turnstile = field(default_factory=Turnstile)
    acquaintance: Acquaintance = field(default_factory=Acquaintance)

    @property
    def cell(self) -> Cell:
        """The cell as it stands: its file with what was measured at the machine."""
        return self.standing.cell

    @property
    def stop_port(self) -> int:
        """Port on which the cell process listens for STOP."""
        return self.cell.service.stop_port if self.settings.stop_port is None else self.settings.stop_port

    @property
    def names(self) -> frozenset[str]:
        """Hosts that the service is called by: as told, as its certificate says, as the machine is called."""
        certified = names_of(self.settings.tls_cert) if self.settings.tls_cert is not None else frozenset()
        return own_names() | certified | {name.lower() for name in self.settings.names}

    @property
    def stop_scheme(self) -> str:
        """Of the stop listener, and of this service: a page that came by https may not post by http."""
        return "https" if self.settings.tls_cert is not None else "http"

    def stop_url(self, connection: HTTPConnection) -> str:
        """Where the cell that is asked for listens for STOP, as seen from the page's host; "" where another host alone knows that."""
        word = word_of(connection.scope)
        if word is not None:
            return word.stop_url
        other = self.neighbours.host_at(connection.scope["path"])
        if other is not None:
            return other.stop_url
        if self.settings.stop_url:
            return self.settings.stop_url
        name = connection.url.hostname or self.cell.service.host
        return f"{self.stop_scheme}://{f'[{name}]' if ':' in name else name}:{self.stop_port}/stop"


def service_of(connection: HTTPConnection) -> Service:
    """The service behind a request or a WebSocket; a FastAPI dependency."""
    return cast(Service, connection.app.state.service)
