"""The CNC's line joined to an event loop, over a pseudo-terminal to a controller in a process of its own."""

from __future__ import annotations

import asyncio
import os
import pty
import tty

import pytest

from drivers.clock import SystemClock
from drivers.cnc.driver import CncDriver
from drivers.cnc.line_watch import LineWatch
from drivers.transport.serial_port import SerialPort
from tests.bench.cnc_far_end import Answers
from tests.bench.streaming import Case, over_a_wire, with_driver
from tests.unit.drivers.fakes import LETTERS, cnc_facts


@pytest.mark.parametrize(("rx", "baud", "lines"), [(128, 115200, 80), (254, 0, 800), (1024, 0, 800)])
def test_every_line_and_every_hold_comes_out_of_the_wire_once_and_unchanged(rx: int, baud: int, lines: int) -> None:
    outcome = over_a_wire(Case(rx, Answers("2 ms late", delay_s=0.002), lines, baud, 0.00002), with_driver, is_urgent=False)
    counts = outcome.counts
    assert (counts.lines, counts.lost, counts.doubled, counts.changed, counts.overflowed) == (lines, 0, 0, 0, 0)
    assert len(outcome.late_ms()) == len(outcome.asked)


async def test_line_that_goes_away_is_told_once_by_the_pump_and_a_closed_watch_leaves_nothing_in_the_loop() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    driver = CncDriver(SerialPort(os.ttyname(slave), 115200), cnc_facts(), LETTERS, SystemClock())
    told: list[object] = []
    gone = asyncio.Event()

    def pump() -> None:
        told.extend(driver.pump())
        if not driver.is_connected:
            watch.close()
            gone.set()

    descriptors = set(os.listdir("/proc/self/fd"))
    watch = LineWatch(driver, pump)
    os.close(master)
    os.close(slave)
    async with asyncio.timeout(10.0):
        await gone.wait()
    watch.close()
    watch.rearm()
    driver.close()
    assert [type(event).__name__ for event in told] == ["PortLost"]
    assert set(os.listdir("/proc/self/fd")) < descriptors
