"""The web process's end of a connection: a client that is slow or many keeps nobody else out."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S = 10.0  # for the whole head of a request
PER_ADDRESS = 200  # connections at once from one address; a console has about eight
MESSAGE_BYTES = 64 * 1024  # of a WebSocket's
AT_ONCE = 800  # below the limit of open files of an ordinary process


def options(behind_proxy: str = "") -> dict[str, Any]:
    """What uvicorn is told about connections. behind_proxy : address of a proxy whose X-Forwarded-For and -Proto are believed, of no other's"""
    PatientProtocol.shared = frozenset({behind_proxy} - {""})
    return {
        "http": PatientProtocol, "ws": "websockets-sansio", "ws_max_size": MESSAGE_BYTES, "server_header": False, "access_log": False,
        "proxy_headers": bool(behind_proxy), "forwarded_allow_ips": behind_proxy or None,
    }  # fmt: skip


class PatientProtocol(H11Protocol):
    """Closes a connection whose request's head does not come in time, and the newest of too many.

    shared : addresses of proxies, from each of which many people come
    """

    open: ClassVar[Counter[str]] = Counter()
    shared: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._head_late: asyncio.TimerHandle | None = None
        self._address = ""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A client came: it is counted, and its head waited for."""
        super().connection_made(transport)
        peer = transport.get_extra_info("peername")
        self._address = str(peer[0]) if peer else ""
        self.open[self._address] += 1
        if (self.open[self._address] > PER_ADDRESS and self._address not in self.shared) or self.open.total() > AT_ONCE:
            transport.abort()
            return
        self._await_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """A client left."""
        self._head_came()
        self.open[self._address] -= 1
        if self.open[self._address] <= 0:
            del self.open[self._address]
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Bytes came: the first ones of a further request start its time."""
        if self.conn.their_state is h11.IDLE and self._head_late is None:
            self._await_head()
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._head_came()

    def _await_head(self) -> None:
        self._head_late = self.loop.call_later(HEAD_S, self._give_up)

    def _head_came(self) -> None:
        if self._head_late is not None:
            self._head_late.cancel()
            self._head_late = None

    def _give_up(self) -> None:
        self._head_late = None
        if self.conn.their_state is h11.IDLE and not self.transport.is_closing():
            self.transport.abort()
