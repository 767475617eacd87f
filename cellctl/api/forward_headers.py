"""Which headers go on to another cell's host, and the words when it cannot be asked."""

from __future__ import annotations

from cellctl.api.neighbours import Host
from cellctl.api.problems import ApiError
from cellctl.domain.forwarded import HEADER

HOP_BY_HOP = frozenset(
    {
        b"connection", b"keep-alive", b"proxy-authenticate", b"proxy-authorization", b"proxy-connection", b"te", b"trailer",
        b"transfer-encoding", b"upgrade",
    }
)  # fmt: skip
"""Headers of one connection (RFC 9110 7.6.1); those that Connection names come to it."""
NOT_OURS = frozenset({b"host", b"expect", b"forwarded", b"via", HEADER.encode()})
ABOUT_PROXIES = (b"x-forwarded-", b"x-real-ip")
RETRY = {"Retry-After": "2"}


def end_to_end(headers: list[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
    """Headers without those that are of one connection, in small letters."""
    named = {
        word.strip().lower() for name, value in headers if name.lower() == b"connection" for word in value.split(b",")
    }
    return [(name.lower(), value) for name, value in headers if name.lower() not in HOP_BY_HOP and name.lower() not in named]


def too_many(host: Host) -> ApiError:
    """503 that names the cell."""
    return ApiError(503, "Busy", f"too many requests to {host.cell} are under way at this host", f"try again, or open {host.url} itself", RETRY)


def unreachable(host: Host, why: str, status: int = 502) -> ApiError:
    """502 or 504 that names the cell, its host, and what to do."""
    title = "The cell's host does not answer" if status == 504 else "The cell's host cannot be reached"
    hint = f"open {host.url} itself; look whether the service of {host.cell} runs; its STOP listener and the E-stop work in any case"
    return ApiError(status, title, f"{host.cell} at {host.url}: {why}", hint, RETRY)
