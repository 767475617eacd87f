"""One HTTP request passed on to another cell's host: both bodies flow through piece by piece, and an end of either side ends the other."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import AsyncIterator
from contextlib import suppress

import httpx
import structlog
from starlette.types import Message, Receive, Scope, Send

from cellctl.api.forward_headers import end_to_end, too_many, unreachable
from cellctl.api.forward_lanes import TIMES, Lanes
from cellctl.api.neighbours import Host
from cellctl.api.problems import ApiError
from cellctl.domain import cell_path
from cellctl.domain.forwarded import HEADER

SEND_S = 30.0  # a reader that takes a piece no sooner is given up
WHOLE_S = 3600.0  # for an exchange that is no live stream
ANSWER_LIMIT_BYTES = 8 * 2**30  # far above a store's largest file
HEADERS_LIMIT_BYTES = 32 * 1024
STREAMED = "text/event-stream"
OWN_CONNECTION = frozenset({b"date", b"server", HEADER.encode()})


log = structlog.get_logger(__name__)


class Body(httpx.AsyncByteStream):
    """What the person sends, as it comes. `sent` : set at its end"""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self.sent = asyncio.Event()

    async def __aiter__(self) -> AsyncIterator[bytes]:
        """Its pieces. Raises ConnectionAbortedError if the person leaves."""
        more = True
        while more:
            message = await self._receive()
            if message["type"] == "http.disconnect":
                raise ConnectionAbortedError("the sender left")
            more = message.get("more_body", False)
            if not more:
                self.sent.set()
            if message.get("body"):
                yield message["body"]


class Nothing(httpx.AsyncByteStream):
    """No body."""

    async def __aiter__(self) -> AsyncIterator[bytes]:
        """Nothing."""
        return
        yield b""


def request_of(
    host: Host, method: str, target: str, headers: list[tuple[bytes, bytes]], body: httpx.AsyncByteStream, times: dict[str, float]
) -> httpx.Request:
    """The request to the cell's host, its target byte for byte."""
    extensions = {"timeout": times, "target": target.encode("ascii")}
    return httpx.Request(method, host.url, headers=headers, stream=body, extensions=extensions)


async def passed_on(
    host: Host, target: str, headers: list[tuple[bytes, bytes]], lanes: Lanes, scope: Scope, receive: Receive, send: Send
) -> None:
    """Pass on until either side has said all or left. Raises ApiError 502, 504 before the answer has begun."""
    names = {name.lower() for name, _ in scope["headers"]}
    body = Body(receive) if names & {b"content-length", b"transfer-encoding"} else None
    if body is not None and b"content-length" not in names:
        headers = [*headers, (b"transfer-encoding", b"chunked")]
    request = request_of(host, scope["method"], target, headers, body or Nothing(), TIMES)
    exchange = asyncio.create_task(exchanged(host, request, lanes, send))
    left = asyncio.create_task(_until_left(receive, body))
    try:
        await asyncio.wait((exchange, left), return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (exchange, left):
            task.cancel()
        await asyncio.gather(exchange, left, return_exceptions=True)
    with suppress(ConnectionAbortedError):
        if not exchange.cancelled():
            exchange.result()


async def _until_left(receive: Receive, body: Body | None) -> None:
    """Wait until the person is gone; while a body comes, who reads it notices."""
    if body is not None:
        await body.sent.wait()
    while (await receive())["type"] != "http.disconnect":
        pass


async def exchanged(host: Host, request: httpx.Request, lanes: Lanes, send: Send) -> None:
    """Ask the cell's host and send its answer on; one that breaks off is not ended, so that its connection is closed.

    Raises ApiError 502, 504 before the answer has begun.
    """
    begun = False
    try:
        answer = await asked(host, request, lanes)
        try:
            start = start_of(host, answer)
            begun = True
            async with asyncio.timeout(None if _is_stream(answer) else WHOLE_S):
                await _flow(host, answer, start, send)
        finally:
            await answer.aclose()
    except (httpx.HTTPError, TimeoutError, ApiError) as error:
        if not begun:
            raise
        log.warning("an answer that was passed on broke off", cell=host.cell, target=str(request.extensions["target"]), error=str(error))


async def asked(host: Host, request: httpx.Request, lanes: Lanes, is_stop: bool = False) -> httpx.Response:
    """The begin of the answer. Raises ApiError 502, 503, 504."""
    try:
        return await lanes.pool(host, is_stop).handle_async_request(request)
    except httpx.PoolTimeout:
        raise too_many(host) from None
    except httpx.ConnectError as error:
        raise unreachable(host, _why(error)) from None
    except httpx.TimeoutException as error:
        raise unreachable(host, f"no answer in time ({type(error).__name__})", 504) from None
    except httpx.HTTPError as error:
        raise unreachable(host, f"the connection broke ({type(error).__name__})") from None
    except ssl.SSLError as error:
        raise unreachable(host, f"its certificate is not believed ({error.reason or error})") from None


def start_of(host: Host, answer: httpx.Response) -> Message:
    """The begin of the answer to the person. Raises ApiError 502 for one that is not passed on."""
    raw = answer.headers.raw
    if sum(len(name) + len(value) for name, value in raw) > HEADERS_LIMIT_BYTES:
        raise unreachable(host, f"its answer has more than {HEADERS_LIMIT_BYTES} bytes of headers")
    if answer.headers.get(HEADER) is None and answer.status_code not in (403, 421):
        raise unreachable(host, "it does not take this host's word for whom a request is of: it is no host of this house, or has just started")
    if 300 <= answer.status_code < 400 and answer.status_code != 304:
        raise unreachable(host, f"it redirects ({answer.status_code}), which is not followed")
    if answer.status_code < 200:
        raise unreachable(host, f"it answers {answer.status_code}")
    headers = [(name, _moved(host, name, value)) for name, value in end_to_end(raw) if name not in OWN_CONNECTION]
    return {"type": "http.response.start", "status": answer.status_code, "headers": headers}


def _moved(host: Host, name: bytes, value: bytes) -> bytes:
    """A Location under the interface leads to the cell's path here."""
    is_place = name in (b"location", b"content-location") and value.startswith(b"/api/")
    return cell_path.page_of(host.cell).rstrip("/").encode() + value if is_place else value


def _is_stream(answer: httpx.Response) -> bool:
    return bool(answer.headers.get("content-type", "").startswith(STREAMED))


async def _flow(host: Host, answer: httpx.Response, start: Message, send: Send) -> None:
    """Send the answer on, at the pace of its reader. Raises TimeoutError, httpx.HTTPError, ApiError."""
    await send(start)
    passed = 0
    assert isinstance(answer.stream, httpx.AsyncByteStream)
    async for piece in answer.stream:
        passed += len(piece)
        if passed > ANSWER_LIMIT_BYTES:
            raise unreachable(host, f"its answer has more than {ANSWER_LIMIT_BYTES} bytes")
        async with asyncio.timeout(SEND_S):
            await send({"type": "http.response.body", "body": piece, "more_body": True})
    async with asyncio.timeout(SEND_S):
        await send({"type": "http.response.body", "body": b""})


def _why(error: Exception) -> str:
    """The words of a connection that was not made."""
    if isinstance(error.__cause__, Exception) and "CERTIFICATE" in str(error):
        return "its certificate is not believed"
    return "nothing listens there" if "refused" in str(error).lower() or "all connection attempts failed" in str(error).lower() else str(error)[:200]
