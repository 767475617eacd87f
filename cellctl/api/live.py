"""The live feed on both wires, a WebSocket and server-sent events: the same messages, the same numbers to go on from.

Messages are JSON: {"type": "snapshot", "snapshot": …} (newest wins), {"type": "event", "event": {"seq": N, …}} (every one, in order),
{"type": "job", "change": M, "job": …} (every job that was changed, as it is now) and, after HEARTBEAT_S of silence,
{"type": "heartbeat", "seq": N, "change": M}. Who lost the line says the last N and M that it saw and is told what it missed:
`?from=N&jobs_from=M` at the WebSocket, `Last-Event-ID: N-M` (which a browser's EventSource sends by itself) at the stream.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections import deque
from collections.abc import Coroutine
from contextlib import suppress
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, WebSocket, WebSocketDisconnect
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from cellctl.api import mail
from cellctl.api.context import Service, service_of
from cellctl.api.feed import Viewer as FeedViewer
from cellctl.api.mail import Ended, Mail, Postman
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import ServiceOf, Viewer, is_same_origin, person_of, person_soon

router = APIRouter(tags=["events"], responses=DOCUMENTED)
NOT_SIGNED_IN = 4401
BEHIND = 4408  # come back with `from`
NO_TEXT, NO_JSON, TOO_MUCH = 1003, 1007, 1008  # what was said to us: bytes, text that is no JSON, more than anybody has to say
SAID_MAX, SAID_S = 20, 10.0  # messages of a viewer, and the time in which they may come
CODES = {"signed out": NOT_SIGNED_IN, "behind": BEHIND}
PLACE = re.compile(r"([0-9]{1,15})(?:-([0-9]{1,15}))?")
RETRY_MS = 1000


def number_of(text: str | None) -> int | None:
    """The number that a query gives, None without one."""
    return int(text) if text is not None and text.isdecimal() and len(text) < 16 else None


async def started(service: Service, viewer: FeedViewer, seq: int | None, change: int | None, connection: Request | WebSocket) -> Postman:
    """A postman from the given numbers on, from now on where there is none; a number that is not reached yet means now."""
    last_seq, last_change = await mail.newest(service)
    return Postman(
        service,
        viewer,
        last_seq if seq is None else min(seq, last_seq),
        last_change if change is None else min(change, last_change),
        lambda: person_of(connection, service) is not None,
    )


@router.websocket("/api/v1/live")
async def live(socket: WebSocket) -> None:
    """`?from=N&jobs_from=M` replays what came after event N and change M first; without them only new ones come."""
    service = service_of(socket)
    person = await person_soon(socket, service)
    if person is None or not is_same_origin(socket):
        await socket.close(NOT_SIGNED_IN)
        return
    seq, change = (number_of(socket.query_params.get(name)) for name in ("from", "jobs_from"))
    with service.feed.viewer() as viewer:  # from here on nothing is missed; what is replayed too is skipped by number
        postman = await started(service, viewer, seq, change, socket)
        await socket.accept()
        await first_of(_tell(socket, postman), _until_closed(socket))


async def first_of(*works: Coroutine[Any, Any, None]) -> None:
    """Do both until one of them ends; the other is cancelled. Raises what the one that ended raised."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()


async def _until_closed(socket: WebSocket) -> None:
    """Read what a viewer says until it leaves. Nothing that it says matters, so who says bytes, no JSON or too much is shown out."""
    said: deque[float] = deque(maxlen=SAID_MAX)
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        now = asyncio.get_running_loop().time()
        code = _why_out(message.get("text"))
        if len(said) == SAID_MAX and now - said[0] < SAID_S:
            code = TOO_MUCH
        said.append(now)
        if code is not None:
            with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
                async with asyncio.timeout(mail.SEND_S):
                    await socket.close(code)
            return


def _why_out(text: str | None) -> int | None:
    """The code that ends a conversation after this message; None if it may go on."""
    if text is None:
        return NO_TEXT
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return NO_JSON
    return None


async def _tell(socket: WebSocket, postman: Postman) -> None:
    """Send all mail; says why when it ends."""
    code = BEHIND
    try:
        async for one in postman.mail():
            async with asyncio.timeout(mail.SEND_S):
                await socket.send_text(one.text)
    except Ended as end:
        code = CODES[end.because]
    except TimeoutError:
        code = BEHIND
    except (WebSocketDisconnect, RuntimeError):
        return  # the viewer left
    with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
        async with asyncio.timeout(mail.SEND_S):
            await socket.close(code)


def place_of(last_event_id: str | None) -> tuple[int | None, int | None]:
    """(event, change) of a Last-Event-ID. Raises ApiError 422 for one that is not ours."""
    if not last_event_id:
        return None, None
    found = PLACE.fullmatch(last_event_id)
    if found is None:
        raise ApiError(422, "The request does not fit", "Last-Event-ID is none of this stream", "pass on the `id` of the last message")
    return int(found[1]), None if found[2] is None else int(found[2])


def as_sent_event(one: Mail) -> bytes:
    """A message in the form of text/event-stream. Snapshots have no id: they are not replayed."""
    place = f"id: {one.place}\n" if one.kind != "snapshot" else ""
    return f"{place}event: {one.kind}\ndata: {one.text}\n\n".encode()


class EventStream(Response):
    """An answer that goes on until the reader leaves, falls behind or is signed out."""

    media_type = "text/event-stream"

    def __init__(self, request: Request, service: Service, seq: int | None, change: int | None, *, snapshots: bool) -> None:
        self.status_code = 200
        self.background = None
        self.init_headers({"Cache-Control": "no-store", "X-Accel-Buffering": "no"})
        del self.headers["content-length"]
        self._given = (request, service, seq, change, snapshots)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until it ends."""
        await first_of(self._tell(send), _until_left(receive))

    async def _tell(self, send: Send) -> None:
        request, service, seq, change, snapshots = self._given
        await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
        with service.feed.viewer() as viewer:
            postman = await started(service, viewer, seq, change, request)
            try:
                await _sent(send, f"retry: {RETRY_MS}\nid: {postman.place}\n\n".encode())
                async for one in postman.mail():
                    if snapshots or one.kind != "snapshot":
                        await _sent(send, as_sent_event(one))
            except (Ended, TimeoutError, OSError):
                return  # it comes back with Last-Event-ID; ended here, so that its connection is closed
            finally:
                with suppress(TimeoutError, OSError):
                    async with asyncio.timeout(mail.SEND_S):
                        await send({"type": "http.response.body", "body": b""})


async def _sent(send: Send, body: bytes) -> None:
    async with asyncio.timeout(mail.SEND_S):
        await send({"type": "http.response.body", "body": body, "more_body": True})


async def _until_left(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


@router.get(
    "/api/v1/events/stream",
    status_code=200,
    response_class=Response,
    operation_id="stream_events",
    responses={200: {"content": {"text/event-stream": {"schema": {"type": "string"}}}, "description": "Messages until the reader leaves"}},
)
def stream(
    _person: Viewer,
    request: Request,
    service: ServiceOf,
    last_event_id: Annotated[str | None, Header(alias="Last-Event-ID", max_length=40, description="`id` of the last message seen: N-M")] = None,
    seq: Annotated[int | None, Query(alias="from", ge=0, lt=10**15, description="events after this number first")] = None,
    change: Annotated[int | None, Query(alias="jobs_from", ge=0, lt=10**15, description="jobs changed after this number first")] = None,
    snapshots: Annotated[bool, Query(description="the cell's snapshots too, at its rate")] = True,
) -> EventStream:
    """Server-sent events: what happens at the cell, changed jobs, and the newest snapshot; with replay."""
    told = place_of(last_event_id)
    return EventStream(request, service, seq if told[0] is None else told[0], change if told[1] is None else told[1], snapshots=snapshots)
