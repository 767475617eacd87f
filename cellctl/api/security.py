"""What holds for every answer and request: headers against misuse of the page, known hosts only, bodies of bounded size."""

from __future__ import annotations

import asyncio
import ipaddress
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.api.problems import Problem, response
from cellctl.domain.cell_path import at_own_host

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
JSON_LIMIT_BYTES = 1 << 20  # of anything that is not an upload
UPLOAD_PATH = "/api/v1/parts"
RESUMABLE_PATH = "/api/v1/uploads/"
ATTACHMENT_PATH = re.compile(r"/api/v1/jobs/[^/]+/attachments/?")
COMMAND_PATH = "/api/v1/cell/"
PIECE_BYTES = 16 * 1024  # of an upload, between two of which everybody else has a turn
BODY_GAP_S = 20.0  # between two pieces of a body
BODY_S, LEAST_BYTES_PER_S = 30.0, 1024  # a body has so long, and as much longer as its bytes take at this pace
GIVE_WAY_S = 0.25  # an upload waits at most so long per piece for commands that are under way

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), payment=(), usb=(), serial=(), hid=(), bluetooth=(), display-capture=()",
    "X-Permitted-Cross-Domain-Policies": "none",
}


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a listener on this host."""
    if host in LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def host_of(header: str) -> str:
    """The name in a Host header, without port and brackets."""
    if header.startswith("["):
        return header[1:].partition("]")[0]
    return header.partition(":")[0]


def own_names() -> frozenset[str]:
    """What this machine is called on its network."""
    name = socket.gethostname().lower()
    short = name.partition(".")[0]
    return frozenset({name, short, f"{short}.local"})


def is_known_host(name: str, bound: str, names: frozenset[str] = frozenset()) -> bool:
    """Whether a page under this name may be ours: an address, or a name that the service was told or that its certificate is for.

    Another name that leads here is somebody else's page (DNS rebinding). A listener on this machine answers to its own names only.
    """
    name = name.lower()
    if name in names or f"*.{name.partition('.')[2]}" in names:
        return True
    if is_loopback(bound):
        return is_loopback(name)
    if name in LOOPBACK_NAMES or name == bound.lower():
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def content_security_policy(
    name: str, port: str, stop: str, script_hashes: list[str], style_hashes: list[str] | None = None
) -> str:
    """Policy of one page: scripts and requests of our own only, and the stop listener. stop : its address without path"""
    host = f"[{name}]" if ":" in name else name
    own = f"ws://{host}:{port} wss://{host}:{port}" if port else f"ws://{host} wss://{host}"
    scripts = " ".join(["'self'", *(f"'{value}'" for value in script_hashes)])
    styles = " ".join(["'self'", *(f"'{value}'" for value in style_hashes or [])])
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {scripts}",
            f"style-src {styles}",
            "img-src 'self' data: blob:",
            "font-src 'self'",
            f"connect-src 'self' {own} {stop}",
            "worker-src 'self' blob:",
            "manifest-src 'self'",
            "base-uri 'none'",
            "form-action 'self'",
            "frame-ancestors 'none'",
        ]
    )


class Guard:
    """ASGI middleware: refuses unknown hosts, adds the headers to every answer.

    script_hashes : the inline scripts of the page that is built now
    stop_url : where a page reaches the stop listener
    names : hosts that the service is called by, beside its own
    """

    def __init__(
        self,
        app: ASGIApp,
        bound_host: str,
        stop_url: Callable[[HTTPConnection], str],
        script_hashes: Callable[[], list[str]],
        names: frozenset[str] = frozenset(),
    ) -> None:
        self.app = app
        self.bound_host = bound_host
        self.stop_url = stop_url
        self.names = names
        self.script_hashes = script_hashes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check the host, then pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        header = Headers(scope=scope).get("host", "")
        name = host_of(header)
        if not is_known_host(name, self.bound_host, self.names):
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 4403})
                return
            problem = Problem(
                title="Unknown host",
                status=421,
                detail="this service does not answer to that name",
                hint=f"use {self.bound_host}, or name it at the start with --name",
            )
            await response(problem)(scope, receive, send)
            return
        policy = content_security_policy(
            name,
            header.rpartition(":")[2] if header.count(":") == 1 or "]:" in header else "",
            self.stop_url(HTTPConnection(scope)).removesuffix("/stop"),
            self.script_hashes(),
        )

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for key, value in HEADERS.items():
                    headers.setdefault(key, value)
                headers.setdefault("Content-Security-Policy", policy)
                if scope["path"].startswith("/api/"):
                    headers.setdefault("Cache-Control", "no-cache")
            await send(message)

        await self.app(scope, receive, with_headers)


class Precedence:
    """Commands to the cell go before uploads: those wait while one is under way."""

    def __init__(self) -> None:
        self._under_way = 0
        self._free = asyncio.Event()
        self._free.set()

    @contextmanager
    def command(self) -> Iterator[None]:
        """A command, for as long as the block lasts."""
        self._under_way += 1
        self._free.clear()
        try:
            yield
        finally:
            self._under_way -= 1
            if self._under_way == 0:
                self._free.set()

    async def give_way(self) -> None:
        """Let everybody else have a turn, and commands that are under way their end."""
        await asyncio.sleep(0)
        if not self._free.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(GIVE_WAY_S):
                    await self._free.wait()


class BodyLimit:
    """ASGI middleware: a body above its limit is answered 413, whatever its headers say. Uploads come in small pieces and give way.

    may_upload : whether who asks may send a part; others get no more room than for any request, as bodies are kept on the disk
    before a route looks at the sign-in
    """

    def __init__(
        self,
        app: ASGIApp,
        upload_limit_bytes: int,
        may_upload: Callable[[HTTPConnection], bool],
        resumable_limit_bytes: int = 0,
    ) -> None:
        self.app = app
        self.upload_limit_bytes = upload_limit_bytes
        self.resumable_limit_bytes = resumable_limit_bytes
        self.may_upload = may_upload
        self.precedence = Precedence()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Count what comes in."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        path = at_own_host(scope["path"])
        is_piece = scope["method"] == "PATCH" and path.startswith(RESUMABLE_PATH)
        is_file = path.rstrip("/") == UPLOAD_PATH or ATTACHMENT_PATH.fullmatch(path) is not None
        is_upload = is_piece or (is_file and scope["method"] == "POST")
        if is_upload:
            is_upload = await asyncio.to_thread(self.may_upload, HTTPConnection(scope))
        whole = self.resumable_limit_bytes if is_piece else self.upload_limit_bytes + 64 * 1024
        limit = whole if is_upload else JSON_LIMIT_BYTES
        detail = (
            f"the request has more than {limit / 1e6:.0f} MB"
            if limit >= 10**6
            else f"the request has more than {limit} bytes"
        )
        stated = Headers(scope=scope).get("content-length", "0")
        if stated.isdigit() and int(stated) > limit:
            problem = Problem(
                title="Too large",
                status=413,
                detail=detail,
                hint="export with a coarser tolerance, or raise the upload limit",
            )
            await response(problem, {"Connection": "close"})(scope, receive, send)
            return
        received = 0
        whole_at = asyncio.get_running_loop().time() + BODY_S
        is_whole = False

        async def counted() -> Message:
            nonlocal received, is_whole
            if is_whole:
                return await receive()  # the sender's leaving, which has all the time there is
            left_s = whole_at + received / LEAST_BYTES_PER_S - asyncio.get_running_loop().time()
            try:
                async with asyncio.timeout(min(BODY_GAP_S, left_s)):
                    message = await receive()
            except TimeoutError:
                why = f"nothing of it came for {BODY_GAP_S:.0f} s" if left_s > BODY_GAP_S else f"it comes at less than {LEAST_BYTES_PER_S} bytes/s"
                raise HTTPException(408, f"the request's body is too slow: {why}", {"Connection": "close"}) from None
            is_whole = not message.get("more_body", False)
            received += len(message.get("body", b""))
            if received > limit:
                raise HTTPException(413, detail)
            return message

        if is_upload:
            await self.app(scope, InPieces(counted, self.precedence), send)
        elif scope["method"] == "POST" and path.startswith(COMMAND_PATH):
            with self.precedence.command():
                await self.app(scope, counted, send)
        else:
            await self.app(scope, counted, send)


class InPieces:
    """A receive channel that hands a body over in pieces of at most PIECE_BYTES, each after others have had their turn."""

    def __init__(self, receive: Receive, precedence: Precedence) -> None:
        self._receive = receive
        self._precedence = precedence
        self._message: Message | None = None  # what is left of the last one

    async def __call__(self) -> Message:
        """The next piece."""
        await self._precedence.give_way()
        message = self._message or await self._receive()
        body = message.get("body", b"")
        if len(body) <= PIECE_BYTES:
            self._message = None
            return message
        self._message = {**message, "body": body[PIECE_BYTES:]}
        return {"type": message["type"], "body": body[:PIECE_BYTES], "more_body": True}
