"""Killed with -9: how long until the cell process has its wires again and says so."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from pathlib import Path

from cellctl.cell.ipc import encode, read_message
from cellctl.domain.messages import PROTOCOL, Hello, Live
from tests.bench.served import START_S, Served, cpu_s, served
from tests.bench.table import Table

KILLS = int(os.environ.get("BENCH_RESTART_KILLS", "10"))
BETWEEN_S = 5.0  # the supervisor does not wait with a process that lived as long
STEP_S = 0.005


async def ready(socket: Path, seconds: float = START_S) -> tuple[float, float]:
    """(monotonic time of the first snapshot, of the first one with all wires up). Raises TimeoutError."""
    first = 0.0
    async with asyncio.timeout(seconds):
        while True:
            try:
                reader, writer = await asyncio.open_unix_connection(socket)
            except OSError:
                await asyncio.sleep(STEP_S)
                continue
            writer.write(encode(Hello(PROTOCOL, "bench")))
            try:
                while True:
                    message = await read_message(reader)
                    if not isinstance(message, Live):
                        continue
                    first = first or time.monotonic()
                    seen = message.snapshot
                    if seen.cnc.connected and seen.laser.connected and seen.feeder.connected and seen.io.connected:
                        return first, time.monotonic()
            except (asyncio.IncompleteReadError, OSError):
                await asyncio.sleep(STEP_S)
            finally:
                writer.close()


async def kills(service: Served) -> list[tuple[float, float, float]]:
    """Per kill: seconds to the first snapshot, to the wires, and CPU seconds of the new process up to there."""
    socket = service.run / "cell.sock"
    await ready(socket)
    found = []
    for _ in range(KILLS):
        await asyncio.sleep(BETWEEN_S)
        killed = time.monotonic()
        os.kill(service.cell_pid(), signal.SIGKILL)
        first, wires = await ready(socket)
        found.append((first - killed, wires - killed, cpu_s(service.cell_pid())))
    return found


def run() -> list[Table]:
    """Ten kills of an idle cell under its supervisor."""
    with served() as service:
        found = asyncio.run(kills(service))
    rows: list[list[str | float]] = []
    for name, k in (("first snapshot", 0), ("wires up (CNC identified, devices read)", 1), ("CPU of the new process until then", 2)):
        values = sorted(one[k] for one in found)
        rows.append([name, values[len(values) // 2], values[-1]])
    note = f"{KILLS} kills; load of the machine {os.getloadavg()[0]:.1f}, Python {sys.version.split()[0]}"
    return [Table("Cell process killed with -9", ["until", "p50 s", "max s"], rows, note)]
