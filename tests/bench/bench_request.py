"""From a REST request to its byte at the far end of the serial line, while a program streams: hold and stop, at rest and under load."""

from __future__ import annotations

import asyncio
import math
import os
import random
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import httpx
import websockets

from cellctl.cell.ipc import encode, read_message
from cellctl.domain.messages import PROTOCOL, Command, Hello, Live, Reply
from config.cell import Cell, load_cell
from planner.files import write_program
from planner.program import Channel, LineKind, Program
from tests.bench.served import Served, served
from tests.bench.table import Table
from tests.cell.jobs import Writer

BAUD = 115_200
CLIENT = "bench"
CONSOLES = 20
UPLOAD_BYTES = 200_000_000 - 4096
CHUNK = 1 << 20
HOLDS = int(os.environ.get("BENCH_REQUEST_HOLDS", "104"))
STOPS = int(os.environ.get("BENCH_REQUEST_STOPS", "8"))
LINES = 60_000
STEP_MM = 0.25
FEED_MM_S = 20.0
TIMEOUT_S = 30.0
HOLD, CONVERSATION_S = ord("!"), 60.0


def shuttle(cell: Cell) -> Program:
    """LINES short lines to and fro with the laser locked out: a wire that is well used, and a hold that waits for no light."""
    w = Writer(cell)
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.layer = w.operation = 0
    n = w.move(0.0, 0.0, 60.0, LineKind.LINK, 100.0)
    w.at(n, Channel.MODE, 0, barrier=True)
    for k in range(LINES):
        x = (k + 1) % 400
        w.move(STEP_MM * min(x, 400 - x), 0.0, 60.0, LineKind.LINK, FEED_MM_S)
    w.line("M2", LineKind.SETUP)
    return w.program("shuttle", [1])


class FaultedError(Exception):
    """The cell latched a fault meanwhile."""


class Hand:
    """Requests over REST, and the cell's state by its own socket."""

    def __init__(self, service: Served, client: httpx.AsyncClient) -> None:
        self.service, self.client = service, client
        self.state = self.because = ""
        self.faults: list[str] = []

    async def watch(self) -> None:
        """Keep `state` the newest."""
        reader, writer = await asyncio.open_unix_connection(self.service.run / "cell.sock")
        writer.write(encode(Hello(PROTOCOL, "bench")))
        try:
            while True:
                message = await read_message(reader)
                if isinstance(message, Live):
                    self.state, self.because = message.snapshot.state, message.snapshot.because
        finally:
            writer.close()

    async def until(self, *states: str) -> None:
        """Wait for a state. Raises TimeoutError, FaultedError."""
        async with asyncio.timeout(CONVERSATION_S):
            while self.state not in states:
                if self.state == "FAULT" and "STOPPED" not in states:
                    raise FaultedError(self.because)
                await asyncio.sleep(0.02)

    async def start(self, program: Path, job: str) -> None:
        """Start a program as the operator does, past the web process. Raises RuntimeError."""
        reader, writer = await asyncio.open_unix_connection(self.service.run / "cell.sock")
        writer.write(encode(Hello(PROTOCOL, "bench")))
        args = {"job": job, "name": job, "program": str(program)}
        writer.write(encode(Command(f"start-{job}", "start", "operator", "bench", args, client=f"operator/{CLIENT}")))
        while not isinstance(message := await read_message(reader), Reply):
            pass
        writer.close()
        if not message.ok:
            raise RuntimeError(f"start: {message.error}; {message.hint}")

    async def post(self, verb: str) -> tuple[float, float]:
        """(when it was asked, when it was answered), monotonic s. Raises RuntimeError."""
        asked = time.monotonic()
        answer = await self.client.post(f"/api/v1/cell/{verb}", json={"because": "bench"})
        if answer.status_code != 200 and "while the cell is FAULT" in answer.text:
            raise FaultedError(answer.text)
        if answer.status_code != 200:
            raise RuntimeError(f"{verb}: {answer.text}")
        return asked, time.monotonic()


@asynccontextmanager
async def load(service: Served, is_on: bool) -> AsyncIterator[list[int]]:
    """CONSOLES live feeds and an endless upload of parts at the limit; counts the uploads that came to their end."""
    done: list[int] = []
    tasks = [asyncio.create_task(_console(service)) for _ in range(CONSOLES)] if is_on else []
    uploader = None
    if is_on:
        script = [sys.executable, "-m", "tests.bench.bench_request", service.url, service.token]
        uploader = await asyncio.create_subprocess_exec(*script, stdout=asyncio.subprocess.PIPE)
    try:
        yield done
    finally:
        if uploader is not None:
            uploader.terminate()
            said, _ = await uploader.communicate()
            done.extend(int(word) for word in said.split())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _console(service: Served) -> None:
    headers = {"Authorization": f"Bearer {service.token}"}
    url = service.url.replace("http", "ws") + "/api/v1/live"
    async with websockets.connect(url, additional_headers=headers, proxy=None) as feed:
        while True:
            await feed.recv()


async def upload_for_ever(url: str, token: str) -> None:
    """One upload after the other, a status code per line. What is sent is no mesh: the upload is what loads, not its inspection."""
    bound = "b0undary"
    head = f'--{bound}\r\nContent-Disposition: form-data; name="file"; filename="big.stl"\r\nContent-Type: model/stl\r\n\r\n'.encode()
    tail = f"\r\n--{bound}--\r\n".encode()
    piece = random.Random(1).randbytes(CHUNK)

    async def body() -> AsyncIterator[bytes]:
        yield head
        for _ in range(UPLOAD_BYTES // CHUNK):
            yield piece
        yield tail

    headers = {"Authorization": f"Bearer {token}", "Content-Type": f"multipart/form-data; boundary={bound}"}
    async with httpx.AsyncClient(base_url=url, headers=headers, trust_env=False, timeout=600.0) as client:
        while True:
            answer = await client.post("/api/v1/parts", content=body())
            print(answer.status_code, flush=True)


async def rounds(hand: Hand, program: Path, holds: int, stops: int, name: str) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """(asked, answered) of holds, and of stops: the job is resumed, or reset and started again, between two."""
    pause = random.Random(7)
    held: list[tuple[float, float]] = []
    stopped: list[tuple[float, float]] = []
    while len(stopped) < stops:
        with suppress(FaultedError):
            await hand.until("IDLE")
            await hand.start(program, f"{name}-{len(stopped)}-{len(hand.faults)}")
            await hand.until("RUNNING")
            await asyncio.sleep(0.5)
            for _ in range(holds // stops):
                await asyncio.sleep(pause.uniform(0.1, 0.3))
                asked = await hand.post("hold")
                await hand.until("HELD")
                held.append(asked)
                await hand.post("resume")
                await hand.until("RUNNING")
            await asyncio.sleep(pause.uniform(0.3, 0.6))
            stopped.append(await hand.post("stop"))
            await hand.until("STOPPED")
        if hand.state == "FAULT":
            hand.faults.append(hand.because)
        await _reset(hand)
    return held, stopped


async def _reset(hand: Hand) -> None:
    for _ in range(50):
        with suppress(RuntimeError):
            await hand.post("reset")
            if hand.state in ("IDLE", "UNHOMED"):
                break
        await asyncio.sleep(0.2)
    if hand.state == "UNHOMED":
        await hand.post("unlock")
    await hand.until("IDLE")


def arrivals(log: Path) -> list[float]:
    """When a hold reached the far end, monotonic s."""
    words = (line.split() for line in log.read_text().splitlines() if line[0].isdigit())
    return [float(at) for byte, at in words if int(byte) == HOLD]


def delays(asked: list[tuple[float, float]], arrived: list[float]) -> list[float]:
    """Request to byte, ms, ordered."""
    return sorted(1e3 * (min((at for at in arrived if at >= begin), default=math.inf) - begin) for begin, _ in asked)


async def measure(service: Served, program: Path, is_loaded: bool) -> list[tuple[str, int, float, float, float, float]]:
    """Rows of holds and stops with or without load."""
    headers = {"Authorization": f"Bearer {service.token}", "X-Client-Id": CLIENT}
    async with httpx.AsyncClient(base_url=service.url, headers=headers, trust_env=False, timeout=TIMEOUT_S) as client:
        hand = Hand(service, client)
        watching = asyncio.create_task(hand.watch())
        async with load(service, is_loaded) as uploads:
            held, stopped = await rounds(hand, program, HOLDS, STOPS, f"loaded-{is_loaded}")
        watching.cancel()
    arrived = arrivals(service.run / "tap.log")
    if hand.faults:
        print(f"faults meanwhile: {hand.faults}", file=sys.stderr)
    name = f"{CONSOLES} consoles and {len(uploads)} uploads of 200 MB" if is_loaded else "nothing else"
    rows = []
    for verb, asked in (("hold", held), ("stop", stopped)):
        ms = delays(asked, arrived)
        answered = sorted(1e3 * (end - begin) for begin, end in asked)
        rows.append((f"{verb}, {name}", len(ms), ms[len(ms) // 2], ms[int(0.99 * (len(ms) - 1))], ms[-1], answered[len(answered) // 2]))
    return rows


def run() -> list[Table]:
    """Without and with load, a program of short lines streaming all the while."""
    with tempfile.TemporaryDirectory(prefix="bench-request-") as place, served(tap_baud=BAUD) as service:
        program = Path(place) / "program"
        write_program(shuttle(load_cell(str(service.run / "cell.toml"))), program)
        rows = [row for is_loaded in (False, True) for row in asyncio.run(measure(service, program, is_loaded))]
    columns = ["request, beside it", "count", "p50 ms", "p99 ms", "max ms", "answered p50 ms"]
    note = f"from before the POST to the byte behind a wire of {BAUD} baud; load of the machine at the end {os.getloadavg()[0]:.1f}"
    return [Table("From a REST request to the wire", columns, rows, note)]


if __name__ == "__main__":
    asyncio.run(upload_for_ever(*sys.argv[1:]))
