"""Our line protocol against recorded exchanges of real grbl 1.1 and grblHAL, whole and in pieces; plain rules say what must come of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from random import Random
from typing import TypeVar

import pytest

from drivers.cnc.events import (
    AlarmRaised,
    CncEvent,
    LineAccepted,
    LineRejected,
    Message,
    ProtocolFault,
    Status,
    StatusReport,
    Welcome,
)
from drivers.cnc.identity import read_identity
from drivers.cnc.protocol import Answer, GrblProtocol
from tests.wire.recordings import REAL_TIME, Exchange, exchanges, is_damaged, read_plainly

Event = TypeVar("Event")
RECORDED = exchanges()
NUMBER = re.compile(r"N(\d+)")
NAMES = [exchange.name for exchange in RECORDED]


def as_it_came(data: bytes) -> Iterator[bytes]:
    yield data


def at_random(data: bytes) -> Iterator[bytes]:
    random, start = Random(len(data)), 0
    while start < len(data):
        size = random.choice((1, 1, 2, 3, 5, 8, 13, 40, 200))
        yield data[start : start + size]
        start += size


CHUNKINGS: list[Callable[[bytes], Iterator[bytes]]] = [as_it_came, at_random]


class Replay:
    """One exchange through the protocol class: our side's lines as they went, the far end's bytes cut as asked."""

    def __init__(self, exchange: Exchange, cut: Callable[[bytes], Iterator[bytes]]) -> None:
        self.protocol = GrblProtocol(exchange.letters, 1 << 20)
        self.events: list[CncEvent] = []
        self.sent: list[tuple[str, Answer | None]] = []
        half, came = b"", b""
        for at, from_firmware, data in exchange.steps:
            if from_firmware:
                came += data
                continue
            self._receive(came, cut, at)
            came = b""
            *whole, half = (half + bytes(byte for byte in data if byte not in REAL_TIME)).split(b"\n")
            for line in whole:
                self._send(line.decode("latin-1"))
        self._receive(came, cut, exchange.steps[-1][0])

    def _send(self, line: str) -> None:
        match = NUMBER.match(line)
        answer = None if match else Answer()
        self.protocol.begin(int(match[1]) if match else 0, line, len(line) + 1, answer)
        self.protocol.finish()
        self.sent.append((line, answer))

    def _receive(self, data: bytes, cut: Callable[[bytes], Iterator[bytes]], at: float) -> None:
        for chunk in cut(data):
            self.events += self.protocol.receive(chunk, at)

    def of(self, kind: type[Event]) -> list[Event]:
        """Events of one kind."""
        return [event for event in self.events if isinstance(event, kind)]


@pytest.fixture(scope="module", params=CHUNKINGS, ids=lambda cut: cut.__name__)
def replayed(request: pytest.FixtureRequest) -> dict[str, Replay]:
    return {exchange.name: Replay(exchange, request.param) for exchange in RECORDED}


def test_there_are_exchanges_with_both_firmwares() -> None:
    streams = {"identify", "stream", "hold", "override", "error", "settings_refused", "overflow"}
    kinds = streams | {"alarm", "reset", "reset_held", "jog", "homing", "lines"}
    for firmware in ("grbl", "grblhal"):
        assert kinds <= {each.name.partition("_")[2] for each in RECORDED if each.firmware == firmware}


@pytest.mark.parametrize("exchange", RECORDED, ids=NAMES)
def test_every_answer_frees_the_oldest_line_and_what_stays_open_is_counted(
    exchange: Exchange, replayed: dict[str, Replay]
) -> None:
    replay, told = replayed[exchange.name], read_plainly(exchange)
    commands = [(line, answer) for line, answer in replay.sent if answer is not None]
    accepted = [line for line, answer in commands if answer.done and answer.code == 0]
    refused = [(line, answer.code) for line, answer in commands if answer.done and answer.code]
    assert accepted == [line for line in told.accepted if not NUMBER.match(line)]
    assert refused == [(line, code) for line, code in told.refused if not NUMBER.match(line)]
    assert replay.protocol.unanswered_bytes == told.open_bytes
    lost = sum(answer.is_lost for _, answer in commands)
    assert lost <= sum(told.forgotten)


@pytest.mark.parametrize("exchange", RECORDED, ids=NAMES)
def test_lines_of_a_program_are_accepted_in_order_up_to_the_first_that_was_refused(
    exchange: Exchange, replayed: dict[str, Replay]
) -> None:
    replay, told = replayed[exchange.name], read_plainly(exchange)
    numbers = [int(match[1]) for line in told.accepted if (match := NUMBER.match(line))]
    bad = [(int(match[1]), code) for line, code in told.refused if (match := NUMBER.match(line))]
    rejected = [(event.n, event.code) for event in replay.of(LineRejected)]
    assert rejected[:1] == bad[:1]
    came = [event.n for event in replay.of(LineAccepted)]
    if not bad:
        assert came == numbers
    else:
        assert came == [n for n in numbers if n < bad[0][0]] or len(told.banners) > 1
        assert not [n for n in came if n == bad[0][0]]


@pytest.mark.parametrize("exchange", RECORDED, ids=NAMES)
def test_alarms_banners_messages_and_answers_to_nothing_are_told_once_each(
    exchange: Exchange, replayed: dict[str, Replay]
) -> None:
    replay, told = replayed[exchange.name], read_plainly(exchange)
    assert [event.code for event in replay.of(AlarmRaised)] == told.alarms
    assert [(event.banner, event.forgotten) for event in replay.of(Welcome)] == list(
        zip(told.banners, told.forgotten, strict=True)
    )
    unread = [event for event in replay.of(Message) if "settings could not be read" in event.text]  # `error:7` before the first banner
    assert len(unread) <= 1
    assert [event.text for event in replay.of(Message) if event not in unread] == told.messages
    faults = replay.of(ProtocolFault)
    assert sum(event.garbled for event in faults) <= sum(map(is_damaged, told.reports))
    assert sum(not event.garbled for event in faults) + len(unread) == told.nothing


@pytest.mark.parametrize("exchange", RECORDED, ids=NAMES)
def test_status_reports_say_what_their_text_says(exchange: Exchange, replayed: dict[str, Replay]) -> None:
    replay, told = replayed[exchange.name], read_plainly(exchange)
    came = [
        event
        for event in replay.events
        if isinstance(event, StatusReport) or (isinstance(event, ProtocolFault) and event.garbled)
    ]
    assert len(came) == len(told.reports)
    for event, text in zip(came, told.reports, strict=True):
        if not is_damaged(text):
            assert isinstance(event, StatusReport)
            assert_same(event.status, text, exchange.letters)


def assert_same(status: Status, text: str, letters: tuple[str, ...]) -> None:
    """One report against its text."""
    place = re.search(r"MPos:([-\d.,]+)", text)
    assert place is not None
    assert list(status.machine.values()) == [float(value) for value in place[1].split(",")]
    assert tuple(status.machine) == letters
    state = re.match(r"<(\w+)(?::(\d+))?", text)
    assert state is not None and (status.state, status.substate) == (state[1], int(state[2]) if state[2] else None)
    line = re.search(r"\bLn:(\d+)", text)
    assert status.line == (int(line[1]) if line else None)
    free = re.search(r"Bf:(\d+),(\d+)", text)
    assert (status.planner_free, status.rx_free) == ((int(free[1]), int(free[2])) if free else (None, None))
    speed = re.search(r"FS:([\d.]+),", text)
    assert speed is not None and status.feed_mm_min == float(speed[1])
    if overrides := re.search(r"Ov:(\d+),(\d+),(\d+)", text):
        assert status.overrides == tuple(map(int, overrides.groups()))
    if offset := re.search(r"WCO:([-\d.,]+)", text):
        assert list(status.wco.values()) == [float(value) for value in offset[1].split(",")]
    pins = re.search(r"Pn:(\w+)", text)
    assert status.pins == (pins[1] if pins else "")


@pytest.mark.parametrize(
    ("name", "rx_bytes", "letters"), [("grblhal_identify", 1024, ("X", "Y", "Z", "A", "C")), ("grbl_identify", 128, ())]
)
def test_the_firmware_is_known_by_its_answers(
    name: str, rx_bytes: int, letters: tuple[str, ...], replayed: dict[str, Replay]
) -> None:
    replay = replayed[name]
    lines = [
        line for text, answer in replay.sent if answer is not None and text.startswith("$I") for line in answer.lines
    ]
    identity = read_identity(lines, replay.protocol.banner, "recorded")
    assert (identity.firmware, identity.rx_bytes, identity.letters) == (name.partition("_")[0], rx_bytes, letters)
    settings = next(answer for text, answer in replay.sent if text == "$$" and answer is not None)
    assert "$11=0.010" in settings.lines and settings.done


def test_an_error_does_not_stop_grbl_but_latches_grblhal() -> None:
    recorded = {exchange.name: read_plainly(exchange) for exchange in RECORDED}
    grbl, hal = recorded["grbl_error"], recorded["grblhal_error"]
    first = next(k for k, (line, _) in enumerate(grbl.refused) if line.startswith("N20"))
    assert any(line.startswith("N21 ") for line in grbl.accepted) and len(grbl.refused) <= first + 4
    behind = [line for line, _ in hal.refused]
    assert "N21" in {line.split()[0] for line in behind} and not any(line.startswith("N21 ") for line in hal.accepted)
    assert any(line.startswith("N41 ") for line in hal.accepted)  # after an empty line
