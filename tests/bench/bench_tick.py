"""Jitter of the cell process's safety tick on the real clock: alone, with clients, and with every core busy."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from cellctl.cell.ipc import encode, read_message
from cellctl.domain.messages import PROTOCOL, Hello, Live
from cellctl.domain.snapshot import TickView
from config.base import find_facts
from tests.bench.table import Table

SECONDS = 15.0
CLIENTS = 20
START_S = 60.0  # a loaded machine takes its time to import
SPIN = "while True: sum(range(10000))"


async def watched(socket: Path, clients: int, seconds: float) -> TickView:
    """Read snapshots as `clients` consoles do; the tick's own figures after `seconds`."""

    async def console() -> TickView:
        reader, writer = await asyncio.open_unix_connection(socket)
        writer.write(encode(Hello(PROTOCOL, "bench")))
        view = TickView()
        try:
            async with asyncio.timeout(seconds):
                while True:
                    message = await read_message(reader)
                    if isinstance(message, Live):
                        view = message.snapshot.tick
        except TimeoutError:
            return view
        finally:
            writer.close()

    return (await asyncio.gather(*(console() for _ in range(clients))))[0]


def measure(clients: int, busy: int) -> TickView:
    """A cell process of its own with a simulated cell behind it, `busy` spinning processes beside it."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder)
        shipped = find_facts("cells", "trunnion_tcp").read_text(encoding="utf-8")
        (run / "given.toml").write_text(re.sub(r"tcp_port = \d+", "tcp_port = 0", shipped), encoding="utf-8")
        command = [sys.executable, "-m", "sim", "--cell", str(run / "given.toml"), "--run", str(run)]
        sim = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert sim.stdout is not None
        sim.stdout.readline()
        options = [
            "--cell",
            str(run / "cell.toml"),
            "--run",
            str(run),
            "--store",
            str(run / "store.db"),
            "--stop-port",
            "0",
        ]
        cell = subprocess.Popen([sys.executable, "-m", "cellctl.cell", *options], stderr=subprocess.DEVNULL)
        spinning = [subprocess.Popen([sys.executable, "-c", SPIN]) for _ in range(busy)]
        try:
            asyncio.run(until_there(run / "cell.sock"))
            return asyncio.run(watched(run / "cell.sock", clients, SECONDS))
        finally:
            for process in (*spinning, cell, sim):
                process.terminate()
                process.wait(10)
            sim.stdout.close()


async def until_there(socket: Path) -> None:
    """Wait for the socket and for the first beats, which load what the tick needs. Raises TimeoutError."""
    async with asyncio.timeout(START_S):
        while not socket.exists():
            await asyncio.sleep(0.1)
    await asyncio.sleep(2.0)


def run() -> list[Table]:
    """Jitter p99 and missed beats in the cases that the issue names."""
    cores = os.cpu_count() or 1
    cases = [
        ("alone", 1, 0),
        (f"{CLIENTS} consoles at 10 Hz", CLIENTS, 0),
        (f"{CLIENTS} consoles, {cores} busy cores", CLIENTS, cores),
    ]
    rows = []
    for name, clients, busy in cases:
        view = measure(clients, busy)
        rows.append([name, view.count, view.missed, view.jitter_p99_ms, view.scheduler])
    return [
        Table(
            "Safety tick of the cell process",
            ["load", "ticks", "missed", "jitter p99 (ms)", "scheduler"],
            rows,
            f"{SECONDS:g} s each, 100 Hz",
        )
    ]
