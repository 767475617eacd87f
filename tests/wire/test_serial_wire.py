"""The serial port and the CNC driver over a pty: absent, busy, silent, unplugged, and a program at line speed."""

from __future__ import annotations

import asyncio
import os
import pty
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.cnc.driver import CncDriver
from drivers.cnc.events import CncEvent, PortLost
from drivers.errors import DeviceSilent, LinkLost, PortAbsent, PortBusy
from drivers.transport.serial_port import SerialPort
from tests.unit.drivers.fakes import LETTERS, FakeCnc, cnc_facts, program

LIMIT_S = 60.0  # until something has come about, on a machine that others use too
STEP_MAX_S = 0.003  # of the far end, when it has the processor


class Line:
    """A pty with a firmware at its far end, in a thread of its own; bytes_per_s limits what it takes."""

    def __init__(self, cnc: FakeCnc, bytes_per_s: float = 1e9) -> None:
        self.cnc = cnc
        self.bytes_per_s = bytes_per_s
        self.received = bytearray()
        self.seen_at: dict[int, float] = {}  # real-time byte -> when it was taken from the line
        self.stalled_s = 0.0  # time that the far end did not have the processor when it wanted it
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self.slave)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for fd in (self.master, self.slave):
            if fd >= 0:
                os.close(fd)
        self.master = self.slave = -1

    def _run(self) -> None:
        last = time.monotonic()
        credit = 0.0
        while not self._stop.is_set():
            time.sleep(0.0005)
            now = time.monotonic()
            self.stalled_s += max(now - last - STEP_MAX_S, 0.0)
            credit = min(credit + (now - last) * self.bytes_per_s, self.bytes_per_s * 0.02)
            self.cnc.step(now - last)
            last = now
            try:
                data = os.read(self.master, min(4096, int(credit))) if credit >= 1 else b""
            except BlockingIOError:
                data = b""
            credit -= len(data)
            for byte in data:
                if byte in b"!~\x18":
                    self.seen_at[byte] = now
            self.received += data
            self.cnc.receive(data)
            out = self.cnc.transmit()
            if out:
                os.write(self.master, out)


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line(FakeCnc(line_s=0.001))
    yield line
    line.close()


def driver_on(line: Line, **facts: object) -> CncDriver:
    return CncDriver(SerialPort(line.path, 115200), cnc_facts(**facts), LETTERS, SystemClock())


async def drive(driver: CncDriver, seconds: float) -> list[CncEvent]:
    """Pump as a cell does: when bytes come and when the pacing lets more go."""
    events: list[CncEvent] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end and not driver.is_drained:
        events += driver.pump()
        await asyncio.sleep(min(0.005, max(0.0005, driver.due_in_s())))
    return events


def test_absent_port_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(PortAbsent, match="does not exist") as caught:
        SerialPort(str(tmp_path / "ttyUSB0"), 115200)
    assert "\n" not in caught.value.message and caught.value.hint


def test_file_that_is_no_serial_port_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("x")
    with pytest.raises(PortAbsent, match="is not a serial port"):
        SerialPort(str(tmp_path / "notes"), 115200)


def test_port_that_another_program_has_is_busy(line: Line) -> None:
    port = SerialPort(line.path, 115200)
    with pytest.raises(PortBusy, match="in use by another program"):
        SerialPort(line.path, 115200)
    port.close()
    SerialPort(line.path, 115200).close()


def test_silence_is_no_bytes_and_a_vanished_device_is_link_lost(line: Line) -> None:
    port = SerialPort(line.path, 115200)
    assert port.read() == b""
    line._stop.set()
    line._thread.join()
    os.close(line.master)
    line.master = -1
    with pytest.raises(LinkLost, match="is gone"):
        port.read()
    with pytest.raises(LinkLost, match="is gone"):
        port.write(b"?")
    port.close()
    with pytest.raises(LinkLost, match="is closed"):
        port.read()


async def test_silent_controller_is_one_clear_line(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.cnc.driver.ANSWER_S", 0.3)
    monkeypatch.setattr("drivers.cnc.driver.RESET_S", 0.3)
    line.cnc.is_mute = True
    driver = driver_on(line)
    with pytest.raises(DeviceSilent, match="does not answer at 115200 baud"):
        await driver.identify()
    driver.close()


@pytest.mark.parametrize("rx", [128, 1024])
async def test_program_arrives_byte_for_byte_at_line_speed(rx: int) -> None:
    line = Line(FakeCnc("grbl", rx=rx, planner=15, line_s=0.001), bytes_per_s=11520)
    try:
        driver = driver_on(line, firmware="grbl")
        await driver.identify()
        lines = program(400)
        before = len(line.cnc.executed)
        driver.load(lines)
        driver.release(len(lines))
        await drive(driver, LIMIT_S)
        assert driver.is_drained
        assert line.cnc.executed[before:] == lines and line.cnc.overflowed == 0
        driver.close()
    finally:
        line.close()


async def test_hold_is_at_the_far_end_within_milliseconds_although_a_program_streams() -> None:
    line = Line(FakeCnc(line_s=0.001), bytes_per_s=11520)
    try:
        driver = driver_on(line)
        await driver.identify()
        driver.load(program(5000))
        driver.release(5000)
        await drive(driver, 0.5)
        asked = time.monotonic()
        driver.hold()
        async with asyncio.timeout(LIMIT_S):
            while 0x21 not in line.seen_at:
                await asyncio.sleep(0.005)
        late_s = line.seen_at[0x21] - asked
        assert late_s < 0.012 + line.stalled_s  # 2 ms of bytes ahead and the far end's own step
        driver.close()
    finally:
        line.close()


async def test_cable_pulled_while_streaming_is_one_event_and_nothing_hangs() -> None:
    line = Line(FakeCnc(line_s=0.01))
    driver = driver_on(line)
    await driver.identify()
    driver.load(program(2000))
    driver.release(2000)
    await drive(driver, 0.2)
    line.close()
    events: list[CncEvent] = []
    async with asyncio.timeout(LIMIT_S):
        while driver.is_connected:
            events += driver.pump()
            await asyncio.sleep(0.001)
    events += [event for _ in range(10) for event in driver.pump()]
    assert [type(event) for event in events].count(PortLost) == 1
    assert not driver.is_connected
    driver.close()
