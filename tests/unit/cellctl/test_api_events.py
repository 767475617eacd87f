from __future__ import annotations

import asyncio
import json
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx
import pytest
from sqlalchemy import insert
from starlette.types import Message

from cellctl.api import feed, mail
from cellctl.api.live import EventStream
from cellctl.domain.jobs import JobState
from cellctl.domain.messages import Event
from cellctl.domain.snapshot import Snapshot
from cellctl.store import jobs, parts
from cellctl.store.jobs import JobRow
from cellctl.store.parts import Inspection, PartRow
from cellctl.store.schema import events
from cellctl.store.tokens import Role

STREAM = "/api/v1/events/stream"
WAIT_S = 60.0


@dataclass
class Reader:
    """One connection to the stream, and what came over it."""

    status: int = 0
    begins_at: str = ""
    messages: asyncio.Queue[dict[str, Any] | None] = field(default_factory=asyncio.Queue)

    async def next(self) -> dict[str, Any]:
        async with asyncio.timeout(WAIT_S):
            message = await self.messages.get()
        assert message is not None, "the stream ended"
        return message


@asynccontextmanager
async def connected(web: Any, last: str = "", query: str = "snapshots=false") -> AsyncIterator[Reader]:
    """The stream read as a browser reads it, straight from the application."""
    reader, left = Reader(), asyncio.Event()
    text = ""
    headers = [(b"host", b"127.0.0.1:8000"), (b"authorization", f"Bearer {web.secrets[Role.VIEWER]}".encode())]
    if last:
        headers.append((b"last-event-id", last.encode()))
    scope = {
        "type": "http", "method": "GET", "path": STREAM, "raw_path": STREAM.encode(), "query_string": query.encode(), "headers": headers,
        "http_version": "1.1", "scheme": "http", "server": ("127.0.0.1", 8000), "client": ("127.0.0.1", 1), "root_path": "",
    }  # fmt: skip
    asked = False

    async def receive() -> dict[str, Any]:
        nonlocal asked
        if not asked:
            asked = True
            return {"type": "http.request", "body": b"", "more_body": False}
        await left.wait()
        return {"type": "http.disconnect"}

    async def send(message: dict[str, Any]) -> None:
        nonlocal text
        if message["type"] == "http.response.start":
            reader.status = message["status"]
            return
        text += message.get("body", b"").decode()
        while "\n\n" in text:
            block, _, text = text.partition("\n\n")
            fields = dict(line.split(": ", 1) for line in block.splitlines())
            if "retry" in fields:
                reader.begins_at = fields["id"]
            if "data" in fields:
                reader.messages.put_nowait({"id": fields.get("id"), "event": fields["event"], "data": json.loads(fields["data"])})
        if not message.get("more_body", False):
            reader.messages.put_nowait(None)

    task = asyncio.create_task(web.app(scope, receive, send))
    try:
        yield reader
    finally:
        left.set()
        async with asyncio.timeout(WAIT_S):
            await task


def happen(web: Any, *, seen: bool) -> None:
    """An event at the cell; one that is not seen was written while the link was down."""
    with web.service.store.write_cell() as rows:
        done = rows.execute(insert(events).values(at=1.0, kind="state", text="x"))
        seq = int(done.inserted_primary_key[0])
    if seen:
        web.service.feed.take_event(Event(seq=seq, at=1.0, kind="state", text="x"))


def add_jobs(web: Any, count: int) -> list[str]:
    with web.service.store.write() as rows:
        parts.add(rows, PartRow("part-1", "b", ".stl", "mm", "f" * 64, 1, 1.0, "me", Inspection("m" * 64, [[0.0] * 3] * 2, 12, 1.0, [])))
        for number in range(count):
            rows_job = JobRow(f"job-{number}", "b", "part-1", "cell", "", "316L", 1.0, "me", state=JobState.WAITING_FOR_APPROVAL)
            jobs.add(rows, rows_job)
    return [f"job-{number}" for number in range(count)]


async def test_reader_that_comes_back_again_and_again_misses_no_event_and_no_job(web: Any) -> None:
    dice = random.Random(7)
    names = add_jobs(web, 4)
    count = 300
    done = asyncio.Event()

    async def life() -> None:
        for number in range(count):
            happen(web, seen=dice.random() < 0.8)
            if number % 5 == 0:
                name = dice.choice(names)
                with web.service.store.write() as rows:
                    jobs.change(rows, name, why=f"change {number}")
                web.service.feed.take_job(name)
            if number % 40 == 39:
                web.service.feed.look_in_store()  # the link to the cell process is back
            await asyncio.sleep(0)
        web.service.feed.look_in_store()
        done.set()

    told: list[int] = []
    whys: dict[str, str] = {}
    last = "0-0"
    running = asyncio.create_task(life())
    while len(told) < count or not done.is_set() or last.partition("-")[2] != str((await mail.newest(web.service))[1]):
        async with connected(web, last) as reader:
            for _ in range(dice.randrange(1, 30)):
                if told and len(told) >= count and done.is_set() and last.partition("-")[2] == str((await mail.newest(web.service))[1]):
                    break
                message = await reader.next()
                if message["event"] == "event":
                    told.append(message["data"]["event"]["seq"])
                elif message["event"] == "job":
                    whys[message["data"]["job"]["id"]] = message["data"]["job"]["why"]
                last = message["id"] or last
    await running
    assert told == list(range(1, count + 1)), "every event once, in order"
    with web.service.store.read() as rows:
        assert whys == {name: jobs.get(rows, name).why for name in names}, "every job as it is now"


async def test_stream_sends_the_newest_snapshot_without_a_number_to_go_on_from(web: Any) -> None:
    async with connected(web, query="") as reader:
        while not len(web.service.feed):
            await asyncio.sleep(0)
        for number in (1, 2, 3):
            web.service.feed.take_snapshot(Snapshot(seq=number, at=1.0, cell="c", mode="sim", state="IDLE", execution="READY"))
        message = await reader.next()
        assert (message["event"], message["id"], message["data"]["snapshot"]["seq"]) == ("snapshot", None, 3)


async def test_silence_is_told_with_the_numbers_to_go_on_from(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mail, "HEARTBEAT_S", 0.02)
    happen(web, seen=False)
    async with connected(web) as reader:
        message = await reader.next()
    assert message["event"] == "heartbeat" and (message["data"]["seq"], message["data"]["change"]) == (1, 0)


async def test_number_that_is_not_reached_yet_means_now(web: Any) -> None:
    happen(web, seen=False)
    async with connected(web, "900-900") as reader:
        while not reader.begins_at:
            await asyncio.sleep(0)
        happen(web, seen=True)
        assert (await reader.next())["data"]["event"]["seq"] == 2


async def test_reader_that_takes_nothing_is_given_up_without_harm_to_others(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mail, "SEND_S", 0.1)
    stuck = asyncio.Event()

    async def no_end() -> dict[str, Any]:
        await asyncio.sleep(WAIT_S)
        return {"type": "http.disconnect"}

    async def never(message: Message) -> None:
        if message["type"] == "http.response.body":
            stuck.set()
            await asyncio.sleep(WAIT_S)

    request = type("Asked", (), {"headers": {}, "cookies": {}, "client": None})()
    answer = EventStream(request, web.service, 0, 0, snapshots=True)
    given_up = asyncio.create_task(answer({"type": "http"}, no_end, never))
    await stuck.wait()
    async with connected(web, "0-0") as reader:
        happen(web, seen=True)
        assert (await reader.next())["data"]["event"]["seq"] == 1
        async with asyncio.timeout(WAIT_S):
            await given_up
        assert len(web.service.feed) == 1


async def test_reader_far_behind_is_ended_and_comes_back_for_the_rest(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feed, "EVENTS_QUEUED_MAX", 3)
    async with connected(web, "0-0") as reader:
        while not len(web.service.feed):
            await asyncio.sleep(0)
        for _ in range(8):
            happen(web, seen=True)
        seen = []
        while (message := await asyncio.wait_for(reader.messages.get(), WAIT_S)) is not None:
            seen.append(message["data"]["event"]["seq"])
    async with connected(web, f"{seen[-1] if seen else 0}-0") as reader:
        while seen[-1:] != [8]:
            seen.append((await reader.next())["data"]["event"]["seq"])
    assert seen == list(range(1, 9))


@pytest.mark.parametrize("last", ["x", "1-2-3", "-1", "9" * 30])
async def test_place_that_the_stream_never_named_is_refused(web: Any, last: str) -> None:
    answer: httpx.Response = await web.viewer.get(STREAM, headers={"Last-Event-ID": last})
    assert answer.status_code == 422 and answer.headers["content-type"] == "application/problem+json"
    assert (await web.nobody.get(STREAM)).status_code == 401
