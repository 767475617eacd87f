"""STOP without the web process: a listener of a few lines in the cell process that a busy service cannot delay."""

from __future__ import annotations

import asyncio
import json
import re
import ssl
from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

HEAD_LIMIT = 8192  # bytes of request line and headers
BODY_LIMIT = 4096
READ_TIMEOUT_S = 5.0
CONNECTIONS_MAX = 64  # the oldest that has not said all gives way, so that a hand on STOP always gets in
LOOPBACK = "127.0.0.1"  # the web process's own way
LOCAL_TOO = frozenset({LOOPBACK, "localhost", "0.0.0.0", ""})  # hosts that this machine reaches at LOOPBACK anyway
LENGTH = re.compile(r"[0-9]{1,9}")
REASONS = {
    200: "OK",
    204: "No Content",
    400: "Bad Request",
    404: "Not Found",
    405: "Method Not Allowed",
    413: "Content Too Large",
    431: "Request Header Fields Too Large",
}

Stop = Callable[[str, str, str], Awaitable[str]]


class RequestError(Exception):
    """A request that is not answered with 200."""

    def __init__(self, status: int, title: str) -> None:
        super().__init__(title)
        self.status = status
        self.title = title


class StopListener:
    """POST /stop {"id", "because"} -> {"state"}; GET /healthz -> {"state"}; preflight for the console's origin.

    stop : (id, who, because) -> state word; carried out before the answer
    state : the state word now
    tls : None for plain HTTP
    """

    def __init__(self, stop: Stop, state: Callable[[], str], host: str, tls: ssl.SSLContext | None = None) -> None:
        self._tls = tls
        self._stop = stop
        self._state = state
        self._host = host
        self._pages: frozenset[str] = frozenset()
        self._servers: list[asyncio.Server] = []
        self.waiting: dict[
            asyncio.StreamWriter, None
        ] = {}  # connections whose request has not come whole, oldest first

    def allow_pages(self, hosts: frozenset[str]) -> None:
        """Let pages of these hosts read an answer, as pages of this host may: a page for this cell is open there."""
        self._pages = hosts

    async def start(self, port: int) -> int:
        """Listen at the host, and on this machine; the port that was taken (0 asks for a free one). Raises OSError."""
        server = await asyncio.start_server(self._serve, self._host, port, limit=HEAD_LIMIT)
        self._servers.append(server)
        taken = int(server.sockets[0].getsockname()[1])
        if self._host not in LOCAL_TOO:
            self._servers.append(await asyncio.start_server(self._serve, LOOPBACK, taken, limit=HEAD_LIMIT))
        return taken

    async def close(self) -> None:
        """Stop listening. Harmless twice."""
        for server in self._servers:
            server.close()
        self._servers.clear()
        for writer in list(self.waiting):
            writer.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, came: asyncio.StreamWriter) -> None:
        writer = came
        self.waiting[came] = None
        if len(self.waiting) > CONNECTIONS_MAX:
            oldest = next(iter(self.waiting))
            del self.waiting[oldest]
            oldest.transport.abort()
        origin = ""
        try:
            async with asyncio.timeout(READ_TIMEOUT_S):
                if self._tls is not None:  # after the connection is counted among those that may give way
                    reader, writer = await _behind_tls(came.transport, self._tls)
                method, path, headers = await self._head(reader)
                origin = self._origin(headers)
                body = await self._body(reader, headers)
            self.waiting.pop(came, None)
            peer = writer.get_extra_info("peername")
            status, answer = await self._answer(method, path, body, f"stop listener {peer[0] if peer else ''}")
        except RequestError as error:
            status, answer = error.status, {"title": error.title}
        except (TimeoutError, OSError, asyncio.IncompleteReadError):
            writer.close()
            return
        finally:
            self.waiting.pop(came, None)
        await self._send(writer, status, answer, origin)

    async def _head(self, reader: asyncio.StreamReader) -> tuple[str, str, dict[str, str]]:
        try:
            head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        except asyncio.LimitOverrunError:
            raise RequestError(431, "headers too large") from None
        first, *rest = head.split("\r\n")
        words = first.split(" ")
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            raise RequestError(400, "not HTTP/1.1")
        pairs = (line.partition(":") for line in rest if line)
        return words[0], words[1].partition("?")[0], {name.strip().lower(): value.strip() for name, _, value in pairs}

    async def _body(self, reader: asyncio.StreamReader, headers: dict[str, str]) -> bytes:
        length = headers.get("content-length", "0")
        if not LENGTH.fullmatch(length):
            raise RequestError(400, "content-length is not a number")
        if int(length) > BODY_LIMIT:
            raise RequestError(413, "body too large")
        return await reader.readexactly(int(length))

    def _origin(self, headers: dict[str, str]) -> str:
        """The origin to allow: any page of this host (the console is on another port of it)."""
        origin = headers.get("origin", "")
        try:
            host = urlsplit(origin).hostname if origin else None
        except ValueError:
            return ""
        own = {self._host, "localhost", "127.0.0.1", "::1", headers.get("host", "").rsplit(":", 1)[0]}
        return origin if host in own or host in self._pages else ""

    async def _answer(self, method: str, path: str, body: bytes, who: str) -> tuple[int, dict[str, str]]:
        if method == "OPTIONS":
            return 204, {}
        if path == "/healthz":
            if method != "GET":
                raise RequestError(405, "use GET")
            return 200, {"state": self._state()}
        if path != "/stop":
            raise RequestError(404, "only /stop and /healthz are here")
        if method != "POST":
            raise RequestError(405, "use POST")
        ident, because = "", "STOP pressed"
        try:
            given = json.loads(body) if body else {}
            ident, because = _plain(given.get("id", ident))[:200], _plain(given.get("because", because))[:500]
        except (ValueError, AttributeError, RecursionError):
            because = "STOP pressed (the request's body could not be read)"
        return 200, {"state": await self._stop(ident, who, because)}

    async def _send(self, writer: asyncio.StreamWriter, status: int, answer: dict[str, str], origin: str) -> None:
        body = json.dumps(answer).encode() if status != 204 else b""
        lines = [
            f"HTTP/1.1 {status} {REASONS[status]}",
            "Connection: close",
            f"Content-Length: {len(body)}",
            "Cache-Control: no-store",
        ]
        if body:
            lines.append("Content-Type: application/json")
        if origin:
            lines += [
                f"Access-Control-Allow-Origin: {origin}",
                "Vary: Origin",
                "Access-Control-Allow-Methods: POST, GET",
            ]
            lines += [
                "Access-Control-Allow-Headers: content-type",
                "Access-Control-Max-Age: 600",
                "Access-Control-Allow-Private-Network: true",
            ]
        try:
            writer.write(("\r\n".join(lines) + "\r\n\r\n").encode() + body)
            await writer.drain()
        except OSError:
            return
        finally:
            writer.close()


async def _behind_tls(transport: asyncio.WriteTransport, tls: ssl.SSLContext) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Both ends of the connection behind its handshake. Raises OSError if the other side leaves or does not speak TLS."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(HEAD_LIMIT, loop)
    protocol = asyncio.StreamReaderProtocol(reader, loop=loop)
    secured = await loop.start_tls(transport, protocol, tls, server_side=True, ssl_handshake_timeout=READ_TIMEOUT_S)
    if secured is None:
        raise ConnectionAbortedError("left during the handshake")
    protocol.connection_made(secured)
    return reader, asyncio.StreamWriter(secured, protocol, reader, loop)


def _plain(value: object) -> str:
    """Text that can be written down: half a surrogate pair is replaced."""
    return str(value).encode("utf-8", "replace").decode()
