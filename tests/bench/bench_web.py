"""How fast the web process answers: reads, commands, uploads and the live feed, over loopback to a served cell without devices."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import httpx
import trimesh
import websockets

from tests.bench.table import Table

SECONDS = 3.0
CLIENTS = 8
START_S = 60.0
LIVE_VIEWERS = 20


def percentile(values: list[float], share: float) -> float:
    """Of a list that is not empty."""
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


async def rate(call: Callable[[], Awaitable[object]], clients: int = CLIENTS, seconds: float = SECONDS) -> tuple[float, float, float]:
    """(calls per second, p50 in ms, p99 in ms) of `clients` that call one after the other."""
    times: list[float] = []
    end = time.perf_counter() + seconds

    async def one() -> None:
        while (started := time.perf_counter()) < end:
            await call()
            times.append(time.perf_counter() - started)

    await asyncio.gather(*(one() for _ in range(clients)))
    return len(times) / seconds, 1000 * percentile(times, 0.5), 1000 * percentile(times, 0.99)


async def viewers(url: str, token: str) -> tuple[float, float]:
    """(snapshots per second and viewer, p99 in ms of the gap between two) with LIVE_VIEWERS live feeds."""
    gaps: list[float] = []
    counts: list[int] = []

    async def one() -> None:
        headers = {"Authorization": f"Bearer {token}"}
        async with websockets.connect(url.replace("http", "ws") + "/api/v1/live", additional_headers=headers, proxy=None) as feed:
            last, end, count = 0.0, time.perf_counter() + SECONDS, 0
            while time.perf_counter() < end:
                if json.loads(await feed.recv())["type"] == "snapshot":
                    now = time.perf_counter()
                    if last:
                        gaps.append(now - last)
                    last, count = now, count + 1
            counts.append(count)

    await asyncio.gather(*(one() for _ in range(LIVE_VIEWERS)))
    return sum(counts) / len(counts) / SECONDS, 1000 * percentile(gaps, 0.99)


async def measure(url: str, token: str) -> list[Table]:
    """All figures of one running service."""
    async with httpx.AsyncClient(base_url=url, headers={"Authorization": f"Bearer {token}"}, trust_env=False, timeout=60) as client:

        def get(path: str) -> Callable[[], Awaitable[object]]:
            return lambda: client.get(path)

        part = bytes(trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl"))
        rows: list[tuple[str, float, float, float]] = []
        for path in ("/healthz", "/api/v1/cell", "/api/v1/jobs", "/api/v1/materials"):
            rows.append((f"GET {path}", *await rate(get(path))))
        rows.append(("POST /api/v1/cell/hold (refused, audited)", *await rate(lambda: client.post("/api/v1/cell/hold", json={}))))
        rows.append(("POST /api/v1/cell/stop", *await rate(lambda: client.post("/api/v1/cell/stop", json={}), clients=1)))
        upload = {"file": ("block.stl", part)}
        rows.append(("POST /api/v1/parts (inspected by a worker)", *await rate(lambda: client.post("/api/v1/parts", files=upload), clients=1)))
        per_second, gap = await viewers(url, token)
    table = Table("Web: requests", ("request", "1/s", "p50 ms", "p99 ms"), rows, f"{CLIENTS} clients, {SECONDS:g} s each; stop and upload: 1 client")
    live = Table("Web: live feed", ("viewers", "snapshots 1/s each", "p99 gap ms"), [(LIVE_VIEWERS, per_second, gap)])
    return [table, live]


def run() -> list[Table]:
    """Serve a cell whose devices are absent, and ask it."""
    with tempfile.TemporaryDirectory(prefix="cellctl-bench-") as name:
        folder = Path(name)
        words = ["--store", str(folder / "store"), "--run", str(folder / "run"), "--port", "0", "--stop-port", "0"]
        service = subprocess.Popen([sys.executable, "-m", "cellctl", "serve", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            address = folder / "run" / "service.json"
            end = time.monotonic() + START_S
            while not address.exists() or not address.read_text():
                if service.poll() is not None or time.monotonic() > end:
                    raise RuntimeError("the service did not start")
                time.sleep(0.1)
            time.sleep(1.0)
            return asyncio.run(measure(json.loads(address.read_text())["url"], (folder / "store" / "operator.token").read_text().strip()))
        finally:
            service.terminate()
            service.wait(30)
