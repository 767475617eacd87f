"""A simulated cell on real wires in this process and the cell process beside it: causes are set, and seen, at the plant."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from cellctl.api.cell_link import CellLink
from cellctl.demo import to_be_simulated
from cellctl.domain.snapshot import Snapshot
from config.cell import load_cell
from planner.files import write_program
from sim.server import SimServer
from sim.world import World
from tests.cell.jobs import one_wall

WITNESS_S = 0.0005  # how often the plant is looked at
START_S = 60.0
LONGEST_S = 30.0
ATTEMPTS = 4
HOLD, RESET = b"!", b"\x18"
WHO, WHY = "bench", "bench of reactions"


class ReactionCell:
    """Use as `async with ReactionCell(folder, cell name)`. `world` is the plant; the service's end is a process of its own."""

    def __init__(self, folder: Path, name: str) -> None:
        facts = to_be_simulated(load_cell(name))
        facts["simulation"] |= {"powder_transport_s": 0.05, "powder_settle_s": 0.02}  # a resume takes no seconds
        facts["response"] |= {"powder_delay_s": 0.05, "powder_settle_s": 0.02}
        facts["limits"]["purge_s"] = 0.1
        self._given = folder / "given.toml"
        self._given.write_text(tomli_w.dumps(facts), encoding="utf-8")
        self.folder = folder
        self.sim = SimServer(load_cell(self._given), folder, at_baud=True)
        self.link = CellLink(folder / "cell.sock", lambda snapshot: None, lambda event: None, lambda: None)
        self._jobs = itertools.count(1)
        self._tasks: list[asyncio.Task[None]] = []
        self.unasked: list[str] = []  # faults that no cause of ours had
        self.dark_at: float | None = None
        self.stop_byte_at: float | None = None

    @property
    def world(self) -> World:
        """The plant."""
        return self.sim.world

    @property
    def snapshot(self) -> Snapshot:
        """What the cell process says."""
        assert self.link.snapshot is not None
        return self.link.snapshot

    async def __aenter__(self) -> ReactionCell:
        await self.sim.start()
        self._watch_plant()
        loop = asyncio.get_running_loop()
        self._tasks = [loop.create_task(self.sim.run()), loop.create_task(self.link.run()), loop.create_task(self._witness())]
        words = ["--cell", str(self.sim.cell_file), "--run", str(self.folder), "--store", str(self.folder / "store.db"), "--stop-port", "0"]
        log = (self.folder / "cell.log").open("wb")
        self._process = subprocess.Popen([sys.executable, "-m", "cellctl.cell", *words], stderr=log)  # noqa: ASYNC220
        log.close()
        await self.until(lambda: self.link.snapshot is not None and self.snapshot.state == "IDLE", START_S)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._process.terminate()
        await asyncio.to_thread(self._process.wait, 10)
        self.sim.stop()
        for task in self._tasks[1:]:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.sim.close()

    def _watch_plant(self) -> None:
        """Note at the instant it happens: a write that ends emission, a hold or reset byte at the firmware."""
        laser, cnc = self.world.laser, self.world.cnc
        write, receive = laser.write, cnc.receive

        def written(name: str, value: float) -> None:
            write(name, value)
            self._look()

        def received(data: bytes) -> None:
            if self.stop_byte_at is None and (HOLD in data or RESET in data):
                self.stop_byte_at = time.perf_counter()
            receive(data)

        laser.write = written  # type: ignore[method-assign]
        cnc.receive = received  # type: ignore[method-assign]

    def _look(self) -> None:
        if self.dark_at is None and self.world.laser.level_w == 0.0:
            self.dark_at = time.perf_counter()

    async def _witness(self) -> None:
        while True:
            self._look()
            await asyncio.sleep(WITNESS_S)

    async def until(self, holds: Callable[[], bool], seconds: float = LONGEST_S) -> None:
        """Wait until something holds. Raises TimeoutError that tells the cell's state."""
        try:
            async with asyncio.timeout(seconds):
                while not holds():
                    await asyncio.sleep(0.002)
        except TimeoutError:
            told = self.link.snapshot
            text = "no snapshot" if told is None else f"{told.state}: {told.because}; {told.waiting}; {[a.cause for a in told.alarms]}"
            raise TimeoutError(f"not within {seconds:g} s; {text}") from None

    async def command(self, verb: str, **args: Any) -> None:
        """A command, tried again until it is accepted or LONGEST_S are over."""
        until = time.monotonic() + LONGEST_S
        while not (reply := await self.link.command(verb, WHO, WHY, args, timeout_s=LONGEST_S)).ok:
            if time.monotonic() > until:
                raise TimeoutError(f"{verb}: {reply.error}")
            await asyncio.sleep(0.05)

    def is_lit(self) -> bool:
        """Whether the plant emits on a pass, with the cell knowing it runs."""
        return self.world.laser.is_emitting and self.world.tip_speed_mm_s > 5.0 and self.snapshot.state == "RUNNING"

    async def deposit(self) -> None:
        """Bring a job to where light falls on a pass; a fault on the way there is counted and reset. Raises TimeoutError."""
        for _ in range(ATTEMPTS):
            await self._go_on()
            await self.until(lambda: self.is_lit() or self.snapshot.state == "FAULT")
            if self.snapshot.state != "FAULT":
                return
            self.unasked += [alarm.cause for alarm in self.snapshot.alarms]
        raise TimeoutError(f"{ATTEMPTS} faults before a pass: {self.unasked[-1]}")

    async def _go_on(self) -> None:
        """Reset what is latched; resume the job that is held, or start another."""
        state = self.snapshot.state
        if state in ("FAULT", "STOPPED"):
            await self.command("reset")
            await self.until(lambda: self.snapshot.state in ("IDLE", "HELD", "UNHOMED"))
        if self.snapshot.state == "UNHOMED" or (self.snapshot.state == "IDLE" and self.snapshot.position):
            await self.command("home")
            await self.until(lambda: self.snapshot.state == "IDLE" and not self.snapshot.position)
        if self.snapshot.state == "HELD":
            await self.command("resume")
        elif self.snapshot.state == "IDLE":
            job = f"job-{next(self._jobs)}"
            write_program(one_wall(self.sim.cell, layers=40, mill=False), self.folder / job)
            await self.command("start", job=job, name=job, program=str(self.folder / job))

    async def react(self, act: Callable[[World], None], limit_s: float) -> tuple[float, float]:
        """Set a cause now; ms until the laser is off at the plant, and until the CNC has a hold or reset byte (NaN: none came)."""
        self.dark_at = self.stop_byte_at = None
        began = time.perf_counter()
        act(self.world)
        with contextlib.suppress(TimeoutError):
            await self.until(lambda: self.dark_at is not None and self.stop_byte_at is not None, limit_s)
        stop = self.stop_byte_at
        dark = self.dark_at
        nan = float("nan")
        return 1e3 * (dark - began) if dark is not None else nan, 1e3 * (stop - began) if stop is not None else nan
