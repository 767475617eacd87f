"""One order on the pool: sent, fed with the files that its machine lacks, followed, its results fetched and checked."""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec

from cellctl.planning.pool import far
from cellctl.planning.pool.connection import LOOK_S, Connection, Gone
from cellctl.planning.pool.order import CHUNK_BYTES, Away, Costs, End, File, Order, OrderError, check_results
from cellctl.planning.task import Failed

SILENCE_S = 60.0  # a machine that says nothing for this long is lost, or cut off
LOSSES_MAX = 3
SENT_TWICE = 2  # results that arrive damaged are fetched once more


@dataclass
class Losses:
    """Machines that were lost with a task. by_run : in words, by the run"""

    by_run: dict[str, str] = field(default_factory=dict)

    @property
    def are_too_many(self) -> bool:
        """Whether the task itself is the likely cause."""
        return len(self.by_run) >= LOSSES_MAX

    def told(self, kind: str) -> Failed:
        """The losses as the cause."""
        return Failed(
            "Its planning machines were lost",
            f"this {kind} was begun {len(self.by_run)} times, and each time what worked on it was lost: {'; '.join(self.by_run.values())}",
            "look at the memory and the logs of these machines; a coarser mesh or recipe needs less",
            503,
        )


@dataclass
class Running:
    """Where a task is. heard_at : last sign of life, monotonic, s"""

    run: str
    address: str
    machine: str
    heard_at: float


class Attempt:
    """Call `carried_out` once. paths : files of the order, by hash   folder : for its results   losses : of all attempts together

    going, waits : as of `cellctl.planning.engine`
    """

    def __init__(
        self, connection: Connection, order: Order, paths: dict[str, Path], folder: Path, losses: Losses,
        going: Callable[[str, float], None], waits: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._connection, self._order, self._paths, self._folder, self._losses = connection, order, paths, folder, losses
        self._going, self._waits = going, waits
        self._heard: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._at: Running | None = None
        self._errand: asyncio.Task[End | None] | None = None
        self._have: dict[str, str] = {}
        self._times: dict[str, float] = {}
        self._sent_bytes = self._fetched_bytes = 0
        self._began = 0

    def hear(self, message: dict[str, Any]) -> None:
        """What the task's machine tells."""
        self._heard.put_nowait(message)

    async def carried_out(self) -> End | None:
        """How it ended; None if what worked on it was lost, once more. Raises Gone, OrderError."""
        self._stamp("submitted")
        future = self._connection.submit(self._order)
        watching = asyncio.create_task(self._watch(future))
        ticking = asyncio.create_task(self._tick())
        try:
            while True:
                end, is_over = await self._take(await self._heard.get())
                if is_over:
                    return end
                if self._losses.are_too_many:
                    return None
        finally:
            for task in (watching, ticking, self._errand):
                if task is not None:
                    task.cancel()
            with suppress(OSError):
                await future.cancel()

    async def _watch(self, future: Any) -> None:
        """What becomes of the order at the scheduler."""
        try:
            await future
            error: BaseException | None = None
        except BaseException as raised:  # noqa: BLE001  whatever the machine or dask raises is judged where it is told
            error = raised
        is_gone = future.status in ("cancelled", "lost")
        self.hear({"told": "over", "run": "", "error": error, "is_gone": is_gone})

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            self.hear({"told": "tick", "run": ""})

    async def _take(self, message: dict[str, Any]) -> tuple[End | None, bool]:
        """One message; (end, whether that is the end)."""
        told, run = message["told"], message["run"]
        if told == "left":
            if self._at is not None and self._at.run == run:
                self._at = None
                self._end_errand()
        elif told == "begun":
            self._begin(message)
        elif told == "over":
            return self._over(message)
        elif told == "errand":
            if self._errand is not None and run == id(self._errand):
                return self._back(self._errand)
        elif told == "tick":
            self._look()
        elif self._at is not None and run == self._at.run:
            self._at.heard_at = time.monotonic()
            self._follow(told, message)
        return None, False

    def _begin(self, message: dict[str, Any]) -> None:
        """A machine took it. If another had it before, that one is lost: dask gives a task to a second machine for no other reason."""
        if self._at is not None:
            self._lose("was lost")
        self._began += 1
        self._at = Running(message["run"], message["address"], message["machine"], time.monotonic())
        self._have.clear()
        self._stamp("begun")
        self._waits("")

    def _lose(self, how: str) -> None:
        if self._at is not None:
            self._losses.by_run[self._at.run] = f"{self._at.machine} {how}"
            self._at = None
            self._end_errand()

    def _follow(self, told: str, message: dict[str, Any]) -> None:
        if told == "wants":
            self._start(self._send(message["files"]))
        elif told == "works":
            self._stamp("works")
        elif told == "going":
            self._going(str(message["stage"]), float(message["share"]))
        elif told == "made":
            self._stamp("made")
            self._start(self._fetch())

    def _look(self) -> None:
        """Once a second: is its machine still there, and what has it finished?"""
        if self._at is None:
            taken = f"all {self._connection.places} places of the planning pool are taken: it waits for one"
            self._waits(self._connection.why_none or taken)
        elif self._at.address not in self._connection.machines and time.monotonic() - self._at.heard_at > 2 * LOOK_S:
            self._lose("was lost")
        elif time.monotonic() - self._at.heard_at > SILENCE_S:
            self._lose(f"was silent for {SILENCE_S:.0f} s")
            self.hear({"told": "over", "run": "", "error": None, "is_gone": False})
        elif self._order.task.kind == "plan" and "made" not in self._times and "works" in self._times and self._errand is None:
            self._start(self._fetch_so_far())

    def _over(self, message: dict[str, Any]) -> tuple[End | None, bool]:
        error = message["error"]
        if message["is_gone"]:
            raise Gone
        if type(error).__name__ == "KilledWorker":
            self._lose("was lost")
            return None, True
        if error is None or isinstance(error, TimeoutError | asyncio.CancelledError):
            return None, self._errand is None or "made" not in self._times
        detail = f"{type(error).__name__}: {error}".splitlines()[0]
        return End(Failed("The planning pool cannot do this", detail, "look at the log of the planning machine", 503)), True

    def _start(self, errand: Any) -> None:
        """Something is moved while messages are still heard; one thing at a time."""
        self._end_errand()
        task = asyncio.create_task(errand)
        task.add_done_callback(lambda done: self.hear({"told": "errand", "run": id(done)}))
        self._errand = task

    def _end_errand(self) -> None:
        if self._errand is not None:
            self._errand.cancel()
            self._errand = None

    def _back(self, errand: asyncio.Task[End | None]) -> tuple[End | None, bool]:
        """An errand is done. A machine that went in between is noticed by its silence, or as another begins."""
        self._errand = None
        try:
            end = errand.result()
        except (Away, asyncio.CancelledError):
            return None, False
        if end is None:
            return None, False
        self._stamp("fetched")
        if end.is_lost:
            self._lose("lost the process that worked on it")
            return None, True
        return end, True

    def _place(self) -> Running:
        if self._at is None:
            raise Away("the task is at no machine")
        return self._at

    async def _send(self, wanted: list[str]) -> None:
        """Files that the machine lacks, piece by piece."""
        at = self._place()
        for sha256 in wanted:
            offset, path = 0, self._paths[sha256]
            size = path.stat().st_size
            with path.open("rb") as file:
                while True:
                    piece = await asyncio.to_thread(file.read, CHUNK_BYTES)
                    await self._connection.call(far.put, at.run, sha256, offset, piece, at=at.address)
                    offset += len(piece)
                    self._sent_bytes += len(piece)
                    at.heard_at = time.monotonic()
                    if offset >= size or not piece:
                        break

    async def _fetch_so_far(self) -> None:
        at = self._place()
        files = msgspec.json.decode(await self._connection.call(far.so_far, at.run, at=at.address), type=list[File])
        for file in check_results(files):
            await self._fetch_file(at, file)

    async def _fetch(self) -> End:
        """Results, whole and as announced."""
        at = self._place()
        end = msgspec.json.decode(await self._connection.call(far.ended, at.run, at=at.address), type=End)
        for file in check_results(end.files):
            if self._have.get(file.name) != file.sha256:
                await self._fetch_file(at, file)
        await self._connection.call(far.taken, at.run, at=at.address)
        return end

    async def _fetch_file(self, at: Running, file: File) -> None:
        target = self._folder / file.name
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f"{target.name}.part")
        for _ in range(SENT_TWICE):
            digest, offset = hashlib.sha256(), 0
            with part.open("wb") as stream:
                while offset < file.size:
                    piece = await self._connection.call(far.piece, at.run, file.name, offset, CHUNK_BYTES, at=at.address)
                    if not piece or offset + len(piece) > file.size:
                        break
                    digest.update(piece)
                    await asyncio.to_thread(stream.write, piece)
                    offset += len(piece)
                    at.heard_at = time.monotonic()
            self._fetched_bytes += offset
            if offset == file.size and digest.hexdigest() == file.sha256:
                part.replace(target)
                self._have[file.name] = file.sha256
                return
        part.unlink()
        raise OrderError(f"{file.name} came damaged from {at.machine}, {SENT_TWICE} times: its hash is not the one that was announced")

    def _stamp(self, what: str) -> None:
        self._times[what] = time.monotonic()

    def costs(self, pack_s: float) -> Costs:
        """Where the time of this attempt went."""
        at = [self._times.get(name, 0.0) for name in ("submitted", "begun", "works", "made", "fetched")]
        wait_s, send_s, work_s, fetch_s = (max(b - a, 0.0) if a and b else 0.0 for a, b in pairwise(at))
        machine = self._at.machine if self._at is not None else ""
        return Costs(pack_s, wait_s, send_s, work_s, fetch_s, self._sent_bytes, self._fetched_bytes, self._began, machine)
