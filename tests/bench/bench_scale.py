"""Planning on more machines than one: the same jobs on the embedded engine and on pools of one and of two planning machines, all in one run.

All machines are processes of this one: its cores, and what else runs on them, bound the speed-up; the cost of a task is that of the way
without a network.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import trimesh

from cellctl.planning.engine import Engine
from cellctl.planning.keys import software_version
from cellctl.planning.pool.near import Pool
from cellctl.planning.pool.order import Costs
from cellctl.planning.pool.wire import PoolWire
from cellctl.planning.process import Workers
from cellctl.planning.task import PLAN_FILE, PROGRAM_FOLDER, Task
from config.base import FACTS_DIR
from tests.bench.scale_inside import inside
from tests.bench.table import Cell, Table

JOBS = 4
ROUNDS = 2
SMALLEST = 8  # of the cheapest tasks one after another, for the cost of one
STAGES = os.environ.get("SCALE_STAGES", "plan,post,prove").split(",")
MEMORY_BYTES = 8 * 2**30
START_S = 180.0
CELL_FILE = str(FACTS_DIR / "cells" / "trunnion_tcp.toml")


def quiet(_stage: str, _share: float) -> None:
    """Nobody looks how far it is."""


def run() -> list[Table]:
    """Wall time of the same jobs; the cost of a task by its parts; what of one plan and one proof could be split."""
    return [*asyncio.run(_engines()), *inside()]


async def _engines() -> list[Table]:
    """All engines stand ready and take turns, so that what else the machine does falls on all of them alike."""
    with tempfile.TemporaryDirectory(prefix="bench-scale-") as place:
        root = Path(place)
        own = Workers(root, MEMORY_BYTES)
        async with _pool(root / "pool-1", 1) as one, _pool(root / "pool-2", 2) as two:
            engines: dict[str, Engine] = {"embedded": own, "pool, 1 machine": one, "pool, 2 machines": two}
            for number, engine in enumerate(engines.values()):
                await asyncio.gather(*(_one(engine, root / f"warm-{number}-{k}") for k in range(engine.places)))
            await _jobs(own, root / "warm", 1)  # kernels are compiled and files read before the clock starts
            one.costs.clear()
            two.costs.clear()
            took = dict.fromkeys(engines, 0.0)
            made: dict[str, list[str]] = {name: [] for name in engines}
            for turn in range(ROUNDS):
                for number, (name, engine) in enumerate(engines.items()):
                    seconds, hashes = await _jobs(engine, root / f"turn-{turn}-{number}", JOBS)
                    took[name] += seconds
                    made[name] += hashes
            moved = {"embedded": [], "pool, 1 machine": list(one.costs), "pool, 2 machines": list(two.costs)}
            one.costs.clear()
            beside = [(await _one(own, root / f"own-{k}"), await _one(one, root / f"pool-one-{k}")) for k in range(SMALLEST)]
            costs = list(one.costs)
    rows: list[list[Cell]] = [
        [
            name, engine.places, took[name], took["embedded"] / took[name], took["pool, 1 machine"] / took[name],
            sum(cost.sent_bytes for cost in moved[name]) / 1e6, sum(cost.fetched_bytes for cost in moved[name]) / 1e6,
            "the same bytes" if made[name] == made["embedded"] else "OTHER BYTES",
        ]
        for name, engine in engines.items()
    ]  # fmt: skip
    note = f"{ROUNDS} times {JOBS} jobs ({', '.join(STAGES)}), the engines in turn; {_load()}. Results are compared by hash."
    columns = ["engine", "places", "wall s", "to embedded", "to 1 machine", "sent MB", "fetched MB", "results"]
    return [Table("Planning on more machines", columns, rows, note), _costs(*zip(*beside, strict=True), costs)]


def _load() -> str:
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"


def _costs(own: Sequence[float], pool: Sequence[float], costs: Sequence[Costs]) -> Table:
    """What a task on a pool takes beside its work, by its parts: medians, ms."""
    parts = {
        "its files hashed": [cost.pack_s for cost in costs],
        "until a machine has begun it": [cost.wait_s for cost in costs],
        "files that the machine lacks, and their places": [cost.send_s for cost in costs],
        "results fetched and checked": [cost.fetch_s for cost in costs],
    }
    rows: list[list[Cell]] = [[name, 1000.0 * statistics.median(values), 1000.0 * max(values)] for name, values in parts.items()]
    beside = [whole - cost.work_s for whole, cost in zip(pool, costs, strict=True)]
    rows.append(["all of it beside the work", 1000.0 * statistics.median(beside), 1000.0 * max(beside)])
    rows.append(["whole task on the pool", 1000.0 * statistics.median(pool), 1000.0 * max(pool)])
    rows.append(["the same task embedded", 1000.0 * statistics.median(own), 1000.0 * max(own)])
    note = f"{SMALLEST} inspections of the pipe's mesh one after another, 1 machine; {_load()}. The first sends the mesh, the others find it there."
    return Table("Cost of a task on a pool", ["part", "median ms", "most ms"], rows, note)


async def _one(engine: Engine, folder: Path) -> float:
    """Wall time of the cheapest task, s."""
    folder.mkdir(parents=True)
    task = Task(kind="inspect", folder=str(folder), parent=0, memory_bytes=0, mesh=str(FACTS_DIR / "parts" / "pipe.stl"))
    started = time.perf_counter()
    await engine.run(task, quiet)
    return time.perf_counter() - started


async def _jobs(engine: Engine, root: Path, count: int) -> tuple[float, list[str]]:
    """(wall time, s, hash of all files of each job): as many jobs at once as the engine has places, as the planning queue does."""
    root.mkdir(parents=True)
    places = asyncio.Semaphore(engine.places)

    async def job(number: int) -> str:
        async with places:
            return await _job(engine, root / str(number), number)

    started = time.perf_counter()
    made = await asyncio.gather(*(job(number) for number in range(count)))
    return time.perf_counter() - started, list(made)


async def _job(engine: Engine, folder: Path, number: int) -> str:
    """Plan, post and prove a block; the hash of everything that came of it."""
    folder.mkdir()
    mesh = folder / "block.stl"
    trimesh.creation.box((10.0 + number, 8.0, 1.6)).export(mesh)
    steps: list[tuple[str, dict[str, str]]] = [
        ("plan", {"recipe_toml": "layer_height_mm = 0.8"}),
        ("post", {"plan": str(folder / "plan" / PLAN_FILE)}),
        ("prove", {"program": str(folder / "post" / PROGRAM_FOLDER)}),
    ]
    for kind, fields in steps[: len(STAGES)]:
        place = folder / kind
        place.mkdir()
        task = Task(kind=kind, folder=str(place), parent=0, memory_bytes=0, part_name="block", mesh=str(mesh), cell=CELL_FILE, **fields)  # type: ignore[arg-type]
        await engine.run(task, quiet)
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


@asynccontextmanager
async def _pool(folder: Path, machines: int) -> AsyncIterator[Pool]:
    """A scheduler, machines and the link to them, ended afterwards."""
    for part in ("files", "scratch"):
        (folder / part).mkdir(parents=True)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    words = [["planner-scheduler", address]]
    words += [["planner-worker", address, "--name", f"machine {k}", "--folder", str(folder / f"machine-{k}")] for k in range(machines)]
    begin, silent = (sys.executable, "-m", "cellctl"), asyncio.subprocess.DEVNULL
    processes = [await asyncio.create_subprocess_exec(*begin, *one, stdout=silent, stderr=silent) for one in words]
    pool = Pool(PoolWire(address), folder / "files", folder / "scratch", software_version())
    keeping = asyncio.create_task(pool.keep())
    try:
        async with asyncio.timeout(START_S):
            while pool.state.places < machines:
                await asyncio.sleep(0.05)
        yield pool
    finally:
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)
        for process in processes:
            process.terminate()
        for process in processes:
            await process.wait()
