from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import insert
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Settings
from cellctl.api.feed import EVENTS_QUEUED_MAX, Feed
from cellctl.domain.messages import Event
from cellctl.domain.snapshot import Snapshot
from cellctl.store import Store, tokens
from cellctl.store.schema import events
from cellctl.store.tokens import Role
from config import find_facts

LIVE = "ws://127.0.0.1:8000/api/v1/live"


@pytest.fixture
def live(tmp_path: Path, store: Store) -> Iterator[tuple[TestClient, Any, dict[str, str]]]:
    with store.write() as rows:
        _, secret = tokens.create(rows, "me", Role.VIEWER, store.clock())
    with store.write_cell() as rows:
        for number in range(1, 8):
            rows.execute(insert(events).values(at=float(number), kind="state", text=f"event {number}"))
    service = build_service(Settings(tmp_path / "store", tmp_path / "run", find_facts("cells", "trunnion_tcp")))
    with TestClient(make_app(service, "127.0.0.1"), base_url="http://127.0.0.1:8000") as client:
        yield client, service, {"Authorization": f"Bearer {secret}"}


def event(number: int) -> Event:
    return Event(seq=number, at=1.0, kind="state", text=f"event {number}")


def test_events_are_replayed_from_a_number_on_without_gap_or_double(live: Any) -> None:
    client, service, headers = live
    with client.websocket_connect(f"{LIVE}?from=3", headers=headers) as socket:
        assert [socket.receive_json()["event"]["seq"] for _ in range(4)] == [4, 5, 6, 7]
        for number in (6, 7, 8):  # those that were replayed come again from the cell process
            client.portal.call(service.feed.take_event, event(number))
        assert socket.receive_json()["event"]["seq"] == 8


def test_newest_snapshot_wins(live: Any) -> None:
    client, service, headers = live

    def three() -> None:
        for number in (1, 2, 3):
            service.feed.take_snapshot(
                Snapshot(seq=number, at=1.0, cell="c", mode="sim", state="IDLE", execution="READY")
            )

    with client.websocket_connect(f"{LIVE}", headers=headers) as socket:
        client.portal.call(three)
        message = socket.receive_json()
        assert message["type"] == "snapshot" and message["snapshot"]["seq"] == 3


@pytest.mark.parametrize("headers", [{}, {"Authorization": "Bearer wrong"}])
def test_live_feed_needs_a_sign_in(live: Any, headers: dict[str, str]) -> None:
    client, _service, _headers = live
    with pytest.raises(WebSocketDisconnect), client.websocket_connect(f"{LIVE}", headers=headers):
        pass


def test_live_feed_refuses_pages_of_other_origins(live: Any) -> None:
    client, _service, headers = live
    with (
        pytest.raises(WebSocketDisconnect),
        client.websocket_connect(f"{LIVE}", headers={**headers, "Origin": "http://evil.example"}),
    ):
        pass


async def test_viewer_that_never_reads_is_marked_and_delays_nobody() -> None:
    feed = Feed()
    with feed.viewer() as slow, feed.viewer() as quick:
        for number in range(EVENTS_QUEUED_MAX + 1):
            feed.take_event(event(number))
            quick.events.clear()
        assert slow.is_behind and not quick.is_behind
        assert not slow.events, "what waited for a viewer that is cut off is let go"
        await asyncio.wait_for(quick.wake.wait(), 60.0)
    assert len(feed) == 0
