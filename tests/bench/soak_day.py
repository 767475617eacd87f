"""A day at a served cell: job after job with holds, stops, consoles that come and go and a plan now and then, and what became of it."""

from __future__ import annotations

import asyncio
import json
import random
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import trimesh
import websockets

from cellctl.api.cell_link import CellLink
from cellctl.client import Client, ServiceError
from cellctl.domain.messages import Event, Reply
from cellctl.domain.snapshot import Snapshot
from tests.bench.served import Served
from tests.bench.soak_far_end import TOLD
from tests.bench.soak_watch import Watch

CLIENT = "soak"
WHO = "operator"
CONSOLES = 3
LOOK_S = 1.0
TELL_S = 30.0
ASK_S = 0.5
STATE_S = 90.0  # until the cell is in a state that it is on its way to
JOB_S = 900.0
STOP_EVERY = 5  # jobs: one of so many is stopped in the midst
PLAN_EVERY = 3
HOLDS_PER_JOB = 3
PLANNED = ("waiting_for_approval", "failed", "proven")
Document = dict[str, object]


class Day:
    """One soak. programs : folders that are run in turn; `spend` until so many simulated hours are over"""

    def __init__(self, service: Served, programs: list[Path], watch: Watch, hours: float) -> None:
        self.service, self._programs, self._watch, self._hours = service, programs, watch, hours
        self._chance = random.Random(7)
        self.link = CellLink(service.run / "cell.sock", self._snapshot, self._event, lambda: None)
        self.sent: Counter[str] = Counter()  # commands by verb that were answered
        self.started: list[str] = []
        self.faults: list[str] = []
        self.events: list[int] = []  # seq of every event that came
        self.longest_ms = self.jitter_ms = 0.0
        self.first: Snapshot | None = None
        self.plans: Counter[str] = Counter()
        self.consoles = 0
        self.planning: threading.Thread | None = None
        self.broke_off = ""  # what ended the day before its time
        self._is_over = threading.Event()

    # -- what is told --------------------------------------------------------------------------------------------------

    def _snapshot(self, snapshot: Snapshot) -> None:
        if snapshot.cnc.connected and self.first is None:
            self.first = snapshot
        self.longest_ms = max(self.longest_ms, snapshot.tick.longest_ms)
        self.jitter_ms = max(self.jitter_ms, snapshot.tick.jitter_p99_ms)

    def _event(self, event: Event) -> None:
        self.events.append(event.seq)
        if event.kind == "alarm":
            self.faults.append(event.text)

    @property
    def state(self) -> str:
        """The cell's state."""
        return self.link.snapshot.state if self.link.snapshot is not None else ""

    @property
    def witness(self) -> dict[str, float]:
        """What the plant's witness told last."""
        seen: dict[str, float] = json.loads((self.service.run / TOLD).read_text(encoding="utf-8"))
        return seen

    @property
    def hour(self) -> float:
        """Simulated hours since the far end began."""
        return float(self.witness["process_s"]) / 3600.0

    # -- the day -------------------------------------------------------------------------------------------------------

    def spend(self) -> None:
        """All of it; what ends it before its time is told in `broke_off`, and the rest is looked at all the same."""
        try:
            asyncio.run(self._live())
        except Exception as error:  # noqa: BLE001  the edge of the day: whatever it was, it is a finding
            causes = error.exceptions if isinstance(error, ExceptionGroup) else (error,)
            self.broke_off = "; ".join(f"{type(cause).__name__}: {cause}" for cause in causes)
        finally:
            self._is_over.set()

    async def _live(self) -> None:
        """Raises TimeoutError with what the cell said, alone or in a group."""
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(self.link.run()), group.create_task(self._look())]
            tasks += [group.create_task(self._console()) for _ in range(CONSOLES)]
            await self.until(lambda: self.state == "IDLE" and (self.service.run / TOLD).exists())
            self._plan_beside()
            k, begun = 0, self.hour
            while self.hour - begun < self._hours:
                async with self._passer_by():
                    await self._job(k)
                if k % PLAN_EVERY == PLAN_EVERY - 1 and (self.planning is None or not self.planning.is_alive()):
                    self._plan_beside()
                k += 1
            for task in tasks:
                task.cancel()

    def _plan_beside(self) -> None:
        """A part from upload to proof in a thread, whose workers give way to all else; what it has not made at the end it gives up."""
        self.planning = threading.Thread(target=self._plan_a_part, daemon=True)
        self.planning.start()

    async def until(self, holds: Callable[[], bool], seconds: float = STATE_S) -> None:
        """Wait. Raises TimeoutError with the cell's words."""
        try:
            async with asyncio.timeout(seconds):
                while not holds():
                    await asyncio.sleep(0.05)
        except TimeoutError:
            told = self.link.snapshot
            words = f"{told.state}: {told.because}; {told.waiting}; {[a.cause for a in told.alarms]}" if told else "no snapshot"
            raise TimeoutError(f"not within {seconds:g} s; {words}") from None

    async def command(self, verb: str, **args: object) -> Reply:
        """One command over the cell's socket, counted."""
        reply = await self.link.command(verb, WHO, "soak", args, client=f"{WHO}/{CLIENT}", timeout_s=STATE_S)
        self.sent[verb] += 1
        return reply

    async def _job(self, k: int) -> None:
        job = f"soak-{k}"
        reply = await self.command("start", job=job, name=job, program=str(self._programs[k % len(self._programs)]))
        if not reply.ok:
            self.faults.append(f"start: {reply.error}")
            await self._recover()
            return
        self.started.append(job)
        is_stopped = k % STOP_EVERY == STOP_EVERY - 1
        for _ in range(HOLDS_PER_JOB):
            await asyncio.sleep(self._chance.uniform(0.5, 3.0))
            if self.state == "RUNNING" and (await self.command("hold")).ok:
                await self.until(lambda: self.state in ("HELD", "IDLE", "FAULT"))
                await asyncio.sleep(self._chance.uniform(0.0, 0.3))
                if self.state == "HELD":
                    await self.command("resume")
        if is_stopped and self.state not in ("IDLE", "FAULT"):
            await self.command("stop")
        await self.until(lambda: self.state in ("IDLE", "FAULT", "STOPPED", "UNHOMED"), JOB_S)
        await self._recover()

    async def _recover(self) -> None:
        """Back to IDLE, as a person would bring it there."""
        async with asyncio.timeout(STATE_S):
            while self.state != "IDLE":
                if self.state in ("FAULT", "STOPPED"):
                    await self.command("reset")
                elif self.state == "UNHOMED":
                    await self.command("home")
                elif self.state == "HELD":
                    await self.command("abort")
                await asyncio.sleep(0.3)

    async def _look(self) -> None:
        told_at = 0.0
        while True:
            if (self.service.run / TOLD).exists():
                self._watch.look(self.hour)
                if time.monotonic() - told_at > TELL_S:
                    told_at = time.monotonic()
                    print(self._progress, flush=True)
            await asyncio.sleep(LOOK_S)

    @property
    def _progress(self) -> str:
        """One line for who waits for the end."""
        ticks = f", {self.link.snapshot.tick.missed} ticks missed" if self.link.snapshot is not None else ""
        held = ", ".join(f"{name} {held[-1].memory:.1f} MB {held[-1].descriptors} fd" for name, held in self._watch.held.items())
        return f"{self.hour:.2f} h of {self._hours:g}: {len(self.started)} jobs, {len(self.faults)} faults{ticks}; {held}"

    async def _console(self) -> None:
        """One live feed, read for ever."""
        headers = {"Authorization": f"Bearer {self.service.token}"}
        url = self.service.url.replace("http", "ws") + "/api/v1/live"
        async with websockets.connect(url, additional_headers=headers, proxy=None) as feed:
            self.consoles += 1
            while True:
                await feed.recv()

    @asynccontextmanager
    async def _passer_by(self) -> AsyncIterator[None]:
        """A console that is opened for one job, and what it asks for."""
        watching = asyncio.create_task(self._console())
        headers = {"Authorization": f"Bearer {self.service.token}"}
        async with httpx.AsyncClient(base_url=self.service.url, headers=headers, trust_env=False, timeout=30.0) as client:
            for path in ("cell", "cell/events?limit=100", "jobs", "parts"):
                await client.get(f"/api/v1/{path}")
            try:
                yield
            finally:
                watching.cancel()
                await asyncio.gather(watching, return_exceptions=True)

    def _plan_a_part(self) -> None:
        """Upload a block that differs from the last, have it planned, posted and proven, and give it up. Runs in a thread."""
        path = self.service.run / "block.stl"
        trimesh.creation.box((10.0 + self.plans.total() % 7, 8.0, 1.6)).export(path)
        recipe: Document = {"layer_height_mm": 0.8, "decompose": "never"}
        with Client(self.service.url, self.service.token, name=CLIENT) as client:
            try:
                part = client.upload(path)
                job = client.submit(str(part["id"]), recipe=recipe)
                while (state := str(client.job(str(job["id"]))["state"])) not in PLANNED:
                    if self._is_over.wait(ASK_S):
                        state = f"given up while {state}"
                        break
                self.plans[state] += 1
                if state != "failed":
                    client.cancel(str(job["id"]), "soak")
            except ServiceError as error:
                self.plans[f"refused: {error.message}"] += 1

