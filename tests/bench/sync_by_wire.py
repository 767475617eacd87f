"""A Program by pty and Modbus: our cell process on one side, the exact plant in a process of its own on the other."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from pathlib import Path

from cellctl.cell.ipc import encode, read_message
from cellctl.domain.messages import PROTOCOL, Command, Hello, Live, Reply
from cellctl.domain.snapshot import Snapshot
from config.base import find_facts
from config.cell import Cell, load_cell
from planner.files import write_program
from planner.program import Program
from tests.bench.served import as_hardware
from tests.bench.sync_edges import Light, rows_program

START_S, LONGEST_S = 90.0, 240.0


async def by_wire(
    place: Path, cell_name: str, *, gate: bool, rows: int, feed_mm_s: float, delay_s: float, jitter_s: float
) -> tuple[Program, Light, Snapshot]:
    """The Program, what the plant saw of its light, the last snapshot. Raises TimeoutError, AssertionError for a job that did not end well."""
    shipped = find_facts("cells", cell_name).read_text(encoding="utf-8")
    shipped = re.sub(r"tcp_port = \d+", "tcp_port = 0", shipped)
    if not gate:
        shipped = re.sub(r"laser_gate_output = \d+\n", "", shipped)
    (place / "given.toml").write_text(shipped, encoding="utf-8")
    at_baud = "1" if cell_name == "trunnion_rtu" else "0"
    words = ["-m", "tests.bench.sync_plant", str(place / "given.toml"), str(place), str(place / "trace.json"), str(delay_s), str(jitter_s), at_baud]
    plant = await asyncio.create_subprocess_exec(sys.executable, *words, stdout=PIPE)
    assert plant.stdout is not None
    as_hardware(plant.pid)
    await asyncio.wait_for(plant.stdout.readline(), START_S)
    words = ["-m", "cellctl.cell", "--cell", str(place / "cell.toml"), "--run", str(place), "--store", str(place / "s.db"), "--stop-port", "0"]
    cell = await asyncio.create_subprocess_exec(sys.executable, *words, stderr=DEVNULL)
    try:
        async with asyncio.timeout(LONGEST_S):
            while not (place / "stop_port").exists():
                await asyncio.sleep(0.05)
            program, last = await _job(place, load_cell(str(place / "cell.toml")), rows, feed_mm_s)
    finally:
        for process in (cell, plant):
            await _end(process)
    seen = json.loads((place / "trace.json").read_text(encoding="utf-8"))
    light = Light(load_cell(str(place / "cell.toml")).placement.part_origin_mm)
    light.edges = [(bool(on), at, tuple(where)) for on, at, where in seen["edges"]]
    light.moving = [tuple(row) for row in seen["moving"]]
    return program, light, last


async def _end(process: Process) -> None:
    if process.returncode is None:
        process.send_signal(signal.SIGTERM)
    await asyncio.wait_for(process.communicate(), START_S)


async def _job(place: Path, cell: Cell, rows: int, feed_mm_s: float) -> tuple[Program, Snapshot]:
    program = rows_program(cell, rows=rows, feed_mm_s=feed_mm_s)
    write_program(program, place / "program")
    reader, writer = await asyncio.open_unix_connection(place / "cell.sock")
    writer.write(encode(Hello(PROTOCOL, "bench")))
    commands = iter([
        Command("p-1", "confirm_position", "bench", "bench", {}),
        Command("s-1", "start", "bench", "bench", {"job": "j", "name": "rows", "program": str(place / "program")}),
    ])  # fmt: skip
    is_asked = False
    try:
        while True:
            message = await read_message(reader)
            if isinstance(message, Reply) and message.id == "s-1":
                assert message.ok, message.error
            if isinstance(message, Live):
                snapshot = message.snapshot
                if not is_asked and snapshot.state == "IDLE":
                    is_asked = True
                    for command in commands:
                        writer.write(encode(command))
                if snapshot.job is not None and snapshot.job.outcome:
                    assert snapshot.job.outcome == "completed", [alarm.cause for alarm in snapshot.alarms]
                    return program, snapshot
                assert snapshot.state != "FAULT", ([alarm.cause for alarm in snapshot.alarms], snapshot.laser, snapshot.tick)
    finally:
        writer.close()
        await writer.wait_closed()
