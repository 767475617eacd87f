"""Validators of what is read (RFC 9110): a strong ETag on every document and file, 304 for who has it already, 412 for who changes blindly."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any

import anyio
from fastapi import Header
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.api.problems import ApiError

API = "/api/"
OWN_HEAD = ("/api/v1/uploads/", "/api/v1/events/stream")  # routes that answer HEAD themselves, or not at all
KEPT_WITH_304 = frozenset({b"etag", b"cache-control", b"content-location", b"expires", b"vary", b"set-cookie", b"last-modified"})
PATHSEND = "http.response.pathsend"
FILE_CHUNK_BYTES = 64 * 1024

IfMatch = Annotated[
    str | None, Header(alias="If-Match", max_length=2000, description="ETag of what this request is about: 412 if it changed since")
]


def etag_of(body: bytes) -> str:
    """A strong validator of these bytes."""
    return f'"{hashlib.sha256(body).hexdigest()[:32]}"'


def etag_of_document(document: BaseModel) -> str:
    """The validator that a GET of this document answers with."""
    return etag_of(bytes(JSONResponse(jsonable_encoder(document)).body))


def names(given: str, etag: str) -> bool:
    """Whether a list of validators holds this one, or is `*`. W/ in front of one is passed over."""
    return any(item == "*" or item.removeprefix("W/") == etag for item in (part.strip() for part in given.split(",")))


def check_unchanged(if_match: str | None, etag: str, what: str) -> None:
    """Raise ApiError 412 if the sender saw another state of it. Without If-Match nothing is asked."""
    if if_match is not None and not names(if_match, etag):
        raise ApiError(
            412, "Changed meanwhile", f"{what} is not what If-Match names any more", "read it again, then decide again", {"ETag": etag}
        )


class Conditional:
    """ASGI middleware: GET under /api/ gets an ETag where the route gave none, If-None-Match is answered 304, and HEAD as GET without body."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Watch the answer to a GET or HEAD."""
        is_head = scope["type"] == "http" and scope["method"] == "HEAD" and not scope["path"].startswith(OWN_HEAD)
        is_get = scope["type"] == "http" and (scope["method"] == "GET" or is_head)
        if not is_get or not scope["path"].startswith(API):
            await self.app(scope, receive, send)
            return
        known = Headers(scope=scope).get("if-none-match", "")
        inner: dict[str, Any] = {**scope, "method": "GET"}
        if known or is_head:  # then a file is opened only if it is asked for
            inner["extensions"] = {**scope.get("extensions", {}), PATHSEND: {}}
        await self.app(inner, receive, Answer(send, known, is_head))


class Answer:
    """The send channel of one answer. known : If-None-Match"""

    def __init__(self, send: Send, known: str, is_head: bool) -> None:
        self._send = send
        self._known = known
        self._is_head = is_head
        self._start: Message | None = None
        self._has_no_body = False

    async def __call__(self, message: Message) -> None:
        """Hold the start back until the body tells the validator."""
        if message["type"] == "http.response.start":
            self._start = message
            if message["status"] != 200 or Headers(raw=message["headers"]).get("content-type", "").startswith("text/event-stream"):
                await self._begin()
        elif message["type"] == PATHSEND:
            await self._begin()
            if not self._has_no_body:
                await self._send_file(message["path"])
        else:
            await self._body(message)

    async def _body(self, message: Message) -> None:
        body, more = message.get("body", b""), message.get("more_body", False)
        if self._start is not None:
            headers = MutableHeaders(scope=self._start)
            if not more and "etag" not in headers and "no-store" not in headers.get("cache-control", ""):
                headers["ETag"] = etag_of(body)
            await self._begin()
        if not self._has_no_body:
            await self._send(message)

    async def _begin(self) -> None:
        """Send the start: as it is, or as 304."""
        start, self._start = self._start, None
        if start is None:
            return
        etag = Headers(raw=start["headers"]).get("etag", "")
        if start["status"] == 200 and etag and self._known and names(self._known, etag):
            start = {**start, "status": 304, "headers": [pair for pair in start["headers"] if pair[0].lower() in KEPT_WITH_304]}
            self._has_no_body = True
        self._has_no_body = self._has_no_body or self._is_head
        await self._send(start)
        if self._has_no_body:
            await self._send({"type": "http.response.body", "body": b""})

    async def _send_file(self, path: str) -> None:
        async with await anyio.open_file(path, "rb") as file:
            more = True
            while more:
                chunk = await file.read(FILE_CHUNK_BYTES)
                more = len(chunk) == FILE_CHUNK_BYTES
                await self._send({"type": "http.response.body", "body": chunk, "more_body": more})
