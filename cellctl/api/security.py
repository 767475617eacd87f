"""What holds for every answer and request: headers against misuse of the page, known hosts only, bodies of bounded size."""

from __future__ import annotations

import asyncio
import ipaddress
from collections.abc import Callable

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.api.problems import Problem, response

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
JSON_LIMIT_BYTES = 1 << 20  # of anything that is not an upload
UPLOAD_PATH = "/api/v1/parts"

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), payment=(), usb=()",
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


def is_known_host(name: str, bound: str) -> bool:
    """Whether a page under this name may be ours. A listener on this machine only answers to its own names (DNS rebinding)."""
    if is_loopback(bound):
        return is_loopback(name)
    return bool(name) and all(char.isalnum() or char in ".-:_" for char in name)


def content_security_policy(
    name: str, port: str, stop_port: int, script_hashes: list[str], style_hashes: list[str] | None = None
) -> str:
    """Policy of one page: scripts and requests of our own only, and the stop listener on the same host."""
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
            f"connect-src 'self' {own} http://{host}:{stop_port}",
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
    """

    def __init__(self, app: ASGIApp, bound_host: str, stop_port: int, script_hashes: Callable[[], list[str]]) -> None:
        self.app = app
        self.bound_host = bound_host
        self.stop_port = stop_port
        self.script_hashes = script_hashes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check the host, then pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        header = Headers(scope=scope).get("host", "")
        name = host_of(header)
        if not is_known_host(name, self.bound_host):
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 4403})
                return
            problem = Problem(
                title="Unknown host",
                status=421,
                detail="this service does not answer to that name",
                hint=f"use http://{self.bound_host}",
            )
            await response(problem)(scope, receive, send)
            return
        policy = content_security_policy(
            name,
            header.rpartition(":")[2] if header.count(":") == 1 or "]:" in header else "",
            self.stop_port,
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


class BodyLimit:
    """ASGI middleware: a body above its limit is answered 413, whatever its headers say.

    may_upload : whether who asks may send a part; others get no more room than for any request, as bodies are kept on the disk
    before a route looks at the sign-in
    """

    def __init__(self, app: ASGIApp, upload_limit_bytes: int, may_upload: Callable[[HTTPConnection], bool]) -> None:
        self.app = app
        self.upload_limit_bytes = upload_limit_bytes
        self.may_upload = may_upload

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Count what comes in."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        is_upload = scope["path"].rstrip("/") == UPLOAD_PATH and scope["method"] == "POST"
        if is_upload:
            is_upload = await asyncio.to_thread(self.may_upload, HTTPConnection(scope))
        limit = self.upload_limit_bytes + 64 * 1024 if is_upload else JSON_LIMIT_BYTES
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

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                raise HTTPException(413, detail)
            return message

        await self.app(scope, counted, send)
