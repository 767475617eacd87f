"""What the REST interface carries: reads of one, of many and of what is known already, changes, and a large file in pieces.

BENCH_UPLOAD_MB=1000 sends a file of 1 GB instead of the usual size.
"""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from cellctl.client import Client
from cellctl.client_upload import PIECE_BYTES, TUS, announced, sent
from tests.bench.bench_web import CLIENTS, SECONDS, rate
from tests.bench.table import Table

START_S = 180.0
UPLOAD_MB = 64
JOBS = 200
PAGE = 50
CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class Service:
    """A service without a cell at its far end. pid : of the web process"""

    url: str
    token: str
    pid: int


@contextmanager
def service(folder: Path) -> Iterator[Service]:
    """`cellctl serve` in processes of its own, ended afterwards."""
    words = ["--store", str(folder / "store"), "--run", str(folder / "run"), "--port", "0", "--stop-port", "0"]
    with subprocess.Popen([sys.executable, "-m", "cellctl", "serve", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            address, end = folder / "run" / "service.json", time.monotonic() + START_S
            while not address.exists() or not address.read_text() or not web_pid(folder / "run"):
                if process.poll() is not None or time.monotonic() > end:
                    raise RuntimeError("the service did not start")
                time.sleep(0.1)
            time.sleep(1.0)
            token = (folder / "store" / "operator.token").read_text().strip()
            yield Service(json.loads(address.read_text())["url"], token, web_pid(folder / "run"))
        finally:
            process.terminate()


def web_pid(run: Path) -> int:
    """Process id of the web process of this run directory, 0 without one."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if b"cellctl.api" in words and str(run).encode() in words:
                return int(entry.name)
    return 0


def peak_mb(pid: int) -> float:
    """The most memory that a process had at once so far (VmHWM), MB."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024 / 1e6


def block() -> bytes:
    """A block of 12 x 8 x 2 mm."""
    import trimesh

    return bytes(trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl"))


async def requests(at: Service) -> Table:
    """Rates and times of reads and of changes."""
    headers = {"Authorization": f"Bearer {at.token}"}
    async with httpx.AsyncClient(base_url=at.url, headers=headers, trust_env=False, timeout=60) as client:
        part = (await client.post("/api/v1/parts", files={"file": ("block.stl", block())})).json()["id"]
        later = {"part_id": part, "recipe": {"material": "316L"}}
        made = [(await client.post("/api/v1/jobs", json={**later, "name": f"job {number}"})).json()["id"] for number in range(JOBS)]
        for job in made:  # nothing is planned while it is measured
            await client.post(f"/api/v1/jobs/{job}/cancel", json={})
        one = f"/api/v1/jobs/{made[0]}"
        known = {"If-None-Match": (await client.get(one)).headers["etag"]}
        numbers = itertools.count()

        def asked(method: str, path: str, status: int, **options: Any) -> Callable[[], Awaitable[object]]:
            async def call() -> None:
                body = {**options.get("json", {})}
                if "name" in body:
                    body["name"] = f"job {next(numbers)}"
                given = {**options, "json": body} if "json" in options else options
                answer = await client.request(method, path, **given)
                if answer.status_code != status:
                    raise RuntimeError(f"{method} {path}: {answer.status_code} {answer.text[:200]}")

            return call

        hold = asked("POST", "/api/v1/cell/hold", (await client.post("/api/v1/cell/hold", json={})).status_code, json={})
        calls = [
            ("one job", asked("GET", one, 200)),
            ("one job, known already (304)", asked("GET", one, 304, headers=known)),
            (f"list of {PAGE} of {JOBS} jobs", asked("GET", f"/api/v1/jobs?limit={PAGE}", 200)),
            ("all materials", asked("GET", "/api/v1/materials", 200)),
            ("a job's name changed (durable, audited)", asked("PATCH", one, 200, json={"name": ""})),
            ("command to the cell (refused, audited)", hold),
        ]
        rows = [(what, *await rate(call)) for what, call in calls]
    return Table("REST: requests", ("request", "1/s", "p50 ms", "p99 ms"), rows, f"{CLIENTS} clients at once, {SECONDS:g} s each")


def copied(source: Path, target: Path) -> float:
    """Seconds to copy a file onto the disk and hash it on the way, as any server must at least."""
    started, digest = time.perf_counter(), hashlib.sha256()
    with source.open("rb") as file, target.open("wb") as out:
        while chunk := file.read(CHUNK_BYTES):
            digest.update(chunk)
            out.write(chunk)
        os.fsync(out.fileno())
    target.unlink()
    return time.perf_counter() - started


def upload(at: Service, folder: Path) -> Table:
    """A large file in pieces, each with its checksum, against a plain copy of the same bytes before and after."""
    megabytes = int(os.environ.get("BENCH_UPLOAD_MB", UPLOAD_MB))
    source, chunk = folder / "large.stl", os.urandom(CHUNK_BYTES)
    with source.open("wb") as file:
        for _ in range(megabytes):
            file.write(chunk[: 10**6])
    size, idle_mb = source.stat().st_size, peak_mb(at.pid)
    before = copied(source, folder / "copy")
    with Client(at.url, at.token) as client, source.open("rb") as file:
        place = announced(client, source.name, size, "mm", "")
        offset, started = 0, time.perf_counter()
        while offset < size:
            offset = sent(client, place, file, offset)
        took = time.perf_counter() - started
        most_mb = peak_mb(at.pid)
        client.request("DELETE", place, headers=TUS)
    plain = min(before, copied(source, folder / "copy"))
    row = (megabytes, size / 1e6 / took, size / 1e6 / plain, took / plain, idle_mb, most_mb)
    columns = ("MB", "upload MB/s", "copy + SHA-256 MB/s", "times as long", "peak RSS before, MB", "peak RSS after, MB")
    return Table("REST: upload in pieces", columns, [row], f"pieces of {PIECE_BYTES >> 20} MiB with checksum, one sender over loopback")


def run() -> list[Table]:
    """Serve, ask, and send."""
    with tempfile.TemporaryDirectory(prefix="bench-rest-") as name, service(Path(name)) as at:
        return [asyncio.run(requests(at)), upload(at, Path(name))]
