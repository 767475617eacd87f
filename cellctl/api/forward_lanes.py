"""Connections to the other hosts: a pool for each, and another for STOP, that keep no cookies, follow nothing and wait for nobody long."""

from __future__ import annotations

import asyncio
import ssl
from functools import cache

import httpx

from cellctl.api.neighbours import Host

CONNECT_S = 5.0
WRITE_S = 30.0  # for a piece of a request that the cell's host does not take
READ_S = 60.0  # between two pieces of an answer; live streams say something every few seconds
POOL_S = 1.0
KEPT_S = 2.0  # an idle connection; a web process of this software closes one after 5 s
KEPT = 8
AT_ONCE = 120
STOPS_AT_ONCE = 40
TIMES = {"connect": CONNECT_S, "read": READ_S, "write": WRITE_S, "pool": POOL_S}


class Lanes:
    """Call `close` at the end."""

    def __init__(self) -> None:
        self._pools: dict[tuple[Host, bool], httpx.AsyncHTTPTransport] = {}

    def pool(self, host: Host, is_stop: bool = False) -> httpx.AsyncHTTPTransport:
        """Connections to this host."""
        key = (host, is_stop)
        if key not in self._pools:
            most = STOPS_AT_ONCE if is_stop else AT_ONCE
            limits = httpx.Limits(max_connections=most, max_keepalive_connections=KEPT, keepalive_expiry=KEPT_S)
            self._pools[key] = httpx.AsyncHTTPTransport(verify=self.tls_of(host), trust_env=False, limits=limits)
        return self._pools[key]

    @staticmethod
    def tls_of(host: Host) -> ssl.SSLContext:
        """Whom to believe: the very certificate that the host told the fleet, else the system's authorities."""
        if not host.certificate:
            return _of_system()
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
        try:
            context.load_verify_locations(cadata=host.certificate)
        except ssl.SSLError:
            return _of_system()
        return context

    async def close(self) -> None:
        """Close every connection."""
        pools, self._pools = list(self._pools.values()), {}
        await asyncio.gather(*(pool.aclose() for pool in pools), return_exceptions=True)


@cache
def _of_system() -> ssl.SSLContext:
    return ssl.create_default_context()
