"""Drivers by wire: lines per second and use of a 115200 baud line, CPU per line, delay of a hold, time of a Modbus cycle."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import pty
import time
import tty
from collections.abc import Awaitable, Callable
from multiprocessing.connection import Connection
from typing import cast

import numpy as np

from config.cell import Link
from config.device import load_device
from drivers.clock import SystemClock
from drivers.cnc.driver import CncDriver
from drivers.modbus.client import PymodbusLink
from drivers.modbus.device import DeviceClient
from drivers.transport.serial_port import SerialPort
from tests.bench.table import Table
from tests.unit.drivers.fakes import LETTERS, FakeCnc, cnc_facts
from tests.wire.raw_modbus import RawModbus

BAUD = 115200
LINES = 1500
HOLDS = 60
CYCLES = 300


def five_axis_lines(count: int) -> list[str]:
    """Lines of about 45 characters, all five axes and F, as posted."""
    return [f"N{k + 1} X{k % 97}.123 Y-{k % 89}.456 Z-{k % 7}.078 A{k % 45}.12 C{k % 360}.34 F1234.5" for k in range(count)]


def far_end(master: int, rx: int, pace: float, pipe: Connection) -> None:
    """A firmware in its own process that takes `pace` bytes/s and tells when it took each hold."""
    cnc = FakeCnc("grbl", rx=rx, planner=15, line_s=0.0001)
    os.set_blocking(master, False)
    last, credit, stop = time.monotonic(), 0.0, False
    bytes_taken, first_at, last_at = 0, 0.0, 0.0
    holds: list[float] = []
    while not stop:
        time.sleep(0.0003)
        now = time.monotonic()
        credit = min(credit + (now - last) * pace, max(8.0, pace * 0.0012))
        cnc.step(now - last)
        last = now
        try:
            data = os.read(master, int(credit)) if credit >= 1 else b""
        except BlockingIOError:
            data = b""
        credit -= len(data)
        if data:
            bytes_taken += len(data)
            first_at, last_at = first_at or now, now
            holds += [now] * data.count(b"!")
            cnc.receive(data.replace(b"!", b""))
        out = cnc.transmit()
        if out:
            os.write(master, out)
        if pipe.poll():
            word = pipe.recv()
            if word == "zero":
                bytes_taken, first_at = 0, 0.0
                cnc.executed.clear()
            else:
                stop = True
    pipe.send((bytes_taken, first_at, last_at, holds, len(cnc.executed), cnc.overflowed))


async def stream(path: str, rx: int, baud: int, pipe: Connection) -> tuple[float, float, list[float]]:
    """Stream LINES lines; seconds, CPU seconds of this process, times at which a hold was asked for."""
    driver = CncDriver(SerialPort(path, baud), cnc_facts(firmware="grbl", baud=baud), LETTERS, SystemClock())
    await driver.identify()
    pipe.send("zero")
    await asyncio.sleep(0.01)
    driver.load(five_axis_lines(LINES))
    driver.release(LINES)
    loop, drained = asyncio.get_running_loop(), asyncio.Event()
    began, cpu = time.monotonic(), time.process_time()
    asked: list[float] = []
    timer: asyncio.Handle = loop.call_soon(lambda: None)

    def pump() -> None:
        """As the cell does: when bytes come, and when the pacing lets more go."""
        nonlocal timer
        timer.cancel()
        driver.pump()
        if len(asked) < HOLDS and time.monotonic() - began > 0.05 * (len(asked) + 1):
            asked.append(time.monotonic())
            driver.hold()
        if driver.is_drained:
            drained.set()
        else:
            timer = loop.call_later(max(driver.due_in_s(), 0.0002), pump)

    loop.add_reader(cast(int, driver.fileno()), pump)
    pump()
    await drained.wait()
    seconds, cpu = time.monotonic() - began, time.process_time() - cpu
    loop.remove_reader(cast(int, driver.fileno()))
    driver.close()
    return seconds, cpu, asked


def streaming(rx: int, baud: int) -> list[str | int | float]:
    """One row: a line of `baud` to a firmware with `rx` bytes of buffer."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=far_end, args=(master, rx, baud / 10, there))
    process.start()
    try:
        seconds, cpu, asked = asyncio.run(stream(os.ttyname(slave), rx, baud, here))
    finally:
        here.send("stop")
        taken, first_at, last_at, holds, executed, overflowed = here.recv()
        process.join()
        os.close(master)
        os.close(slave)
    use = taken / (last_at - first_at) / (baud / 10)
    late_ms = 1000 * (np.array(holds[: len(asked)]) - np.array(asked[: len(holds)]))
    p50, p99 = (float(np.percentile(late_ms, q)) for q in (50, 99))
    return [baud, rx, LINES / seconds, 100 * use, 1e6 * cpu / LINES, p50, p99, executed, overflowed]


async def cycles(wire: str) -> list[str | float]:
    """One row: whole cycles (write heartbeat, read all, compare) of the generic laser."""
    server = RawModbus(1)
    server.devices[1].copies = {("holding", 0): ("input", 4), ("holding", 1): ("input", 3)}
    if wire == "tcp":
        await server.listen()
        facts = Link(device="laser_generic", transport="tcp", tcp_port=server.port)
    else:
        server.open_line()
        facts = Link(device="laser_generic", transport="rtu", serial_port=server.path)
    link = PymodbusLink(facts, 0.1, SystemClock())
    client = DeviceClient(load_device("laser_generic"), 1, link, SystemClock())
    await client.cycle()
    whole = await timed(client.cycle, CYCLES)
    one = await timed(lambda: link.read(1, "input", 0, 6), CYCLES)
    await link.close()
    await server.close()
    return [wire, *(float(np.percentile(times, q)) for times in (whole, one) for q in (50, 99))]


async def timed(call: Callable[[], Awaitable[object]], count: int) -> list[float]:
    """Milliseconds of each call."""
    times = []
    for _ in range(count):
        began = time.perf_counter()
        await call()
        times.append(1000 * (time.perf_counter() - began))
    return times


def run() -> list[Table]:
    """Both tables."""
    columns = ["baud", "rx bytes", "lines/s", "link use %", "CPU µs/line", "hold p50 ms", "hold p99 ms", "executed", "overflowed"]
    rows = [streaming(rx, baud) for rx, baud in ((128, BAUD), (254, BAUD), (1024, BAUD), (1024, 3_000_000))]
    note = (
        f"{LINES} five-axis lines over a pty; the far end is another process that takes bytes at the baud rate. "
        "Hold: from the call to the byte leaving the line."
    )
    modbus = [asyncio.run(cycles(wire)) for wire in ("tcp", "rtu")]
    return [
        Table("Streaming to the CNC", columns, rows, note),
        Table(
            "Modbus cycle",
            ["wire", "cycle p50 ms", "cycle p99 ms", "6 registers p50 ms", "6 registers p99 ms"],
            modbus,
            f"{CYCLES} cycles of the generic laser against a server in the same process; "
            "RTU over a pty without baud rate, with the 1.75 ms gap between frames.",
        ),
    ]
