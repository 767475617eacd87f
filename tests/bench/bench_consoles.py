"""What twenty consoles cost: CPU of the web process and of the cell process with none and with twenty live feeds of a running cell."""

from __future__ import annotations

import asyncio
import itertools
import time
from pathlib import Path

import websockets

from tests.bench.served import Served, cpu_s, served
from tests.bench.table import Table

CONSOLES = 20
SECONDS = 30.0
SETTLE_S = 3.0  # sign-in and replay are over
LATE_S = 0.25  # a gap between snapshots that a person may notice


def web_pid(place: Served) -> int:
    """Process id of the web process. Raises LookupError."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, IndexError):
            continue
        if b"cellctl.api" in words and parent == place.service.pid:
            return int(entry.name)
    raise LookupError("no web process")


async def _console(url: str, token: str, times: list[float], until: float) -> int:
    """Listen as a console does; the times of the snapshots are kept. Bytes received."""
    size = 0
    headers = {"Authorization": f"Bearer {token}"}
    async with websockets.connect(url.replace("http", "ws") + "/api/v1/live", additional_headers=headers, proxy=None) as feed:
        while time.monotonic() < until:
            text = await feed.recv()
            size += len(text)
            if '"snapshot"' in str(text)[:40]:
                times.append(time.monotonic())
    return size


async def listen(place: Served, consoles: int, pids: dict[str, int]) -> tuple[dict[str, float], list[list[float]], float]:
    """(share of a core by process, times of the snapshots of every console, kB/s of one) over SECONDS after SETTLE_S."""
    begin = time.monotonic() + SETTLE_S
    times: list[list[float]] = [[] for _ in range(consoles)]
    tasks = [asyncio.create_task(_console(place.url, place.token, one, begin + SECONDS)) for one in times]
    await asyncio.sleep(SETTLE_S)
    before = {name: cpu_s(pid) for name, pid in pids.items()}
    await asyncio.sleep(SECONDS)
    shares = {name: (cpu_s(pid) - before[name]) / SECONDS for name, pid in pids.items()}
    sizes = await asyncio.gather(*tasks)
    return shares, [[at for at in one if at >= begin] for one in times], sum(sizes) / max(consoles, 1) / (SECONDS + SETTLE_S) / 1000


def _row(consoles: int, found: tuple[dict[str, float], list[list[float]], float]) -> list[str | int | float]:
    shares, times, kb_s = found
    gaps = sorted(after - before for one in times for before, after in itertools.pairwise(one))
    late = sum(gap > LATE_S for gap in gaps)
    rate = sum(len(one) for one in times) / max(consoles, 1) / SECONDS
    p99 = 1000 * gaps[int(0.99 * len(gaps))] if gaps else 0.0
    return [consoles, 100 * shares["web"], 100 * shares["cell"], rate, p99, late, kb_s]


def run() -> list[Table]:
    """None, twenty, none again: what the cell process does by itself changes between two looks too."""
    with served() as place:
        pids = {"web": web_pid(place), "cell": place.cell_pid()}
        found = [(count, asyncio.run(listen(place, count, pids))) for count in (0, CONSOLES, 0)]
    rows = [_row(count, one) for count, one in found]
    cell = [one[0]["cell"] for _, one in found]
    web = found[1][1][0]["web"]
    note = (
        f"{SECONDS:g} s each, in this order, a simulated cell at rest; % of one core. The web process with {CONSOLES} consoles: "
        f"{web:.2f} of a core. The cell process: {cell[1]:.4f} of a core with them, {cell[0]:.4f} before and {cell[2]:.4f} after "
        f"(ratio {2 * cell[1] / (cell[0] + cell[2]):.2f})."
    )
    columns = ("consoles", "web %", "cell %", "snapshots 1/s each", "p99 gap ms", f"gaps > {1000 * LATE_S:g} ms", "kB/s each")
    return [Table("Twenty consoles", columns, rows, note)]
