"""STOP over HTTP without the web process."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator

import pytest

from cellctl.cell.stop_listener import CONNECTIONS_MAX, StopListener

WAIT_S = 60.0


class Listening:
    def __init__(self) -> None:
        self.stops: list[tuple[str, str, str]] = []
        self.state = "RUNNING"
        self.listener = StopListener(self.stop, lambda: self.state, "127.0.0.1")
        self.port = 0

    async def stop(self, ident: str, who: str, because: str) -> str:
        self.stops.append((ident, who, because))
        self.state = "STOPPED"
        return self.state

    async def ask(self, request: bytes) -> tuple[int, dict[str, str], dict[str, str]]:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        writer.write(request)
        answer = await asyncio.wait_for(reader.read(), WAIT_S)
        writer.close()
        await writer.wait_closed()
        head, _, body = answer.partition(b"\r\n\r\n")
        first, *lines = head.decode().split("\r\n")
        headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in lines)}
        return int(first.split()[1]), headers, json.loads(body) if body else {}


@pytest.fixture
async def listening() -> AsyncIterator[Listening]:
    one = Listening()
    one.port = await one.listener.start(0)
    yield one
    await one.listener.close()


def post(body: bytes, origin: str = "") -> bytes:
    extra = f"Origin: {origin}\r\n" if origin else ""
    return f"POST /stop HTTP/1.1\r\nHost: 127.0.0.1:1\r\n{extra}Content-Length: {len(body)}\r\n\r\n".encode() + body


async def test_a_post_stops_and_answers_the_state(listening: Listening) -> None:
    status, _, body = await listening.ask(post(b'{"id": "s1", "because": "smoke"}'))
    assert (status, body) == (200, {"state": "STOPPED"})
    assert listening.stops[0][0] == "s1" and listening.stops[0][2] == "smoke"


@pytest.mark.parametrize("body", [b"", b"not json", b"[1]", b'{"id": null}', b"[" * 4000, b"\xff"])
async def test_a_stop_with_an_unreadable_body_stops_all_the_same(listening: Listening, body: bytes) -> None:
    status, _, _ = await listening.ask(post(body))
    assert status == 200
    assert len(listening.stops) == 1


async def test_the_consoles_origin_is_allowed_and_a_strangers_is_not(listening: Listening) -> None:
    _, own, _ = await listening.ask(post(b"{}", "http://127.0.0.1:8000"))
    assert own["access-control-allow-origin"] == "http://127.0.0.1:8000"
    _, other, _ = await listening.ask(post(b"{}", "http://evil.example"))
    assert "access-control-allow-origin" not in other
    status, preflight, _ = await listening.ask(
        b"OPTIONS /stop HTTP/1.1\r\nHost: 127.0.0.1:1\r\nOrigin: http://localhost:8000\r\n\r\n"
    )
    assert status == 204 and "POST" in preflight["access-control-allow-methods"]


async def test_a_page_of_another_host_of_the_house_may_read_the_answer_once_the_listener_was_told_of_it(listening: Listening) -> None:
    page = "http://north.example:8000"
    assert "access-control-allow-origin" not in (await listening.ask(post(b"{}", page)))[1]
    listening.listener.allow_pages(frozenset({"north.example"}))
    assert (await listening.ask(post(b"{}", page)))[1]["access-control-allow-origin"] == page
    assert "access-control-allow-origin" not in (await listening.ask(post(b"{}", "http://north.example.evil")))[1]


async def test_health_tells_the_state(listening: Listening) -> None:
    status, _, body = await listening.ask(b"GET /healthz HTTP/1.1\r\n\r\n")
    assert (status, body) == (200, {"state": "RUNNING"})


@pytest.mark.parametrize(
    ("request_bytes", "status"),
    [(b"GET /stop HTTP/1.1\r\n\r\n", 405), (b"GET /other HTTP/1.1\r\n\r\n", 404), (b"rubbish\r\n\r\n", 400),
     (b"POST /stop HTTP/1.1\r\nContent-Length: 99999\r\n\r\n", 413), (b"POST /stop HTTP/1.1\r\nContent-Length: x\r\n\r\n", 400),
     (b"GET / HTTP/1.1\r\nX: " + b"y" * 20000 + b"\r\n\r\n", 431)],
)  # fmt: skip
async def test_what_is_no_stop_is_refused_and_stops_nothing(
    listening: Listening, request_bytes: bytes, status: int
) -> None:
    assert (await listening.ask(request_bytes))[0] == status
    assert listening.stops == []


async def test_half_a_character_in_a_reason_can_still_be_written_down(listening: Listening) -> None:
    status, _, _ = await listening.ask(post(b'{"id": "\\ud800", "because": "\\udfff!"}'))
    assert status == 200
    assert all(word.encode() for word in listening.stops[0])


@pytest.mark.parametrize(
    "head",
    [b"Content-Length: \xb2", b"Content-Length: " + b"9" * 5000, b"Content-Length: -1", b"Origin: http://["],
)
async def test_a_malformed_header_is_answered_and_raises_nothing(
    listening: Listening, head: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    status, _, _ = await listening.ask(b"POST /stop HTTP/1.1\r\nHost: x\r\n" + head + b"\r\n\r\n")
    assert status in (200, 400, 413)
    assert not caplog.records


async def test_connections_that_say_nothing_never_keep_a_stop_out(listening: Listening) -> None:
    idle = [await asyncio.open_connection("127.0.0.1", listening.port) for _ in range(CONNECTIONS_MAX + 10)]
    status, _, _ = await listening.ask(post(b"{}"))
    assert status == 200 and len(listening.stops) == 1
    assert len(listening.listener.waiting) <= CONNECTIONS_MAX
    assert await asyncio.wait_for(idle[0][0].read(), WAIT_S) == b"", "the oldest that says nothing gives way"
    for _, writer in idle:
        writer.close()


async def test_a_listener_for_other_machines_is_reached_from_this_one_too() -> None:
    one = Listening()
    one.listener = StopListener(one.stop, lambda: one.state, "127.0.0.2")
    one.port = await one.listener.start(0)
    status, _, _ = await one.ask(post(b"{}"))
    await one.listener.close()
    assert status == 200 and len(one.stops) == 1
