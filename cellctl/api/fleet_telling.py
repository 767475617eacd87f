"""What this service tells the fleet of its cell: where it is reached, what it offers, and what it does."""

from __future__ import annotations

import secrets
import socket
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import msgspec
from cryptography.hazmat.primitives.serialization import Encoding

from cellctl.api.cell_link import CellLink
from cellctl.domain.snapshot import Snapshot
from cellctl.planning.needs import facts_of
from cellctl.planning.standing_cell import StandingCell
from cellctl.store.fleet import Seat, Told
from cellctl.tls import certificate
from config import Cell

if TYPE_CHECKING:
    from cellctl.api.context import Settings

SECRET = secrets.token_hex(32)
"""Of this process: by it the other hosts know what it forwards."""
EVERYWHERE = frozenset({"0.0.0.0", "::", ""})
_facts: dict[str, tuple[Cell, dict[str, Any]]] = {}


def host_url_of(scheme: str, host: str, port: int, names: tuple[str, ...]) -> str:
    """Where other hosts reach a web process that listens at host and port.  names : by which it is called"""
    name = host if host not in EVERYWHERE else (names[0] if names else socket.gethostname())
    return f"{scheme}://{f'[{name}]' if ':' in name else name}:{port}"


def told_of(settings: Settings, standing: StandingCell, link: CellLink, seat: Seat) -> Told:
    """All of it, as things stand. Raises ConfigError for a device map that cannot be read."""
    from cellctl.planning.keys import software_version

    cell, snapshot = standing.cell, link.fresh
    if seat.cell not in _facts or _facts[seat.cell][0] is not cell:  # read from files: once for each measurement
        _facts[seat.cell] = (cell, msgspec.to_builtins(facts_of(cell)))
    return Told(
        cell=seat.cell,
        owner=seat.owner,
        secret=SECRET,
        host_url=settings.host_url,
        stop_url=settings.stop_url or _stop_url(settings, cell),
        certificate=_certificate(settings.tls_cert),
        software=software_version()[:40],
        cell_sha256=cell.sha256,
        facts=_facts[seat.cell][1],
        state=snapshot.state if snapshot is not None else "",
        doing=doing_of(snapshot) if snapshot is not None else {},
    )


@lru_cache(maxsize=4)
def _certificate(cert: Path | None) -> str:
    """The first certificate of a file: the service's own, as it was when the process started to listen with it. Raises TlsError."""
    return certificate(cert).public_bytes(Encoding.PEM).decode("ascii") if cert is not None else ""


def _stop_url(settings: Settings, cell: Cell) -> str:
    if not settings.host_url:
        return ""
    parts = urlsplit(settings.host_url)
    name = parts.hostname or ""
    port = cell.service.stop_port if settings.stop_port is None else settings.stop_port
    return f"{parts.scheme}://{f'[{name}]' if ':' in name else name}:{port}/stop"


def doing_of(snapshot: Snapshot) -> dict[str, Any]:
    """The little that all consoles show of a cell."""
    job = snapshot.job
    return {
        "job": job.id if job else "",
        "name": job.name if job else "",
        "because": snapshot.because or snapshot.waiting,
        "remaining_s": job.remaining_s if job else 0.0,
        "progress": job.progress if job else 0.0,
        "alarms": len(snapshot.alarms),
    }
