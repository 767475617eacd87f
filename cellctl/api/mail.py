"""What one live viewer is told, whichever wire it is on: what was missed first, then what comes, each thing once and in order."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Literal

import msgspec

from cellctl.api import jobs as job_routes
from cellctl.api.context import Service
from cellctl.api.feed import Viewer, event_text
from cellctl.api.shared_reads import AwayError, read_shared
from cellctl.domain.messages import Event
from cellctl.store import changes, history, jobs
from cellctl.store.parts import NotFoundError

REPLAY_PAGE = 500  # events read at once
JOBS_PAGE = 50
HEARTBEAT_S = 3.0  # of silence, after which a viewer is told that there is nothing to tell
CHECK_SIGN_IN_S = 10.0
SEND_S = 10.0  # a viewer that takes a message no sooner is given up: it comes back and is told what it missed
Kind = Literal["snapshot", "event", "job", "heartbeat"]


@dataclass(frozen=True)
class Mail:
    """One message. text : JSON; seq, change : numbers of the last event and the last change to a job that are told with it"""

    kind: Kind
    text: str
    seq: int
    change: int

    @property
    def place(self) -> str:
        """Where to go on after this one."""
        return f"{self.seq}-{self.change}"


class Ended(Exception):
    """No more mail. because : `behind` (come back and go on where you were) or `signed out`"""

    def __init__(self, because: Literal["behind", "signed out"]) -> None:
        super().__init__(because)
        self.because = because


async def newest(service: Service) -> tuple[int, int]:
    """Numbers of the newest event and of the newest change to a job; of the one that was heard of last where a shared database is away."""

    def last_seq() -> int:
        with service.store.read_cell() as cell_rows:
            return history.last_seq(cell_rows)

    def last_change() -> int:
        with service.store.read() as rows:
            return changes.last_change(rows)

    seq = await asyncio.to_thread(last_seq)
    with suppress(AwayError):
        service.feed.last_change = await read_shared(service, last_change)
    return seq, service.feed.last_change


class Postman:
    """Brings a viewer its mail. seq, change : what it knows already; is_let_in : whether its sign-in still holds (may block)

    Iterate over `mail`; it ends by Ended only. What comes twice (replayed and live) is told once, by its number.
    """

    def __init__(self, service: Service, viewer: Viewer, seq: int, change: int, is_let_in: Callable[[], bool]) -> None:
        self._service = service
        self._viewer = viewer
        self._seq = seq
        self._change = change
        self._is_let_in = is_let_in
        self._checked = time.monotonic()

    @property
    def place(self) -> str:
        """What is known so far, to go on from."""
        return f"{self._seq}-{self._change}"

    async def mail(self) -> AsyncIterator[Mail]:
        """All messages, for ever. Raises Ended."""
        viewer = self._viewer
        viewer.has_missed = viewer.has_jobs = True  # what is in the store already
        while True:
            if viewer.is_behind:
                raise Ended("behind")
            viewer.wake.clear()
            if viewer.has_missed:
                viewer.has_missed = False
                async for one in self._stored(None):
                    yield one
            while viewer.events:
                event = viewer.events.popleft()
                if event.seq > self._seq + 1:
                    async for one in self._stored(event.seq):
                        yield one
                if event.seq > self._seq:
                    yield self._event(event)
            if viewer.has_jobs:
                async for one in self._jobs():
                    yield one
            if viewer.has_snapshot and self._service.feed.snapshot_text is not None:
                viewer.has_snapshot = False
                yield self._mail("snapshot", self._service.feed.snapshot_text)
            await self._check_sign_in()
            if not await self._wait():
                beat = {"type": "heartbeat", "at": self._service.store.clock(), "seq": self._seq, "change": self._change}
                yield self._mail("heartbeat", msgspec.json.encode(beat).decode())

    def _mail(self, kind: Kind, text: str) -> Mail:
        return Mail(kind, text, self._seq, self._change)

    def _event(self, event: Event) -> Mail:
        self._seq = event.seq
        return self._mail("event", event_text(event))

    async def _stored(self, before: int | None) -> AsyncIterator[Mail]:
        """The events of the store that follow, up to that number."""

        def page() -> list[Event]:
            with self._service.store.read_cell() as rows:
                return history.events_after(rows, self._seq, REPLAY_PAGE)

        while events := await asyncio.to_thread(page):
            for event in events:
                if before is not None and event.seq >= before:
                    return
                yield self._event(event)

    async def _jobs(self) -> AsyncIterator[Mail]:
        """Every job that was changed since, and those on which only the work went on; later, if a shared database is away."""
        viewer = self._viewer
        viewer.has_jobs = False
        at_work, viewer.jobs = viewer.jobs, {}
        try:
            async for one in self._changed_jobs(at_work):
                yield one
        except AwayError:
            viewer.has_jobs, viewer.jobs = True, {**at_work, **viewer.jobs}

    async def _changed_jobs(self, at_work: Iterable[str]) -> AsyncIterator[Mail]:
        """Raises AwayError."""

        def changed() -> list[tuple[str, int]]:
            with self._service.store.read() as rows:
                return changes.changed_since(rows, self._change)

        feed = self._service.feed
        due = await read_shared(self._service, changed)
        known = {job_id for job_id, _ in due}
        due += [(job_id, self._change) for job_id in at_work if job_id not in known]
        for start in range(0, len(due), JOBS_PAGE):
            page = due[start : start + JOBS_PAGE]
            for text, change in await read_shared(self._service, partial(self._job_texts, page)):
                self._change = max(self._change, change)
                feed.last_change = max(feed.last_change, change)
                if text is not None:
                    yield self._mail("job", text)

    def _job_texts(self, page: list[tuple[str, int]]) -> list[tuple[str | None, int]]:
        texts: list[tuple[str | None, int]] = []
        with self._service.store.read() as rows:
            for job_id, change in page:
                try:
                    job = job_routes.document(self._service, jobs.get(rows, job_id), rows)
                except NotFoundError:
                    texts.append((None, change))
                    continue
                told = {"type": "job", "change": max(change, self._change), "job": job.model_dump(mode="json")}
                texts.append((msgspec.json.encode(told).decode(), change))
        return texts

    async def _check_sign_in(self) -> None:
        if time.monotonic() - self._checked > CHECK_SIGN_IN_S:
            self._checked = time.monotonic()
            with suppress(AwayError):  # who was let in stays so meanwhile
                if not await read_shared(self._service, self._is_let_in):
                    raise Ended("signed out")

    async def _wait(self) -> bool:
        """Until there is mail; False if there was none for HEARTBEAT_S."""
        try:
            async with asyncio.timeout(HEARTBEAT_S):
                await self._viewer.wake.wait()
        except TimeoutError:
            return False
        return True
