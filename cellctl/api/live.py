"""The live feed: snapshots at the cell's rate, newest wins; events in order from any number on; word of changed jobs."""

from __future__ import annotations

import asyncio
import time

import msgspec
from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from cellctl.api import jobs as job_routes
from cellctl.api.context import Service, service_of
from cellctl.api.feed import Viewer, event_text
from cellctl.api.sign_in import is_same_origin, person_of
from cellctl.domain.messages import Event
from cellctl.store import history, jobs
from cellctl.store.parts import NotFoundError

router = APIRouter()
REPLAY_PAGE = 500
CHECK_SIGN_IN_S = 10.0
NOT_SIGNED_IN = 4401
BEHIND = 4408  # come back with `from`


@router.websocket("/api/v1/live")
async def live(socket: WebSocket) -> None:
    """`?from=N` replays the events after number N first; without it only new ones come."""
    service = service_of(socket)
    person = await asyncio.to_thread(person_of, socket, service)
    if person is None or not is_same_origin(socket):
        await socket.close(NOT_SIGNED_IN)
        return
    given = socket.query_params.get("from", "")
    with service.feed.viewer() as viewer:  # from here on nothing is missed; what is replayed too is skipped by number
        newest = await asyncio.to_thread(_last_seq, service)
        start = int(given) if given.isdigit() and len(given) < 16 else newest
        await socket.accept()
        reader = asyncio.create_task(_until_closed(socket))
        try:
            await _send_all(socket, service, viewer, start, reader)
        except (WebSocketDisconnect, RuntimeError):
            return  # the browser left
        finally:
            reader.cancel()


def _last_seq(service: Service) -> int:
    with service.store.read() as rows:
        return history.last_seq(rows)


async def _until_closed(socket: WebSocket) -> None:
    """Read what a viewer says (nothing that matters) until it leaves."""
    try:
        while True:
            await socket.receive_text()
    except (WebSocketDisconnect, RuntimeError, KeyError):
        return


async def _replay(socket: WebSocket, service: Service, seq: int) -> int:
    """Send the stored events after `seq`; the number of the last."""

    def page(after: int) -> list[Event]:
        with service.store.read() as rows:
            return history.events_after(rows, after, REPLAY_PAGE)

    while events := await asyncio.to_thread(page, seq):
        for event in events:
            await socket.send_text(event_text(event))
        seq = events[-1].seq
    return seq


def _job_text(service: Service, job_id: str) -> str | None:
    try:
        with service.store.read() as rows:
            job = job_routes.document(service, jobs.get(rows, job_id))
    except NotFoundError:
        return None
    return msgspec.json.encode({"type": "job", "job": job.model_dump(mode="json")}).decode()


async def _send_all(socket: WebSocket, service: Service, viewer: Viewer, seq: int, reader: asyncio.Task[None]) -> None:
    """Replay, then whatever comes, until the viewer leaves, falls behind or is signed out."""
    seq = await _replay(socket, service, seq)
    checked = time.monotonic()
    while not reader.done():
        if viewer.is_behind:
            await socket.close(BEHIND)
            return
        viewer.wake.clear()
        while viewer.events:
            event = viewer.events.popleft()
            if event.seq > seq:
                seq = event.seq
                await socket.send_text(event_text(event))
        while viewer.jobs:
            job_id = next(iter(viewer.jobs))
            del viewer.jobs[job_id]
            text = await asyncio.to_thread(_job_text, service, job_id)
            if text is not None:
                await socket.send_text(text)
        if viewer.has_snapshot and service.feed.snapshot_text is not None:
            viewer.has_snapshot = False
            await socket.send_text(service.feed.snapshot_text)
        if time.monotonic() - checked > CHECK_SIGN_IN_S:
            checked = time.monotonic()
            if await asyncio.to_thread(person_of, socket, service) is None:
                await socket.close(NOT_SIGNED_IN)
                return
        await _wait(viewer, reader)


async def _wait(viewer: Viewer, reader: asyncio.Task[None]) -> None:
    """Until there is mail, the viewer leaves, or it is time to look at its sign-in."""
    mail = asyncio.create_task(viewer.wake.wait())
    try:
        await asyncio.wait({mail, reader}, timeout=CHECK_SIGN_IN_S, return_when=asyncio.FIRST_COMPLETED)
    finally:
        mail.cancel()
