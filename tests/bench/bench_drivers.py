"""Modbus by wire: time of a whole cycle and of one request."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable

import numpy as np

from config.cell import Link
from config.device import load_device
from drivers.clock import SystemClock
from drivers.modbus.client import PymodbusLink
from drivers.modbus.device import DeviceClient
from tests.bench.table import Table
from tests.wire.raw_modbus import RawModbus

CYCLES = 300


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
    """One table, TCP and RTU."""
    return [
        Table(
            "Modbus cycle",
            ["wire", "cycle p50 ms", "cycle p99 ms", "6 registers p50 ms", "6 registers p99 ms"],
            [asyncio.run(cycles(wire)) for wire in ("tcp", "rtu")],
            f"{CYCLES} cycles of the generic laser against a server in the same process; "
            "RTU over a pty without baud rate, with the 1.75 ms gap between frames.",
        ),
    ]
