"""Requests that another host of the house passes on: its word for whom they come from is taken if its signature says so, else passed over."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import structlog
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.api.neighbours import Neighbours
from cellctl.api.problems import Problem, response
from cellctl.domain import forwarded
from cellctl.domain.forwarded import HEADER, Word

SCOPE_KEY = "cellctl.forwarded"
STOP_PATH = "/api/v1/cell/stop"
SEEN_MAX = 20_000  # words within their age: far above what hosts forward in that time
log = structlog.get_logger(__name__)


def word_of(scope: Scope) -> Word | None:
    """The word that was taken for this request."""
    word: Word | None = scope.get(SCOPE_KEY)
    return word


class Vouched:
    """ASGI middleware. Behind it a request that was passed on looks as it came to the other host: client, host and scheme of the page.

    A header that no host signed is taken off and changes nothing. One that is signed but late, heard before, or meant for another
    request or cell is refused; STOP alone is taken late. The answer names this cell in the same header, so that the sender knows.
    on_page : told the host of each page that requests are passed on for
    """

    def __init__(
        self, app: ASGIApp, neighbours: Neighbours, clock: Callable[[], float], on_page: Callable[[str], None]
    ) -> None:
        self.app = app
        self._neighbours = neighbours
        self._clock = clock
        self._on_page = on_page
        self._seen: OrderedDict[str, float] = OrderedDict()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Look for a word, then pass on."""
        given = Headers(scope=scope).getlist(HEADER) if scope["type"] in ("http", "websocket") else []
        if not given:
            await self.app(scope, receive, send)
            return
        plain = {**scope, "headers": [pair for pair in scope["headers"] if pair[0].lower() != HEADER.encode()]}
        word = await self._read(given[0]) if len(given) == 1 else None
        if word is None:
            log.warning("a forwarding header that no host of this house signed", client=str((scope.get("client") or [""])[0]))
            await self.app(plain, receive, send)
            return
        problem = self._refusal(word, scope)
        if problem is not None:
            await _refuse(problem, scope, receive, send)
            return
        self._on_page(word.host)
        await self.app(_as_it_came(plain, word), receive, self._naming(send))

    async def _read(self, header: str) -> Word | None:
        """The word of a header that its sender signed, None for anything else."""
        word = forwarded.claimed(header)
        if word is None:
            return None
        for _ in range(2):
            if forwarded.is_signed(header, self._neighbours.secret_of(word.sender)):
                return word
            await self._neighbours.read_again()  # it may have started since, with another secret
        return None

    def _refusal(self, word: Word, scope: Scope) -> Problem | None:
        query = scope.get("query_string", b"").decode("latin-1")
        path = (scope.get("raw_path") or scope["path"].encode()).decode("latin-1")
        now = self._clock() + self._neighbours.offset_s
        if word.cell != self._neighbours.here:
            detail = forwarded.why_not(word, self._neighbours.here, word.method, word.target, word.at)
            return Problem(title="Wrong host", status=421, detail=detail, hint="restart the service of that cell: it tells where it is")
        why = forwarded.why_not(word, word.cell, scope.get("method", "GET"), f"{path}?{query}" if query else path, now)
        is_stop = path == STOP_PATH and word.target == path and word.method == scope.get("method")
        if not why and not self._is_first(word, now):
            why = f"the word of {word.sender}'s host was used before"
        if not why or is_stop:
            return None
        return Problem(title="Forwarding refused", status=403, detail=why, hint="try again; if it stays, set the clocks of both hosts (NTP)")

    def _is_first(self, word: Word, now: float) -> bool:
        """Whether this word is heard for the first time within the age that it can have."""
        while self._seen and (next(iter(self._seen.values())) < now - 2 * forwarded.MAX_AGE_S or len(self._seen) >= SEEN_MAX):
            self._seen.popitem(last=False)
        is_first = word.once not in self._seen
        self._seen[word.once] = now
        return is_first

    def _naming(self, send: Send) -> Send:
        async def named(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.accept", "websocket.http.response.start"):
                message = {**message, "headers": list(message.get("headers", []))}
                MutableHeaders(scope=message)[HEADER] = "taken"
            await send(message)

        return named


def _as_it_came(scope: dict[str, Any], word: Word) -> dict[str, Any]:
    """The scope with client, host and scheme as at the sender's."""
    headers = [(name, word.host.encode("latin-1", "replace") if name.lower() == b"host" else value) for name, value in scope["headers"]]
    scheme = word.scheme if scope["type"] == "http" else {"http": "ws", "https": "wss"}.get(word.scheme, "ws")
    return {**scope, "headers": headers, "client": (word.address, 0), "scheme": scheme, SCOPE_KEY: word}


async def _refuse(problem: Problem, scope: Scope, receive: Receive, send: Send) -> None:
    log.warning("forwarding refused", detail=problem.detail)
    if scope["type"] == "websocket":
        await response(problem)(scope, receive, send)
        return
    problem.instance = scope["path"]
    await response(problem)(scope, receive, send)
