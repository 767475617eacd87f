"""The real cell process against a simulated cell in a process of its own: real wires, real clock, real kill."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import sqlite3
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing
from pathlib import Path
from typing import Any

import pytest

from cellctl.cell.ipc import encode, read_message
from cellctl.domain.messages import PROTOCOL, Command, Hello, Live, Reply
from cellctl.domain.snapshot import Snapshot
from config.base import find_facts
from config.cell import load_cell
from config.device import load_device
from planner.files import write_program
from tests.cell.jobs import one_wall

START_S = 90.0  # a loaded machine takes its time to import
END_S = 60.0
TIME_SCALE = 8.0
ASKED_S = 1.0  # between two questions to the plant


class Bench:
    """A simulated cell and a cell process, each on its own."""

    def __init__(self, run: Path) -> None:
        self.run = run
        self.sim: asyncio.subprocess.Process | None = None
        self.cell: asyncio.subprocess.Process | None = None

    async def start_sim(self) -> None:
        shipped = find_facts("cells", "trunnion_tcp").read_text(encoding="utf-8")
        (self.run / "given.toml").write_text(re.sub(r"tcp_port = \d+", "tcp_port = 0", shipped), encoding="utf-8")
        options = ["--cell", str(self.run / "given.toml"), "--run", str(self.run), "--time-scale", str(TIME_SCALE)]
        self.sim = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "sim", *options, stdout=asyncio.subprocess.PIPE
        )
        assert self.sim.stdout is not None
        await asyncio.wait_for(self.sim.stdout.readline(), START_S)

    async def start_cell(self) -> None:
        options = [
            "--cell",
            str(self.run / "cell.toml"),
            "--run",
            str(self.run),
            "--store",
            str(self.run / "s.db"),
            "--stop-port",
            "0",
        ]
        (self.run / "stop_port").unlink(missing_ok=True)
        self.cell = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "cellctl.cell", *options, stderr=asyncio.subprocess.DEVNULL
        )
        async with asyncio.timeout(START_S):
            while not (self.run / "stop_port").exists():
                await asyncio.sleep(0.05)

    async def end(self) -> None:
        for process in (self.cell, self.sim):
            if process is not None and process.returncode is None:
                process.send_signal(signal.SIGTERM)
            if process is not None:
                await asyncio.wait_for(process.communicate(), END_S)  # to the end of its pipes: only then are they closed

    async def plant(self) -> dict[str, Any]:
        """What stands before the cell, as the simulator's control socket tells."""
        reader, writer = await asyncio.open_unix_connection(self.run / "sim.sock")
        writer.write(b'{"do": "state"}\n')
        state: dict[str, Any] = json.loads(await reader.readline())
        writer.close()
        await writer.wait_closed()
        return state

    @asynccontextmanager
    async def console(self) -> AsyncIterator[Console]:
        reader, writer = await asyncio.open_unix_connection(self.run / "cell.sock")
        writer.write(encode(Hello(PROTOCOL, "test")))
        try:
            yield Console(reader, writer)
        finally:
            writer.close()
            await writer.wait_closed()

    async def plant_once(self, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first state of the plant for which something holds."""
        async with asyncio.timeout(START_S):
            while not holds(plant := await self.plant()):
                await asyncio.sleep(0.02)
        return plant

    async def stop_over_http(self) -> bytes:
        port = int((self.run / "stop_port").read_text())
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b'POST /stop HTTP/1.1\r\nHost: x\r\nContent-Length: 22\r\n\r\n{"because": "by a hand"')
        answer = await reader.read()
        writer.close()
        await writer.wait_closed()
        return answer


class Console:
    """One connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    async def until(self, holds: Callable[[Snapshot], bool]) -> Snapshot:
        """The first snapshot for which something holds."""
        async with asyncio.timeout(START_S):
            while True:
                message = await read_message(self._reader)
                if isinstance(message, Live) and holds(message.snapshot):
                    return message.snapshot

    async def command(self, verb: str, **args: Any) -> Reply:
        self._writer.write(encode(Command(f"{verb}-1", verb, "tester", "test", args)))
        async with asyncio.timeout(START_S):
            while True:
                message = await read_message(self._reader)
                if isinstance(message, Reply):
                    return message


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    one = Bench(tmp_path)
    await one.start_sim()
    try:
        await one.start_cell()
        yield one
    finally:
        await one.end()


async def test_killed_with_9_in_a_pass_the_plant_goes_dark_and_the_job_is_listed_as_interrupted_then_stop_works(
    bench: Bench,
) -> None:
    cell = load_cell(str(bench.run / "cell.toml"))
    write_program(one_wall(cell, layers=1, length_mm=160.0, pieces=400), bench.run / "program")
    async with bench.console() as console:
        await console.until(lambda s: s.state == "IDLE")
        assert (await console.command("start", job="j1", name="wall", program=str(bench.run / "program"))).ok
        seen = await console.until(lambda s: s.laser.emitting and s.lines.executed > 20)
        await console.until(lambda s: s.lines.executed > seen.lines.executed)
    assert bench.cell is not None
    bench.cell.kill()
    await bench.cell.wait()
    killed = await bench.plant()
    dead_man_s = max(load_device(cell.links[role].device).dead_man_s for role in ("laser", "feeder"))
    dark = await bench.plant_once(lambda p: p["laser"]["emission_w"] < 1.0 and p["feeder"]["rate_setpoint"] == 0.0)
    dark_in_s = (dark["time_s"] - killed["time_s"]) / TIME_SCALE  # by the plant's own clock, whatever the machine's load
    assert dark_in_s <= dead_man_s + ASKED_S
    await bench.start_cell()
    async with bench.console() as console:
        after = await console.until(lambda s: s.cnc.connected)
        assert after.state == "FAULT" and after.job is not None and after.job.outcome == "interrupted"
        assert seen.lines.executed <= after.lines.executed <= killed["cnc"]["line"]  # of the plant, not of what was buffered
        assert b'{"state": "STOPPED"}' in await bench.stop_over_http()
        await console.until(
            lambda s: s.state == "STOPPED" and s.because == "STOP pressed (the request's body could not be read)"
        )
    with closing(sqlite3.connect(bench.run / "s.db")) as db, db:
        assert db.execute("SELECT outcome, last_line FROM cell_runs").fetchall() == [
            ("interrupted", after.lines.executed)
        ]
