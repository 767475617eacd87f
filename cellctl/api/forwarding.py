"""`/cells/NAME/…`: the interface of another cell at this address, passed on to its host as it is read from the fleet, and to nothing else.

What is passed on: requests under /api/v1/ with their streams, server-sent events and the live WebSocket. What is not: paths that are
anything else, headers of one connection, redirects. The host of the cell lets in, counts and writes down as if the person had come to
it: this one vouches for address, host and scheme (`domain.forwarded`). How many, how large and how long is bounded here, for each
cell by itself, so that one that answers nobody keeps nobody from the others; STOP has a lane of its own.
"""

from __future__ import annotations

import secrets
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from cellctl.api import forward_http, forward_live
from cellctl.api.forward_headers import ABOUT_PROXIES, NOT_OURS, end_to_end, too_many
from cellctl.api.forward_lanes import Lanes
from cellctl.api.forward_stop import Round
from cellctl.api.neighbours import Host, Neighbours
from cellctl.api.problems import ApiError, Problem, response
from cellctl.api.vouched import STOP_PATH, word_of
from cellctl.domain import cell_path, forwarded
from cellctl.domain.cell_path import CellPath, CellPathError
from cellctl.domain.forwarded import HEADER, Word

PER_ADDRESS = 32  # requests of one address under way to one cell; a console has about eight
AT_ONCE = 120  # to one cell: below what its host takes from one address


class Forwarding:
    """ASGI application under /cells/. own : this host's application; page : the console's page with a STOP address in it

    clock : Unix s, of this machine
    """

    def __init__(
        self,
        own: ASGIApp,
        neighbours: Neighbours,
        clock: Callable[[], float],
        page: Callable[[str], Response],
        stops: Round,
    ) -> None:
        self._own = own
        self._neighbours = neighbours
        self._clock = clock
        self._page = page
        self._stops = stops
        self.lanes = Lanes()
        self._under_way: Counter[tuple[str, str]] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, or say why not. Raises ApiError for an HTTP request."""
        scope["route"] = self
        try:
            await self._pass_on(scope, receive, send)
        except ApiError as error:
            if scope["type"] == "http":
                raise
            problem = Problem(title=error.title, status=error.status, detail=error.detail, hint=error.hint, instance=scope["path"])
            await response(problem, error.headers)(scope, receive, send)

    path = "/cells/{name}"
    """Under which its requests are counted."""

    async def _pass_on(self, scope: Scope, receive: Receive, send: Send) -> None:
        if word_of(scope) is not None:
            raise ApiError(508, "Loop", "this request was passed on already", "ask the host of the cell itself, or the one whose page it is")
        asked, target = _asked(scope)
        if not asked.rest.startswith("/api/"):
            await self._send_page(asked, scope, receive, send)
            return
        if asked.cell == self._neighbours.here:
            at_home = {"path": cell_path.at_own_host(scope["path"]), "raw_path": asked.rest.encode(), "root_path": ""}
            await self._own({**scope, **at_home}, receive, send)
            return
        host = self._host_of(asked.cell)
        headers = self._headers(scope, host, target)
        if scope["type"] == "websocket":
            with self._one(host, scope):
                await forward_live.joined(host, target, headers, self.lanes, scope, receive, send)
        elif asked.rest == STOP_PATH and scope["method"] == "POST":
            await self._stops.stop(host, headers, self.lanes, scope, receive, send)
        else:
            with self._one(host, scope):
                await forward_http.passed_on(host, target, headers, self.lanes, scope, receive, send)

    async def _send_page(self, asked: CellPath, scope: Scope, receive: Receive, send: Send) -> None:
        """The console as that cell's; from here on it asks under the cell's path."""
        if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD"):
            raise ApiError(405, "Method not allowed", f"{scope['path']} is a page", "read it", {"Allow": "GET, HEAD"})
        if asked.cell == self._neighbours.here:
            answer: Response = RedirectResponse("/")
        elif not asked.rest:
            answer = RedirectResponse(cell_path.page_of(self._host_of(asked.cell).cell))
        else:
            answer = self._page(self._host_of(asked.cell).stop_url)
        await answer(scope, receive, send)

    def _host_of(self, cell: str) -> Host:
        host = self._neighbours.hosts.get(cell)
        if host is None:
            known = ", ".join(sorted([self._neighbours.here, *self._neighbours.hosts]))
            raise ApiError(404, "Not found", f"there is no cell {cell[:60]} in this house", f"its cells: {known}")
        return host

    def _headers(self, scope: Scope, host: Host, target: str) -> list[tuple[bytes, bytes]]:
        """What the cell's host is asked with: the person's own headers, and this host's word for whom they are of."""
        connection = HTTPConnection(scope)
        word = Word(
            at=self._clock() + self._neighbours.offset_s,
            once=secrets.token_hex(8),
            sender=self._neighbours.here,
            cell=host.cell,
            address=connection.client.host if connection.client else "",
            host=Headers(scope=scope).get("host", ""),
            scheme={"ws": "http", "wss": "https"}.get(str(scope["scheme"]), str(scope["scheme"])),
            method=scope.get("method", "GET"),
            target=target,
            stop_url=host.stop_url,
        )
        kept = [pair for pair in end_to_end(scope["headers"]) if pair[0] not in NOT_OURS and not pair[0].startswith(ABOUT_PROXIES)]
        signed = forwarded.signed(word, bytes.fromhex(self._neighbours.secret))
        return [(b"host", host.url.partition("://")[2].encode("ascii")), *kept, (HEADER.encode(), signed.encode("ascii"))]

    @contextmanager
    def _one(self, host: Host, scope: Scope) -> Iterator[None]:
        """One more under way to this cell. Raises ApiError 503 if there are too many."""
        address = str((scope.get("client") or [""])[0])
        lanes = ((host.cell, ""), (host.cell, address))
        if self._under_way[lanes[0]] >= AT_ONCE or self._under_way[lanes[1]] >= PER_ADDRESS:
            raise too_many(host)
        self._under_way.update(lanes)
        try:
            yield
        finally:
            for lane in lanes:
                self._under_way[lane] -= 1
                if not self._under_way[lane]:
                    del self._under_way[lane]


def _asked(scope: Scope) -> tuple[CellPath, str]:
    """What is asked for, and the target for the cell's host. Raises ApiError 404."""
    try:
        asked = cell_path.read(scope.get("raw_path") or scope["path"].encode())
        return asked, cell_path.target_of(asked.rest, scope.get("query_string", b""))
    except CellPathError as error:
        raise ApiError(404, "Not found", str(error), "as in /cells/NAME/api/v1/cell") from None
