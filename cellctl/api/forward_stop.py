"""STOP of another cell: by its web process, and past it to its STOP listener when that does not answer at once. The first that did it answers."""

from __future__ import annotations

import asyncio
import json

import httpx
from sqlalchemy.exc import DBAPIError
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse
from starlette.types import Receive, Scope, Send

from cellctl.api import forward_http
from cellctl.api.context import Service
from cellctl.api.forward_headers import unreachable
from cellctl.api.forward_lanes import Lanes
from cellctl.api.neighbours import Host
from cellctl.api.problems import ApiError
from cellctl.api.sign_in import STOP_PATH, Person, address_of, is_let_in, person_of
from cellctl.store.tokens import Role

BODY_LIMIT_BYTES = 4096  # as the listener's own
ANSWER_LIMIT_BYTES = 64 * 1024
ROUND_AFTER_S = 0.4  # the web process has not answered: the listener is asked beside it
GIVEN_UP_S = 3.0
UNKNOWN = "unknown"
TIMES = {"connect": 1.5, "read": 2.5, "write": 1.0, "pool": 0.5}
Answer = tuple[int, list[tuple[bytes, bytes]], bytes]


class Round:
    """STOP by whichever way is open."""

    def __init__(self, service: Service) -> None:
        self._service = service

    async def stop(self, host: Host, headers: list[tuple[bytes, bytes]], lanes: Lanes, scope: Scope, receive: Receive, send: Send) -> None:
        """Stop the cell, and answer. Raises ApiError if no way was open."""
        body = await _body(receive)
        asked = asyncio.create_task(_by_web(host, headers, body, lanes))
        past = asyncio.create_task(self._past(asked, host, body, lanes, scope))
        try:
            status, sent, content = await _first(asked, past)
        except TimeoutError:
            raise unreachable(host, f"neither its web process nor its STOP listener answers within {GIVEN_UP_S:g} s", 504) from None
        finally:
            for task in (asked, past):
                task.cancel()
            await asyncio.gather(asked, past, return_exceptions=True)
        await send({"type": "http.response.start", "status": status, "headers": sent})
        await send({"type": "http.response.body", "body": content})

    async def _past(self, asked: asyncio.Task[Answer], host: Host, body: bytes, lanes: Lanes, scope: Scope) -> Answer:
        """By the listener, once the web process was late or has failed. Raises ApiError."""
        await asyncio.wait((asked,), timeout=ROUND_AFTER_S)
        if asked.done() and asked.exception() is None and asked.result()[0] < 500:
            return asked.result()
        person = await asyncio.to_thread(self._person, HTTPConnection({**scope, "path": STOP_PATH}))
        if person is None or not host.stop_url:
            return await asked
        because, outcome = _field(body, "because"), "failed"
        try:
            state = await _by_listener(host, body, f"{person.name}: {because or 'stop'}"[:500], lanes)
            outcome = "ok"
        finally:
            deed = person.deed("stop", host.cell, because)
            await self._service.deeds.note(self._service.store, deed, f"{outcome}: by its STOP listener, its web process did not answer")
        answer = JSONResponse({"ok": True, "state": state, "data": {"by": "the STOP listener"}})
        return 200, list(answer.raw_headers), bytes(answer.body)


    def _person(self, connection: HTTPConnection) -> Person | None:
        """Who may stop cells behind this request, None for others. Where the store does not tell, everybody may, as at the listener."""
        try:
            person = person_of(connection, self._service)
            return person if person is not None and is_let_in(connection, self._service, Role.OPERATOR) else None
        except ApiError:
            return None
        except (DBAPIError, OSError):
            return Person(UNKNOWN, Role.OPERATOR, address_of(connection))


async def _first(asked: asyncio.Task[Answer], past: asyncio.Task[Answer]) -> Answer:
    """The first answer that says the cell was stopped; else what the web process said. Raises ApiError of that."""
    for done in asyncio.as_completed((asked, past), timeout=GIVEN_UP_S):
        try:
            answer = await done
        except (ApiError, httpx.HTTPError):
            continue
        if answer[0] < 300:
            return answer
    return await asked


async def _body(receive: Receive) -> bytes:
    body, more = b"", True
    while more:
        message = await receive()
        body += message.get("body", b"")
        more = message.get("more_body", False)
        if len(body) > BODY_LIMIT_BYTES:
            return b"{}"  # nothing of it is needed to stop
    return body


async def _by_web(host: Host, headers: list[tuple[bytes, bytes]], body: bytes, lanes: Lanes) -> Answer:
    """By the cell's web process. Raises ApiError."""
    kept = [pair for pair in headers if pair[0] != b"content-length"]
    length = (b"content-length", str(len(body)).encode())
    request = forward_http.request_of(host, "POST", STOP_PATH, [*kept, length], httpx.ByteStream(body), TIMES)
    answer = await forward_http.asked(host, request, lanes, is_stop=True)
    try:
        start = forward_http.start_of(host, answer)
        return answer.status_code, start["headers"], await _whole(host, answer)
    finally:
        await answer.aclose()


async def _whole(host: Host, answer: httpx.Response) -> bytes:
    content = b""
    assert isinstance(answer.stream, httpx.AsyncByteStream)
    async for piece in answer.stream:
        content += piece
        if len(content) > ANSWER_LIMIT_BYTES:
            raise unreachable(host, f"its answer has more than {ANSWER_LIMIT_BYTES} bytes")
    return content


async def _by_listener(host: Host, body: bytes, because: str, lanes: Lanes) -> str:
    """By the cell process's own listener; the state that it tells. Raises ApiError."""
    content = json.dumps({"id": _field(body, "id"), "because": because}).encode()
    at = Host(host.cell, host.stop_url, host.stop_url, host.certificate)
    headers = [(b"host", host.stop_url.partition("://")[2].partition("/")[0].encode()), (b"content-length", str(len(content)).encode())]
    request = forward_http.request_of(at, "POST", "/stop", headers, httpx.ByteStream(content), TIMES)
    answer = await forward_http.asked(at, request, lanes, is_stop=True)
    try:
        told = json.loads(await _whole(host, answer))
        if answer.status_code != 200:
            raise unreachable(host, f"its STOP listener answers {answer.status_code}")
        return str(told.get("state", ""))
    except (ValueError, AttributeError):
        raise unreachable(host, "its STOP listener does not answer as one") from None
    finally:
        await answer.aclose()


def _field(body: bytes, name: str) -> str:
    try:
        given = json.loads(body)
        return str(given.get(name) or "")[:500]
    except (ValueError, AttributeError, RecursionError):
        return ""
