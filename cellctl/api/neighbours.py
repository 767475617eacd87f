"""The hosts of the other cells as this web process knows them: what may be forwarded to, whose word counts, and nothing else."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import urlsplit

import structlog
from sqlalchemy.exc import DBAPIError

from cellctl.domain import cell_path
from cellctl.domain.fleet import HEARTBEAT_S
from cellctl.store import Store, fleet
from cellctl.store.fleet import Member

AGAIN_S = 1.0  # between two readings because of a word that fits no secret: a stranger's headers cost the store no more than that
SECRET_BYTES = 32
FORGOTTEN_S = 86_400.0
log = structlog.get_logger(__name__)


class HostUrlError(ValueError):
    """An address that a host cannot have. The message is one line."""


@dataclass(frozen=True)
class Host:
    """Where a cell's web process and its STOP listener are.

    url : scheme, host and port   stop_url : whole, "" if none is known   certificate : PEM, of both, "" where the system's authorities say
    """

    cell: str
    url: str
    stop_url: str = ""
    certificate: str = ""


def host_of(member: Member) -> Host:
    """Where a member is. Raises HostUrlError for what is no plain address of a web server, or of a STOP listener."""
    _check(member.cell, member.host_url, ("", "/"))
    if member.stop_url:
        _check(member.cell, member.stop_url, ("/stop",))
    return Host(member.cell, member.host_url.rstrip("/"), member.stop_url, member.certificate)


def _check(cell: str, url: str, paths: tuple[str, ...]) -> None:
    """Raises HostUrlError."""
    try:
        parts = urlsplit(url)
        is_plain = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.path in paths and parts.port != 0
        is_plain = is_plain and not (parts.query or parts.fragment or parts.username or parts.password)
    except ValueError:
        is_plain = False
    if not is_plain or not url.isascii() or any(char.isspace() or char in ";,'\"" for char in url):
        raise HostUrlError(f"the host of {cell} tells no usable address: {url[:80]!r}")


class Neighbours:
    """Call `run` as one task. here : this host's own cell; secret : what this host signs with, and tells in its row of the fleet

    offset_s : the clock of the house less this machine's, s; members : all cells of the house, this one too
    """

    def __init__(self, here: str, store: Store, secret: str) -> None:
        self.here = here
        self.secret = secret
        self.members: tuple[Member, ...] = ()
        self.offset_s = 0.0
        self.hosts: dict[str, Host] = {}
        self._secrets: dict[str, bytes] = {}
        self._store = store
        self._read_at = float("-inf")
        self._reading = asyncio.Lock()
        self._warned: set[str] = set()

    @property
    def is_shared(self) -> bool:
        """Whether other cells share this store."""
        return any(member.cell != self.here for member in self.members)

    def host_at(self, path: str) -> Host | None:
        """The host of the other cell whose page or interface a path at this host is."""
        return self.hosts.get(cell_path.cell_of(path)) if path.startswith(cell_path.PREFIX) else None

    def secret_of(self, cell: str) -> bytes | None:
        """What the host of a cell signs with."""
        return bytes.fromhex(self.secret) if cell == self.here else self._secrets.get(cell)

    def take(self, members: Iterable[Member]) -> None:
        """The fleet as it is; a row without a usable address, or without a secret, is passed over and logged once."""
        self.members = tuple(members)
        others = [member for member in self.members if member.cell != self.here]
        self._secrets = {member.cell: bytes.fromhex(member.secret) for member in others if _is_secret(member.secret)}
        hosts: dict[str, Host] = {}
        for member in others:
            try:
                hosts[member.cell] = host_of(member)
            except HostUrlError as error:
                if member.host_url not in self._warned:
                    self._warned.add(member.host_url)
                    log.warning("a cell cannot be reached from here", error=str(error))
        self.hosts = hosts

    async def read(self) -> None:
        """Read the fleet. A store that does not answer leaves it as it was."""
        async with self._reading:
            self._read_at = time.monotonic()
            try:
                members, self.offset_s = await asyncio.to_thread(_read, self._store)
            except (DBAPIError, OSError) as error:
                log.warning("the fleet cannot be read", error=str(getattr(error, "orig", error)))
                return
            self.take(members)

    async def read_again(self) -> None:
        """Read the fleet once more because of something unknown, unless that was done a moment ago."""
        if time.monotonic() - self._read_at > AGAIN_S:
            await self.read()

    async def run(self) -> None:
        """Read the fleet, for ever."""
        while True:
            await self.read()
            await asyncio.sleep(HEARTBEAT_S)


def _is_secret(text: str) -> bool:
    try:
        return len(bytes.fromhex(text)) >= SECRET_BYTES
    except ValueError:
        return False


def _read(store: Store) -> tuple[list[Member], float]:
    with store.read() as rows:
        now = fleet.now_of(rows, store.clock)
        is_own = rows.dialect.name == "sqlite"
        return [one for one in fleet.members(rows, now) if not is_own or is_kept(one)], now - store.clock()


def is_kept(member: Member) -> bool:
    """Whether a cell of a store of one host is still one: not one that the host served under another name before."""
    return bool(member.owner) and member.age_s < FORGOTTEN_S
