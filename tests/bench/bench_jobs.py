"""A queue of 10,000 jobs: how fast it is listed, searched, submitted to, reordered, and its next job found; and what the process holds.

And a fleet: what a heartbeat costs, and how fast jobs for any cell are given out, on SQLite and on PostgreSQL beside it.
"""

from __future__ import annotations

import asyncio
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import httpx
from sqlalchemy import insert

from cellctl.api.app import build_service, make_app
from cellctl.api.context import Settings
from cellctl.domain.jobs import JobState
from cellctl.store import Store, jobs, lanes, open_store, parts, tokens, upgrade
from cellctl.store.jobs import JobRow
from cellctl.store.lanes import Lane
from cellctl.store.parts import Inspection, PartRow
from cellctl.store.postgres import open_postgres
from cellctl.store.schema import jobs as job_table
from cellctl.store.tokens import Role
from config import find_facts
from tests.bench.table import Table
from tests.postgres import find_binaries, running_cluster
from tests.unit.cellctl.fleet_of import Host, made_ready, submit

JOBS = 10_000
CALLS = 100
FLEET_JOBS = 200


def percentile(values: list[float], share: float) -> float:
    """Of a list that is not empty."""
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


def timed(name: str, call: Callable[[int], object]) -> tuple[str, float, float]:
    """(name, p50 ms, p99 ms) of CALLS calls."""
    times = []
    for number in range(CALLS):
        started = time.perf_counter()
        call(number)
        times.append(1000.0 * (time.perf_counter() - started))
    return name, percentile(times, 0.5), percentile(times, 0.99)


def fill(store: Store, count: int) -> str:
    """Queue `count` jobs of one part; its id. The rows are copies of one that was added as any other."""
    with store.write() as rows:
        inspection = Inspection("m" * 64, [[0, 0, 0], [1, 1, 1]], 12, 1.0, [])
        parts.add(rows, PartRow("part-0", "block", ".stl", "mm", "f" * 64, 684, 0.0, "me", inspection))
        jobs.add(rows, JobRow("job-first", "first", "part-0", "trunnion-tcp", 'process = "deposit"\n', "316L", 0.0, "me", JobState.QUEUED))
        first = dict(rows.execute(job_table.select()).mappings().one())
        rest = [
            {**first, "seq": first["seq"] + k, "id": f"job-{k:08d}", "name": f"part number {k}", "rank": first["rank"] + k * lanes.GAP}
            for k in range(1, count)
        ]
        rows.execute(insert(job_table), rest)
        rows.exec_driver_sql("UPDATE job_counts SET count = (SELECT count(*) FROM jobs WHERE jobs.state = job_counts.state)")
    return "part-0"


def in_store(store: Store, count: int) -> list[tuple[str, float, float]]:
    """What the service does by itself, on the rows."""

    def read(call: Callable[[object], object]) -> Callable[[int], object]:
        def one(_number: int) -> object:
            with store.read() as rows:
                return call(rows)

        return one

    def reorder(number: int) -> None:
        with store.write() as rows:
            moved = f"job-{count // 2 + number:08d}"
            place = lanes.place_of(rows, Lane.CELL, f"job-{count // 4:08d}")
            lanes.insert_between(rows, Lane.CELL, moved, lanes.neighbour(rows, Lane.CELL, place, False), place)

    return [
        timed("the queue's next", read(lambda rows: jobs.first_in(rows, JobState.QUEUED, 1))),  # type: ignore[arg-type]
        timed("those that may start", read(lambda rows: jobs.confirmed(rows))),  # type: ignore[arg-type]
        timed("those on or near the cell", read(lambda rows: jobs.on_or_near_cell(rows))),  # type: ignore[arg-type]
        timed("counts by state", read(lambda rows: jobs.count_by_state(rows))),  # type: ignore[arg-type]
        timed("a move in the middle, durable", reorder),
    ]


async def over_rest(settings: Settings, token: str) -> list[tuple[str, float, float]]:
    """The same over REST, in this process: without the socket."""
    service = build_service(settings)
    app = make_app(service, "127.0.0.1")
    service.queue._slots = 0  # nothing is planned
    rows = []
    transport = httpx.ASGITransport(app)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000", headers={"Authorization": f"Bearer {token}"}) as client,
    ):

        async def ask(name: str, method: str, path: str, bodies: Callable[[int], object] | None = None) -> None:
            times = []
            for number in range(CALLS):
                started = time.perf_counter()
                answer = await client.request(method, path, json=bodies(number) if bodies else None)
                times.append(1000.0 * (time.perf_counter() - started))
                assert answer.status_code < 300, answer.text
            rows.append((name, percentile(times, 0.5), percentile(times, 0.99)))

        await ask("GET jobs, 50 newest", "GET", "/api/v1/jobs?limit=50")
        await ask("GET jobs, 50 queued in order", "GET", "/api/v1/jobs?limit=50&state=queued&sort=queue")
        await ask("GET jobs, a word in none of them", "GET", "/api/v1/jobs?text=nowhere")
        await ask("GET queue, 50", "GET", "/api/v1/queue?limit=50")
        await ask("POST jobs (submit, durable)", "POST", "/api/v1/jobs", lambda _k: {"part_id": "part-0", "recipe": {"process": "deposit"}})
        await ask("POST queue/move", "POST", "/api/v1/queue/move?limit=1", lambda k: {"job": f"job-{5000 + k:08d}", "to": "up"})
    return rows


def in_fleet(store: Store) -> tuple[float, float, float, float]:
    """(p50 ms, p99 ms of a heartbeat; s and jobs/s of giving out FLEET_JOBS jobs for any of three cells)"""
    part = made_ready(store)
    hosts = [Host(store, name, time.time) for name in ("alpha", "beta", "gamma")]
    _, p50, p99 = timed("heartbeat", lambda number: hosts[number % len(hosts)].beat())
    for _ in range(FLEET_JOBS):
        submit(store, part)
    started = time.perf_counter()
    given = 0
    while found := hosts[0].beat():
        given += len(found)
    taken_s = time.perf_counter() - started
    assert given == FLEET_JOBS
    return p50, p99, taken_s, FLEET_JOBS / taken_s


def fleet_table() -> Table:
    """Both databases in one run, on the same disk."""
    rows: list[tuple[object, ...]] = []
    with tempfile.TemporaryDirectory(prefix="cellctl-bench-") as name:
        folder = Path(name) / "store"
        upgrade(folder)
        store = open_store(folder)
        rows.append(("SQLite", *in_fleet(store)))
        if find_binaries() is not None:
            with running_cluster() as cluster:
                engine = open_postgres(cluster.url(cluster.fresh()))
                rows.append(("PostgreSQL, fsync off", *in_fleet(replace(store, engine=engine))))
                engine.dispose()
        store.close()
    head = ("database", "heartbeat p50 ms", "p99 ms", f"{FLEET_JOBS} jobs given out, s", "jobs/s")
    note = "three cells, each with a heartbeat every 2 s; up to 50 jobs are given out in one transaction"
    return Table("Fleet: heartbeat and dispatch", head, rows, note)


def run() -> list[Table]:
    """Fill two stores and ask both; the small one shows what does not grow with the queue."""
    found: list[list[tuple[str, float, float]]] = []
    for count in (400, JOBS):
        with tempfile.TemporaryDirectory(prefix="cellctl-bench-") as name:
            folder = Path(name)
            upgrade(folder / "store")
            (folder / "run").mkdir()
            store = open_store(folder / "store")
            fill(store, count)
            with store.write() as rows:
                _, secret = tokens.create(rows, "me", Role.OPERATOR, store.clock())
            found.append(in_store(store, count))
            store.close()
            if count == JOBS:
                before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
                settings = Settings(folder / "store", folder / "run", find_facts("cells", "trunnion_tcp"))
                rest = asyncio.run(over_rest(settings, secret))
                grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    rows_ = [(name, few, p50, p99) for (name, few, _), (_, p50, p99) in zip(*found, strict=True)]
    note = f"{CALLS} calls each, one after the other; the first column on a queue of 400"
    submits = next(1000.0 / p50 for name, p50, _ in rest if "submit" in name)
    return [
        Table("Jobs: a queue of 10,000 in the store", ("what", "p50 ms of 400", "p50 ms", "p99 ms"), rows_, note),
        Table(
            "Jobs: a queue of 10,000 over REST", ("request", "p50 ms", "p99 ms"), rest,
            f"in this process, without a socket, one client; {submits:.0f} submits/s; greatest memory grew by {grown:.0f} MiB",
        ),
        fleet_table(),
    ]  # fmt: skip
