"""One stream of five-axis lines to a far end of its own process, or to one in memory in its own time; what came of it."""

from __future__ import annotations

import asyncio
import gc
import multiprocessing
import os
import pty
import select
import time
import tty
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import overload

from cellctl.cell.tick import be_urgent
from config.cell import Cnc
from drivers.clock import SystemClock
from drivers.cnc.driver import CncDriver
from drivers.cnc.line_watch import LineWatch
from drivers.transport.line_loop import LineLoop
from drivers.transport.serial_port import SerialPort
from tests.bench.cnc_far_end import Answers, Counts, FarEnd

LETTERS = ("X", "Y", "Z", "A", "C")
LEAST_WAIT_S, MOST_WAIT_S = 0.0001, 0.02  # of the far end: its clock against the load of looking at it
HOLD_EVERY_S = 0.05
LINES_PER_S = 217  # at 115200 baud
USB_BAUD = 4_000_000  # beyond what any CDC device takes: the window alone limits


class FiveAxisLines(Sequence[str]):
    """`count` lines of about 53 characters, all five axes and F, made as they are read."""

    def __init__(self, count: int) -> None:
        self.count = count

    def __len__(self) -> int:
        return self.count

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[str]: ...
    def __getitem__(self, index: int | slice) -> str | Sequence[str]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(self.count))]
        if not 0 <= index < self.count:
            raise IndexError(index)
        return f"N{index + 1} X{index % 97}.123 Y-{index % 89}.456 Z-{index % 7}.078 A{index % 45}.12 C{index % 360}.34 F1234.5"


def five_axis_line(index: int) -> bytes:
    """The same text, written down a second time at the far end."""
    k = index
    return b"N%d X%d.123 Y-%d.456 Z-%d.078 A%d.12 C%d.34 F1234.5" % (k + 1, k % 97, k % 89, k % 7, k % 45, k % 360)


@dataclass(frozen=True)
class Case:
    """One run: `baud` 0 is USB. block_s : s per line at the machine."""

    rx: int
    answers: Answers
    lines: int
    baud: int = 115200
    block_s: float = 0.0005

    @property
    def byte_s(self) -> float:
        """Time of a byte on the line, s."""
        return 10.0 / self.baud if self.baud else 0.0

    def far_end(self) -> FarEnd:
        """The controller of this case."""
        return FarEnd(self.rx, self.byte_s, self.answers, five_axis_line, lambda _: self.block_s, lambda _: True)

    def facts(self) -> Cnc:
        """The cell file's part of it."""
        return Cnc.model_validate({"firmware": "grbl", "port": "cnc", "baud": self.baud or USB_BAUD})


@dataclass(frozen=True)
class Outcome:
    """counts as the far end has them; cpu_s of this process; asked: when each hold was asked for, s."""

    counts: Counts
    seconds: float
    cpu_s: float
    asked: list[float]

    @property
    def lines_per_s(self) -> float:
        """Lines a second."""
        return self.counts.lines / self.seconds

    def share(self, byte_s: float) -> float:
        """Of the wire's bytes between the first and the last of the program."""
        return self.counts.bytes * byte_s / (self.counts.last_at - self.counts.first_at)

    def late_ms(self) -> list[float]:
        """From each call of hold to its byte having left the line."""
        told = [at for byte, at in self.counts.urgent if byte == 0x21]
        return [1e3 * (there - here) for here, there in zip(self.asked, told, strict=True)]


def serve(case: Case, master: int, pipe: Connection, is_urgent: bool) -> None:
    """The far end's process, urgent as hardware is."""
    if is_urgent:
        be_urgent()
    far = case.far_end()
    watched = (master, pipe.fileno())
    os.set_blocking(master, False)
    while True:
        now = time.monotonic()
        wait_s = min(max(min(far.next_at(now), far.answer_at()) - now, LEAST_WAIT_S), MOST_WAIT_S)
        ready = select.select(watched, (), (), wait_s)[0]  # to the microsecond, where poll counts whole milliseconds
        now = time.monotonic()
        if master in ready:
            far.arrive(os.read(master, 65536), now)
        far.step(now)
        if out := far.transmit(now):
            os.write(master, out)
        if pipe.fileno() in ready:
            if pipe.recv() == "zero":
                far.counts = Counts()
            else:
                pipe.send(far.counts)
                return


def over_a_wire(case: Case, near: Callable[[Case, str, Connection], tuple[float, float, list[float]]], is_urgent: bool = True) -> Outcome:
    """Run `near` against the far end in its own process, over a pseudo-terminal. is_urgent : both ask for the cell process's scheduler."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=serve, args=(case, master, there, is_urgent), daemon=True)
    process.start()
    ordinary = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        if is_urgent:
            be_urgent()
        seconds, cpu_s, asked = near(case, os.ttyname(slave), here)
        here.send("end")
        counts = here.recv()
    finally:
        os.sched_setscheduler(0, *ordinary)
        process.join(5)
        os.close(master)
        os.close(slave)
    return Outcome(counts, seconds, cpu_s, asked)


def with_driver(case: Case, path: str, pipe: Connection) -> tuple[float, float, list[float]]:
    """The near end: the driver as the cell process uses it, holds asked for now and then."""
    with asyncio.Runner(loop_factory=LineLoop) as runner:
        return runner.run(_drive(case, path, pipe))


async def _drive(case: Case, path: str, pipe: Connection) -> tuple[float, float, list[float]]:
    facts = case.facts()
    driver = CncDriver(SerialPort(path, facts.baud), facts, LETTERS, SystemClock())
    await driver.identify()
    pipe.send("zero")
    await asyncio.sleep(0.05)
    lines = FiveAxisLines(case.lines)
    driver.load(lines)
    gc.collect()
    gc.freeze()
    driver.release(case.lines)
    done = asyncio.Event()
    asked: list[float] = []

    def pump() -> None:
        driver.pump()
        if driver.is_halted or (driver.counts.sent == case.lines and not driver.protocol.unanswered):
            done.set()

    loop = asyncio.get_running_loop()

    def hold() -> None:
        if not done.is_set():
            asked.append(time.monotonic())
            driver.hold()
            watch.rearm()
            loop.call_later(HOLD_EVERY_S * (0.9 + 0.0131 * (len(asked) % 17)), hold)

    began, cpu = time.monotonic(), time.process_time()
    watch = LineWatch(driver, pump)
    loop.call_later(HOLD_EVERY_S, hold)
    await done.wait()
    seconds, cpu_s = time.monotonic() - began, time.process_time() - cpu
    if driver.is_halted:
        raise RuntimeError(f"the stream stopped: {driver.is_halted}")
    watch.close()
    gc.unfreeze()
    await asyncio.sleep(0.05)
    driver.close()
    return seconds, cpu_s, asked


def with_bare_loop(case: Case, path: str, pipe: Connection) -> tuple[float, float, list[float]]:
    """The peer: a plain loop that counts characters, parses nothing and paces its writes by the same 2 ms."""
    return _loop(case, path, pipe, max(8, int(0.0019 / case.byte_s)) if case.byte_s else 1024)


def with_lone_bytes(case: Case, path: str, pipe: Connection) -> tuple[float, float, list[float]]:
    """What the pseudo-terminal itself takes: real-time bytes alone, on an idle line, as often as holds are asked for."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    pipe.send("zero")
    time.sleep(0.05)
    asked: list[float] = []
    began, cpu = time.monotonic(), time.process_time()
    for _ in range(round(case.lines / (LINES_PER_S * HOLD_EVERY_S))):
        asked.append(time.monotonic())
        os.write(fd, b"!")
        time.sleep(HOLD_EVERY_S)
    seconds, cpu_s = time.monotonic() - began, time.process_time() - cpu
    os.close(fd)
    return seconds, cpu_s, asked


def with_unpaced_loop(case: Case, path: str, pipe: Connection) -> tuple[float, float, list[float]]:
    """The same without pacing: the window is all that it keeps."""
    return _loop(case, path, pipe, 1 << 20)


def _loop(case: Case, path: str, pipe: Connection, ahead: int) -> tuple[float, float, list[float]]:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    lines = FiveAxisLines(case.lines)
    window = case.rx - 1 - case.facts().rx_margin_bytes
    pipe.send("zero")
    time.sleep(0.05)
    sizes: list[int] = []
    rest, sent, answered, unanswered, standing_until = b"", 0, 0, 0, 0.0
    byte_s = case.byte_s if ahead < case.rx else 0.0
    began, cpu = time.monotonic(), time.process_time()
    while answered < case.lines:
        now = time.monotonic()
        standing = max(0.0, standing_until - now) / byte_s if byte_s else 0.0
        room = min(ahead - int(standing), window - unanswered)
        while len(rest) < room and sent < case.lines:
            line = lines[sent].encode() + b"\n"
            sizes.append(len(line))
            rest, sent = rest + line, sent + 1
        if room > 0 and rest:
            count = os.write(fd, rest[:room])
            rest, unanswered = rest[count:], unanswered + count
            standing_until = max(now, standing_until) + count * byte_s
        waits = byte_s and unanswered < window and (rest or sent < case.lines)
        wait_s = max(0.0, standing_until - now - 0.0004) if waits else 0.02
        if select.select([fd], [], [], wait_s)[0]:
            for _ in range(os.read(fd, 65536).count(b"ok")):
                unanswered -= sizes[answered]
                answered += 1
    seconds, cpu_s = time.monotonic() - began, time.process_time() - cpu
    os.close(fd)
    return seconds, cpu_s, []
