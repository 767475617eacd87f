"""A program of five million lines: how long its start takes, what it costs in memory, and how long the safety tick is kept waiting."""

from __future__ import annotations

import asyncio
import os
import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellctl.cell.opened_program import open_form
from cellctl.cell.program_form import write_form
from cellctl.cell.stream import Run
from config.cell import Cell, load_cell
from planner.program import Program
from tests.bench.table import Table
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

LINES = int(os.environ.get("BENCH_OPEN_LINES", "5000000"))
TICK_S = 0.01
DIGEST = "0" * 64


def long_program(cell: Cell, lines: int) -> Program:
    """one_wall with its deposited lines repeated: `lines` lines, N-words and times in order."""
    seed = one_wall(cell, layers=1, length_mm=400.0, pieces=1000, mill=False)
    kept = len(seed.lines) - 1
    copies = lines // kept
    table = np.tile(seed.table[:kept], copies)
    table["n"] = np.arange(1, len(table) + 1)
    shift = np.repeat(np.arange(copies) * float(seed.table["time_end_s"][kept - 1]), kept)
    table["time_start_s"] += shift
    table["time_end_s"] += shift
    bodies = [line.partition(" ")[2] for line in seed.lines[:kept]]
    text = tuple(f"N{k * kept + i + 1} {body}" for k in range(copies) for i, body in enumerate(bodies))
    starts = np.array([0, len(table)], dtype=np.int64)
    return replace(seed, lines=text, table=table, layer_starts=starts, duration_s=float(table["time_end_s"][-1]))


def memory_mb() -> tuple[float, float]:
    """(memory of this process's own, pages of files that are mapped), MB."""
    found = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":" in line)
    return int(found["RssAnon"].split()[0]) / 1024, int(found["RssFile"].split()[0]) / 1024


async def opened(form: Path) -> list[float]:
    """As `measured`, beside a cell in simulated time whose drivers the run is built on."""
    async with CellUnderTest(form.parent / "store.db") as cell:
        await cell.forward(until=lambda: cell.controller.gate.is_shut, seconds=5)
        return await measured(form, cell)


async def measured(form: Path, cell: CellUnderTest) -> list[float]:
    """[s to open and verify, s in the event loop, longest gap between ticks ms, own memory MB, mapped MB]: as the cell process does it."""
    gaps: list[float] = []

    async def tick() -> None:
        last = time.monotonic()
        while True:
            await asyncio.sleep(TICK_S)
            now = time.monotonic()
            gaps.append(now - last)
            last = now

    own, _ = memory_mb()
    ticking = asyncio.create_task(tick())
    await asyncio.sleep(0.2)
    gaps.clear()
    started = time.monotonic()
    program = await asyncio.to_thread(open_form, form, DIGEST)
    assert program is not None
    verified = time.monotonic()
    drivers = cell.controller.drivers
    assert drivers is not None
    run = Run("long", "long", program, cell.facts, drivers, cell.controller.modes, cell.controller.hand)
    run.begin_barrier()
    in_loop = time.monotonic() - verified
    await asyncio.sleep(3 * TICK_S)
    ticking.cancel()
    after, mapped = memory_mb()
    return [verified - started, in_loop, 1e3 * max(gaps), after - own, mapped]


def run() -> list[Table]:
    """Make the form in a process of its own, open it in another."""
    folder = Path(tempfile.mkdtemp(prefix="bench-open-"))
    cell = load_cell("trunnion_tcp")
    try:
        started = time.monotonic()
        child = os.fork()
        if child == 0:
            write_form(long_program(cell, LINES), cell, folder / "form", DIGEST)
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        made_s = time.monotonic() - started
        size = sum(path.stat().st_size for path in (folder / "form").iterdir()) / 1e6
        rows = [[LINES, size, *asyncio.run(opened(folder / "form"))]]
    finally:
        shutil.rmtree(folder)
    columns = ["lines", "form MB", "open and verify s", "in the loop s", "longest gap ms", "own memory MB", "mapped MB"]
    made = f"the form is made when the program is stored (here {made_s:.0f} s with the making of the text)"
    note = f"{made}; it was in the page cache; load {os.getloadavg()[0]:.1f}; ticks every {1e3 * TICK_S:g} ms"
    return [Table("Start of a long program", columns, rows, note)]
