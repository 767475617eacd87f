"""The event loop that serves one line between its rounds: at the line's own time, without losing what else is ready."""

from __future__ import annotations

import asyncio
import os
import selectors
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from drivers.transport.line_loop import LineLoop, LineSelector, Served

SOON_S = 0.02
LATE_S = 0.2  # a loaded machine's own


@dataclass
class Line:
    """What a selector serves, written down. hands_on : whether write and read leave something to the event loop"""

    selector: LineSelector
    port: int | None = None
    hands_on: bool = False
    writes: list[float] = field(default_factory=list)
    read_bytes: bytes = b""
    errors: list[Exception] = field(default_factory=list)
    broken: str = ""

    def serve(self, due_s: float, *, is_patient: bool = False) -> Served:
        served = Served(self.port, self.read, self.write, self.errors.append, time.monotonic() + due_s, is_patient)
        self.selector.serve(served)
        self.served = served
        return served

    def write(self) -> bool:
        self.writes.append(time.monotonic())
        self.served.due_at = float("inf")
        if self.broken:
            raise OSError(self.broken)
        return self.hands_on

    def read(self) -> bool:
        assert self.port is not None
        self.read_bytes += os.read(self.port, 100)
        return self.hands_on


@pytest.fixture
def selector() -> Iterator[LineSelector]:
    with LineSelector() as one:
        yield one


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        try:
            os.close(end)
        except OSError:
            continue


def test_a_write_goes_at_its_time_within_a_longer_wait_that_is_waited_out(selector: LineSelector) -> None:
    line = Line(selector)
    due_at = line.serve(SOON_S).due_at
    began = time.monotonic()
    assert selector.select(3 * SOON_S) == []
    assert len(line.writes) == 1 and 0.0 <= line.writes[0] - due_at < LATE_S
    assert time.monotonic() - began >= 3 * SOON_S


def test_a_write_that_leaves_something_to_the_loop_ends_the_wait_at_once(selector: LineSelector) -> None:
    line = Line(selector, hands_on=True)
    line.serve(SOON_S)
    began = time.monotonic()
    assert selector.select(60.0) == []
    assert SOON_S <= time.monotonic() - began < 1.0 and len(line.writes) == 1


def test_bytes_are_read_as_they_come_and_the_loop_is_not_woken_for_them(selector: LineSelector, pipe: tuple[int, int]) -> None:
    line = Line(selector, pipe[0])
    line.serve(SOON_S)
    os.write(pipe[1], b"ok\n")
    assert selector.select(2 * SOON_S) == []
    assert line.read_bytes == b"ok\n" and len(line.writes) == 1


def test_bytes_wait_for_the_write_that_is_due_where_the_line_is_patient(selector: LineSelector, pipe: tuple[int, int]) -> None:
    line = Line(selector, pipe[0])
    line.serve(SOON_S, is_patient=True)
    os.write(pipe[1], b"ok\n")
    selector.select(2 * SOON_S)
    assert line.read_bytes == b"" and len(line.writes) == 1
    assert os.read(pipe[0], 10) == b"ok\n"


def test_what_else_is_ready_is_told_while_a_line_is_served(selector: LineSelector, pipe: tuple[int, int]) -> None:
    line = Line(selector)
    line.serve(60.0)
    selector.register(pipe[0], selectors.EVENT_READ, "other")
    os.write(pipe[1], b"x")
    ready = selector.select(60.0)
    assert [(key.data, mask) for key, mask in ready] == [("other", selectors.EVENT_READ)] and not line.writes


def test_a_port_that_was_closed_meanwhile_is_let_go_and_the_rest_goes_on(selector: LineSelector, pipe: tuple[int, int]) -> None:
    line = Line(selector, pipe[0])
    line.serve(SOON_S)
    os.close(pipe[0])
    assert selector.select(2 * SOON_S) == []
    assert line.served.port is None and len(line.writes) == 1 and not line.errors


def test_a_write_that_fails_is_told_once_and_the_line_is_served_no_more(selector: LineSelector) -> None:
    line = Line(selector, broken="it was unplugged")
    line.serve(0.0)
    assert selector.select(0.0) == []
    assert [str(error) for error in line.errors] == ["it was unplugged"] and not selector.is_serving
    assert selector.select(0.0) == [] and len(line.writes) == 1


def test_timers_and_tasks_of_the_loop_go_on_while_a_line_is_served(pipe: tuple[int, int]) -> None:
    loop = LineLoop()
    line = Line(loop.line_selector, pipe[0])

    async def both() -> str:
        line.serve(SOON_S)
        os.write(pipe[1], b"ok\n")
        await asyncio.sleep(2 * SOON_S)
        return await loop.run_in_executor(None, lambda: "from a thread")  # wakes the loop by its own pipe

    try:
        assert loop.run_until_complete(both()) == "from a thread"
        loop.run_until_complete(loop.shutdown_default_executor())
    finally:
        loop.close()
    assert line.read_bytes == b"ok\n" and len(line.writes) == 1
