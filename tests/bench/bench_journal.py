"""What is known after a kill -9 in a pass, against the plant's own truth; what journal and black box cost."""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import sqlite3
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from cellctl.cell.black_box import BlackBox, Moment, Place, box_file
from cellctl.cell.ipc import encode, read_message
from cellctl.cell.opened_program import timeline_of
from cellctl.cell.record import PROGRESS, SAMPLE, Journal, Sample
from cellctl.cell.whereabouts import note
from cellctl.domain.channels import NAMES
from cellctl.domain.messages import PROTOCOL, Command, Event, Hello, Live, Message, Reply
from cellctl.domain.timeline import Timeline
from cellctl.store import upgrade
from cellctl.store.engine import DATABASE
from config.cell import load_cell
from planner.files import write_program
from tests.bench.served import start_sim
from tests.bench.table import Table
from tests.cell import jobs
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

KILLS = int(os.environ.get("BENCH_JOURNAL_KILLS", "6"))
SPEED_MM_S = float(os.environ.get("BENCH_JOURNAL_MM_S", "17.5"))
START_S = 180.0
DARK_S = 1.5
LIT_W = 400.0
JOURNAL_S = 20.0
SAMPLES_HZ = 10.0  # one row and one update per status report
EVENTS_HZ = 2.0
TICKS = 400
FIGURES = tuple(100.0 + k for k in range(len(NAMES)))


class Bench:
    """A simulated cell and a cell process that is killed now and then."""

    def __init__(self, run: Path) -> None:
        self.run = run
        self.cell: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        """A cell process on run/store.db."""
        options = ["--cell", str(self.run / "cell.toml"), "--run", str(self.run), "--store", str(self.run / "store.db")]
        (self.run / "stop_port").unlink(missing_ok=True)
        self.cell = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "cellctl.cell", *options, "--stop-port", "0", stderr=asyncio.subprocess.DEVNULL
        )
        async with asyncio.timeout(START_S):
            while not (self.run / "stop_port").exists():
                await asyncio.sleep(0.02)

    async def say(self, *commands: Command, until: Any = None) -> Message:
        """Send commands; the last reply, or the first snapshot for which `until` holds."""
        reader, writer = await asyncio.open_unix_connection(self.run / "cell.sock")
        writer.write(encode(Hello(PROTOCOL, "bench")))
        try:
            async with asyncio.timeout(START_S):
                for command in commands:
                    writer.write(encode(command))
                    while not isinstance(message := await read_message(reader), Reply):
                        pass
                    if not message.ok:
                        raise RuntimeError(f"{command.verb}: {message.error}")
                while until is not None:
                    message = await read_message(reader)
                    if isinstance(message, Live) and until(message.snapshot):
                        return message
                return message
        finally:
            writer.close()


class Plant:
    """The simulator's control socket."""

    def __init__(self, run: Path, timeline: Timeline) -> None:
        self._run, self._timeline = run, timeline

    async def open(self) -> None:
        """Connect."""
        self._reader, self._writer = await asyncio.open_unix_connection(self._run / "sim.sock")

    async def look(self) -> tuple[float, float, float]:
        """(monotonic s, arc mm by the plant's own line and joints, emission W)."""
        asked = time.monotonic()
        self._writer.write(b'{"do": "state"}\n')
        state = json.loads(await self._reader.readline())
        line = max(state["cnc"]["line"] - 1, 0)
        fraction = self._timeline.fraction(line, np.array(state["cnc"]["joints"]))
        return 0.5 * (asked + time.monotonic()), self._timeline.arc_at(line, fraction), state["laser"]["emission_w"]

    async def close(self) -> None:
        """Give the connection back."""
        self._writer.close()
        await self._writer.wait_closed()


async def one_kill(bench: Bench, plant: Plant, k: int) -> tuple[float, float, float]:
    """(error of the place mm, error of metal's end mm, ms between the last tick and the kill) of a kill at random."""
    await bench.say(until=lambda s: s.state in ("IDLE", "FAULT", "UNHOMED"))
    if k:
        await bench.say(Command(f"reset-{k}", "reset", "bench", "bench"), until=lambda s: s.state in ("IDLE", "UNHOMED"))
    args = {"job": f"j{k}", "name": "wall", "program": str(bench.run / "program")}
    start = Command(f"start-{k}", "start", "bench", "bench", args)
    await bench.say(start, until=lambda s: s.laser.emitting and s.lines.executed > 20)
    await asyncio.sleep(random.Random(k).uniform(0.5, 3.0))
    before = await plant.look()
    assert bench.cell is not None
    bench.cell.send_signal(signal.SIGKILL)
    killed = time.monotonic()
    seen = [before, await plant.look()]
    while time.monotonic() < killed + DARK_S:  # from the first moment on: the light lasts no longer than a busy machine may take to end a process
        seen.append(await plant.look())
        await asyncio.sleep(0.002)
    await bench.cell.wait()
    truth = float(np.interp(killed, [one[0] for one in seen], [one[1] for one in seen]))
    lit = max((arc for _, arc, watts in seen if watts > LIT_W), default=truth)
    left = BlackBox(box_file(bench.run))
    moment = left.of_job(f"j{k}")
    left.close()
    assert moment is not None
    await bench.start()
    with closing(sqlite3.connect(bench.run / "store.db")) as db:
        rows = db.execute("SELECT data FROM events WHERE kind = 'job' AND job = ? ORDER BY seq DESC", (f"j{k}",)).fetchall()
    ended = json.loads(rows[0][0])
    return ended["place"]["arc_mm"] - truth, ended["metal_end"]["arc_mm"] - lit, 1e3 * (killed - moment.wire_at)


async def kills() -> list[tuple[float, float, float]]:
    """Kills by wire."""
    with tempfile.TemporaryDirectory(prefix="bench-kill-") as place:
        run = Path(place)
        sim = start_sim(run)
        bench = Bench(run)
        try:
            cell = load_cell(str(run / "cell.toml"))
            with patch.object(jobs, "FEED_MM_S", SPEED_MM_S):
                program = one_wall(cell, layers=1, length_mm=160.0, pieces=400, mill=False)
            write_program(program, run / "program")
            plant = Plant(run, timeline_of(program, cell))
            await bench.start()
            await plant.open()
            found = [await one_kill(bench, plant, k) for k in range(KILLS)]
            await plant.close()
            return found
        finally:
            if bench.cell is not None and bench.cell.returncode is None:
                bench.cell.terminate()
                await bench.cell.wait()
            sim.terminate()
            sim.wait(START_S)
            if sim.stdout is not None:
                sim.stdout.close()


def journal_cost() -> tuple[float, float]:
    """(CPU % of a core, commits per second) of the journal with the rows of a running job, its thread and the queueing."""
    with tempfile.TemporaryDirectory(prefix="bench-journal-") as place:
        upgrade(Path(place))
        journal = Journal(Path(place) / DATABASE)
        sample = Sample(1.0, "j", "RUNNING", 3, 0, 1.5, FIGURES, (1.0, 2.0, 3.0), 31)
        journal.start()
        began, cpu = time.monotonic(), time.process_time()
        for k in range(int(JOURNAL_S * SAMPLES_HZ)):
            journal.write(SAMPLE, sample.row)
            journal.write(PROGRESS, (k, "j"))
            if k % int(SAMPLES_HZ / EVENTS_HZ) == 0:
                journal.event(Event(0, time.time(), "cnc", "a message", "j", {"k": k}))
            time.sleep(max(began + (k + 1) / SAMPLES_HZ - time.monotonic(), 0.0))
        spent, took = time.process_time() - cpu, time.monotonic() - began
        commits = journal.commits
        journal.close()
    return 100.0 * spent / took, commits / took


async def box_cost() -> tuple[float, float]:
    """(us of CPU per tick for place, metal's end and record while depositing, us of the record alone)."""
    with tempfile.TemporaryDirectory(prefix="bench-box-") as place:
        async with CellUnderTest(Path(place) / "store.db") as cell:
            await cell.deposit(layers=1, pieces=400, length_mm=160.0)
            spent = 0.0
            for _ in range(TICKS):
                await cell.forward(ticks=1)
                began = time.process_time()
                note(cell.controller, cell.clock.now())
                spent += time.process_time() - began
            box = cell.journal.box
            began = time.process_time()
            for k in range(10 * TICKS):
                box.write(Moment("job-1", 1.0, 2.0, Place(k, 0.5, 1.0)))
            alone = time.process_time() - began
    return 1e6 * spent / TICKS, 1e6 * alone / (10 * TICKS)


def run() -> list[Table]:
    """Costs, then kills."""
    cpu, commits = journal_cost()
    whole, alone = asyncio.run(box_cost())
    rows: list[list[str | float]] = [
        ["journal: samples, progress and events of a running job, % of a core", cpu],
        ["commits per second", commits],
        ["black box per tick, us of CPU", whole],
        ["of that the record, us", alone],
    ]
    costs = Table("Cost of the record", ["what", "measured"], rows, "bounds: 2 % of a core, 50 us")
    found = asyncio.run(kills())
    shown = [[k, *one] for k, one in enumerate(found)]
    columns = ["kill", "place less plant mm", "metal's end less plant mm", "ms since the last tick"]
    note_ = f"kill -9 in a pass at {SPEED_MM_S:g} mm/s, by wire; the plant's own line and joints are the truth"
    return [costs, Table("What is known after a kill", columns, shown, note_)]
