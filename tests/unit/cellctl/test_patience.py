"""Clients that trickle, flood or say rubbish at the real wires: they are ended, hold nobody else up, and STOP and GET go on."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from cellctl.api import live, security, wire
from tests.unit.cellctl.served_by_thread import AtPort, at_port

ENDED_S = 20.0
MANY = 60


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> Iterator[AtPort]:
    with at_port(tmp_path_factory.mktemp("patience"), empty_store) as found:
        yield found


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Patience in tenths of seconds."""
    monkeypatch.setattr(wire, "HEAD_S", 0.5)
    monkeypatch.setattr(security, "BODY_S", 0.6)


def opened(served: AtPort) -> socket.socket:
    address = httpx.URL(served.url)
    return socket.create_connection((address.host, address.port or 80), timeout=ENDED_S)


def trickled(line: socket.socket, text: bytes, gap_s: float = 0.05) -> bytes:
    """Say a text byte by byte until the other side ends it; what it said."""
    line.settimeout(gap_s)
    heard, end = b"", time.monotonic() + ENDED_S
    for byte in text:
        try:
            line.sendall(bytes([byte]))
            piece = line.recv(4096)
        except TimeoutError:
            assert time.monotonic() < end, "it is still listened to"
            continue
        except OSError:
            return heard
        heard += piece
        if not piece:
            return heard
    raise AssertionError("all of it was listened to")


@pytest.mark.usefixtures("hasty")
def test_a_head_that_trickles_is_ended(served: AtPort) -> None:
    with opened(served) as line:
        assert trickled(line, b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nX-A: " + b"a" * 400) == b""


@pytest.mark.usefixtures("hasty")
def test_a_body_that_trickles_is_ended_though_no_gap_in_it_is_long(served: AtPort) -> None:
    head = f"POST /api/v1/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {served.token}\r\nContent-Type: application/json\r\n"
    with opened(served) as line:
        line.sendall(f"{head}Content-Length: 5000\r\n\r\n".encode())
        heard = trickled(line, b'{"part_id": "' + b"a" * 400)
    assert heard.startswith(b"HTTP/1.1 408 ") and b"connection: close" in heard.lower()


def test_many_half_requests_at_once_keep_nobody_out(served: AtPort) -> None:
    head = f"HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {served.token}\r\n"
    with ExitStack() as lines:
        for number in range(MANY):
            line = lines.enter_context(opened(served))
            half = f"POST /api/v1/jobs {head}Content-Type: application/json\r\nContent-Length: 5000\r\n\r\n{{" if number % 2 else f"GET / {head}"
            line.sendall(half.encode())
        with httpx.Client(base_url=served.url, headers={"Authorization": f"Bearer {served.token}"}, timeout=ENDED_S) as client:
            assert client.get("/api/v1/jobs").status_code == 200
            stop = client.post("/api/v1/cell/stop", json={"because": "now"})  # no cell is there: it is carried as far as it goes
            assert stop.status_code == 503 and "stop listener" in stop.json()["detail"]


def conversation(served: AtPort) -> ClientConnection:
    url = served.url.replace("http://", "ws://") + "/api/v1/live"
    return connect(url, additional_headers={"Authorization": f"Bearer {served.token}"}, max_size=None)


def code_at_end(line: ClientConnection) -> Any:
    """The code that the service closes with."""
    with pytest.raises(ConnectionClosed) as end:
        while True:
            line.recv(timeout=ENDED_S)
    assert end.value.rcvd is not None, "it was cut off without a word"
    return end.value.rcvd.code


@pytest.mark.parametrize(
    ("said", "code"),
    [("x" * (wire.MESSAGE_BYTES + 1), 1009), ("{no json", live.NO_JSON), ("[" * 30_000, live.NO_JSON), (b"\0\1", live.NO_TEXT)],
)  # fmt: skip
def test_what_a_viewer_may_not_say_ends_its_conversation_with_a_code(served: AtPort, said: str | bytes, code: int) -> None:
    with conversation(served) as line:
        line.send(said)
        assert code_at_end(line) == code


def test_a_flood_ends_its_conversation_and_no_other(served: AtPort) -> None:
    with conversation(served) as other, conversation(served) as line:
        other.send(json.dumps({"say": "something"}))
        try:
            for _ in range(live.SAID_MAX + 200):
                line.send("{}")
        except ConnectionClosed:
            pass
        assert code_at_end(line) == live.TOO_MUCH
        assert json.loads(other.recv(timeout=ENDED_S))["type"] in ("heartbeat", "job", "event", "snapshot")
