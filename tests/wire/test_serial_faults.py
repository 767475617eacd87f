"""What a bad serial line does to a program, by wire: what the far end got, byte for byte, and what is told here."""

from __future__ import annotations

import asyncio
import os
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.cnc.driver import CncDriver
from drivers.cnc.events import AnswerOverdue, CncEvent, PortLost, ProtocolFault
from drivers.errors import PortAbsent
from drivers.transport.serial_port import SerialPort
from tests.unit.drivers.fakes import LETTERS, FakeCnc, cnc_facts, program
from tests.wire.test_serial_wire import LIMIT_S, Line

LINES = 120
OVERDUE_S = 0.3
PAUSE_S = 0.03  # between the two halves of a line
LINE = re.compile(rb"(N\d+[^\n]*)\n")


class Halving(FakeCnc):
    """A firmware whose answers come in two halves with a pause between them, or whose n-th answer is cut short for good."""

    def __init__(self, pause_s: float = 0.0, cut_at: int = 0) -> None:
        super().__init__(line_s=0.001)
        self._pause_s, self._cut_at = pause_s, cut_at
        self._rest, self._due = b"", 0.0
        self._oks = 0

    def transmit(self) -> bytes:
        data = super().transmit()
        self._oks += data.count(b"ok\r\n")
        if self._cut_at and self._oks >= self._cut_at and b"ok\r\n" in data:
            self._cut_at = 0
            return data.replace(b"ok\r\n", b"<Run|MPos:1.0", 1)  # a report that ends in the middle, and an answer that never came
        now = time.monotonic()
        if self._rest or (self._pause_s and data):
            if not self._rest:
                self._due = now + self._pause_s
                self._rest = data[1:]
                return data[:1]
            self._rest += data
            if now < self._due:
                return b""
            data, self._rest = self._rest, b""
        return data


def driver_at(path: str, **facts: object) -> CncDriver:
    return CncDriver(SerialPort(path, 115200), cnc_facts(**facts), LETTERS, SystemClock())


def lines_in(received: bytes) -> list[str]:
    """Lines of the program that arrived whole; real-time bytes among them are none of theirs."""
    return [line.decode() for line in LINE.findall(received.replace(b"?", b"").replace(b"\x87", b""))]


async def streaming(driver: CncDriver, lines: list[str], until: Callable[[], bool], seen: list[CncEvent] | None = None) -> list[CncEvent]:
    """Identify, and stream until something holds; what was told, also in `seen` as it comes."""
    await driver.identify()
    driver.load(lines)
    driver.release(len(lines))
    return await going_on(driver, until, seen)


async def going_on(driver: CncDriver, until: Callable[[], bool], seen: list[CncEvent] | None = None) -> list[CncEvent]:
    events = [] if seen is None else seen
    async with asyncio.timeout(LIMIT_S):
        while not until():
            events += driver.pump()
            await asyncio.sleep(min(0.005, max(0.0005, driver.due_in_s())))
    events += driver.pump()
    return events


@pytest.mark.parametrize("again", ["ttyUSB0", "ttyUSB3"])
async def test_unplugged_and_replugged_also_under_another_name_nothing_of_the_old_program_goes_on(tmp_path: Path, again: str) -> None:
    first, second = Line(FakeCnc(line_s=0.005)), Line(FakeCnc(line_s=0.005))
    pattern, lines = str(tmp_path / "ttyUSB*"), program(LINES)
    (tmp_path / "ttyUSB0").symlink_to(first.path)
    driver = driver_at(pattern)
    try:
        await streaming(driver, lines, lambda: len(first.cnc.executed) > 10)
        first.close()  # pulled in the middle of what is written
        (tmp_path / "ttyUSB0").unlink()
        events = await going_on(driver, lambda: not driver.is_connected)
        assert ["is gone" in event.message for event in events if isinstance(event, PortLost)] == [True]
        arrived = lines_in(first.received)
        assert arrived == lines[: len(arrived)] and len(arrived) <= driver.counts.sent < LINES
        assert len(first.cnc.executed) <= len(arrived)
        driver.close()
        with pytest.raises(PortAbsent, match="no serial port"):
            driver_at(pattern)
        (tmp_path / again).symlink_to(second.path)
        driver = driver_at(pattern)
        await driver.identify()
        driver.query_status()
        await going_on(driver, lambda: driver.status is not None)
        assert lines_in(second.received) == [] and driver.counts.sent == 0
        await streaming(driver, lines, lambda: driver.is_drained)
        assert lines_in(second.received) == lines and second.cnc.overflowed == 0
    finally:
        driver.close()
        for line in (first, second):
            if line.master >= 0:
                line.close()


async def test_answers_that_come_in_halves_are_counted_once_each() -> None:
    line = Line(Halving(pause_s=PAUSE_S))
    lines = program(20)
    try:
        driver = driver_at(line.path)
        events = await streaming(driver, lines, lambda: driver.is_drained)
        assert lines_in(line.received) == lines and line.cnc.executed == lines
        assert driver.counts.acknowledged == len(lines) and not [event for event in events if isinstance(event, (AnswerOverdue, ProtocolFault))]
        driver.close()
    finally:
        line.close()


async def test_answer_cut_in_half_for_good_is_told_with_its_line_and_no_line_is_sent_twice() -> None:
    line = Line(Halving(cut_at=30))
    lines = [f"N{k + 1} G1 X{k}.5 F60000" for k in range(LINES)]  # short moves: an answer is soon overdue
    seen: list[CncEvent] = []
    try:
        driver = driver_at(line.path, answer_timeout_s=OVERDUE_S)
        await streaming(driver, lines, lambda: any(isinstance(event, AnswerOverdue) for event in seen), seen)
        arrived = lines_in(line.received)
        assert arrived == lines[: len(arrived)] == line.cnc.executed
        assert driver.counts.acknowledged < len(arrived) and not driver.is_drained
        overdue = next(event for event in seen if isinstance(event, AnswerOverdue))
        assert overdue.line in lines and overdue.waited_s >= OVERDUE_S and overdue.garbled.startswith("<Run|MPos:1.0")
        driver.close()
    finally:
        line.close()


async def test_line_of_ours_that_the_port_takes_in_pieces_arrives_whole_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Line(FakeCnc(line_s=0.001))
    lines = program(60)
    write = os.write

    def few(fd: int, data: bytes) -> int:
        return write(fd, data[:7] if fd != line.master else data)

    try:
        driver = driver_at(line.path)
        monkeypatch.setattr("drivers.transport.serial_port.os.write", few)
        await streaming(driver, lines, lambda: driver.is_drained)
        assert lines_in(line.received) == lines == line.cnc.executed
        driver.close()
    finally:
        line.close()
