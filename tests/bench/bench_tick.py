"""Jitter of the cell process's safety tick on the real clock: alone, under web load and planning, on a slow disk, with and without SCHED_FIFO."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from cellctl.cell.ipc import encode, read_message
from cellctl.domain.messages import PROTOCOL, Hello, Live
from cellctl.domain.snapshot import TickView
from cellctl.store import upgrade
from cellctl.store.engine import DATABASE
from tests.bench.bench_request import load
from tests.bench.served import END_S, Served, cpu_s, serve, start_sim, until
from tests.bench.table import Table

SECONDS = float(os.environ.get("BENCH_TICK_S", "20"))
SETTLE_S = 3.0  # the first beats load what the tick needs
SLOW_COMMIT_S = 0.5
SPIN = "import os\nos.nice(10)\nwhile True: sum(range(10000))"


@dataclass(frozen=True)
class Case:
    """What goes on beside the tick. planners : processes that compute, at a worker's priority"""

    name: str
    is_web: bool = False
    planners: int = 0
    slow_commit_s: float = 0.0
    is_ordinary: bool = False


CASES = (
    Case("alone"),
    Case("20 consoles and an upload, planning beside", True, 1),
    Case("the same, commits of 500 ms", True, 1, SLOW_COMMIT_S),
    Case("the same without SCHED_FIFO", True, 1, SLOW_COMMIT_S, True),
)


async def watched(socket: Path, seconds: float) -> tuple[TickView, TickView]:
    """The tick's own figures at the begin and the end of some seconds."""
    reader, writer = await asyncio.open_unix_connection(socket)
    writer.write(encode(Hello(PROTOCOL, "bench")))
    views: list[TickView] = []
    try:
        async with asyncio.timeout(seconds):
            while True:
                message = await read_message(reader)
                if isinstance(message, Live):
                    views.append(message.snapshot.tick)
    except TimeoutError:
        return views[0], views[-1]
    finally:
        writer.close()


async def under_load(service: Served | None, socket: Path) -> tuple[TickView, TickView]:
    """Watch while consoles and uploads go on."""
    if service is None:
        await asyncio.sleep(SETTLE_S)
        return await watched(socket, SECONDS)
    async with load(service, True):
        await asyncio.sleep(SETTLE_S)
        return await watched(socket, SECONDS)


def measure(case: Case) -> list[object]:
    """A cell process of its own with a simulated cell behind it, adopted by a service where there is web load."""
    with tempfile.TemporaryDirectory(prefix="bench-tick-") as place, ExitStack() as ends:
        folder = Path(place)
        run, store = folder / "run", folder / "store"
        run.mkdir()
        upgrade(store)
        sim = start_sim(run)
        ends.callback(_end, sim)
        handicap = [*(["--ordinary"] if case.is_ordinary else []), "--slow-commit", str(case.slow_commit_s)]
        options = ["--cell", str(run / "cell.toml"), "--run", str(run), "--store", str(store / DATABASE), "--stop-port", "0"]
        cell = subprocess.Popen(
            [sys.executable, "-m", "tests.bench.cell_variant", *handicap, "--", *options], stderr=subprocess.DEVNULL
        )
        ends.callback(_end, cell)
        until(lambda: (run / "stop_port").exists(), "the cell's start")
        service = ends.enter_context(serve(run, store, sim)) if case.is_web else None
        for _ in range(case.planners):
            ends.callback(_end, subprocess.Popen([sys.executable, "-c", SPIN]))
        before_s = cpu_s(cell.pid)
        first, last = asyncio.run(under_load(service, run / "cell.sock"))
        share = 100.0 * (cpu_s(cell.pid) - before_s) / (SECONDS + SETTLE_S)
        return [
            case.name, last.count - first.count, last.missed - first.missed, last.jitter_p99_ms, last.longest_ms, share,
            last.scheduler.partition(" (")[0],
        ]  # fmt: skip


def _end(process: subprocess.Popen[bytes] | subprocess.Popen[str]) -> None:
    process.terminate()
    process.wait(END_S)
    if process.stdout is not None:
        process.stdout.close()


def run() -> list[Table]:
    """Jitter p99, longest gap and missed beats in the cases that the issue names."""
    columns = ["beside it", "ticks", "missed", "jitter p99 ms", "longest gap ms", "CPU %", "scheduler"]
    note = f"{SECONDS:g} s each, 100 Hz, jitter and gap over the last 30 s; load of the machine at the begin {os.getloadavg()[0]:.1f}"
    rows = [measure(case) for case in CASES]
    return [Table("Safety tick of the cell process", columns, rows, note)]  # type: ignore[arg-type]
