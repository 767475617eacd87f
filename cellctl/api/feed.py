"""What every live viewer gets: the newest snapshot (encoded once), events in order, and word of changed jobs."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec

from cellctl.domain.messages import Event
from cellctl.domain.snapshot import Snapshot

EVENTS_QUEUED_MAX = 5000  # a viewer further behind is cut off; it comes back with `from`
_encoder = msgspec.json.Encoder()


def event_document(event: Event) -> dict[str, object]:
    """An event as it is sent."""
    return {
        "seq": event.seq,
        "at": event.at,
        "kind": event.kind,
        "text": event.text,
        "job": event.job,
        "data": event.data,
    }


def event_text(event: Event) -> str:
    """An event's message."""
    return _encoder.encode({"type": "event", "event": event_document(event)}).decode()


class Viewer:
    """One connection's mail: events in order, word of changed jobs, at most one snapshot.

    jobs : those on which work went on; has_jobs : some were changed; has_missed : there may be events in the store that did not come by
    """

    def __init__(self) -> None:
        self.events: deque[Event] = deque()
        self.jobs: dict[str, None] = {}
        self.has_snapshot = False
        self.has_jobs = False
        self.has_missed = False
        self.is_behind = False
        self.wake = asyncio.Event()


class Feed:
    """Hands snapshots, events and job changes to all viewers."""

    def __init__(self) -> None:
        self._viewers: set[Viewer] = set()
        self._text: str | None = None
        self._snapshot: Snapshot | None = None
        self.last_change = 0  # number of the newest change to a job that was read: what came later is told to a viewer that comes now

    @contextmanager
    def viewer(self) -> Iterator[Viewer]:
        """A viewer, for as long as the block lasts."""
        viewer = Viewer()
        self._viewers.add(viewer)
        try:
            yield viewer
        finally:
            self._viewers.discard(viewer)

    def __len__(self) -> int:
        return len(self._viewers)

    @property
    def snapshot_text(self) -> str | None:
        """The newest snapshot's message; encoded when the first viewer asks."""
        if self._text is None and self._snapshot is not None:
            self._text = _encoder.encode({"type": "snapshot", "snapshot": self._snapshot}).decode()
        return self._text

    def take_snapshot(self, snapshot: Snapshot) -> None:
        """Newest wins."""
        self._snapshot, self._text = snapshot, None
        for viewer in self._viewers:
            viewer.has_snapshot = True
            viewer.wake.set()

    def take_event(self, event: Event) -> None:
        """In order, none left out; a viewer that is cut off gets no more, and what waited for it is let go."""
        for viewer in self._viewers:
            if viewer.is_behind or len(viewer.events) >= EVENTS_QUEUED_MAX:
                viewer.is_behind = True
                viewer.events.clear()
            else:
                viewer.events.append(event)
            viewer.wake.set()

    def take_job(self, job_id: str) -> None:
        """A job changed; each viewer reads it once however often that was."""
        for viewer in self._viewers:
            viewer.jobs[job_id] = None
            viewer.has_jobs = True
            viewer.wake.set()

    def look_in_store(self) -> None:
        """The cell process was away: what it wrote meanwhile is in the store and came by nobody."""
        for viewer in self._viewers:
            viewer.has_missed = True
            viewer.wake.set()
