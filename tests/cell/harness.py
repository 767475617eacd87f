"""A whole cell in simulated time: our controller and drivers on one side, the simulated plant on the other; reads like a story."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cellctl.cell.commands import Commands
from cellctl.cell.connect import Connection
from cellctl.cell.controller import Controller, Times
from cellctl.cell.record import Journal, StoreError
from cellctl.cell.tick import Beat
from cellctl.cell.view import snapshot
from cellctl.domain.messages import Command, Event, Reply
from cellctl.domain.pace import Pace
from cellctl.domain.snapshot import Snapshot
from cellctl.domain.states import State
from config.cell import Cell, load_cell
from config.device import Device, load_device
from planner.program import Program
from sim.real_machine import really
from sim.world import World
from tests.cell.jobs import one_wall
from tests.cell.plant_wires import ManualClock, PlantWires
from tests.cell.witness import DARK_W, PlantWitness

UNIX_START = 1_800_000_000.0
SPINS = 12  # turns of the event loop that one tick's work may take
ROLES = ("laser", "feeder", "io")
LONGEST_S = 600.0
DUE_MAX = 4  # set-points that are sent at their own time between two ticks
DUE_APART_S = 5e-4
KNOWN_SPAN_S = 0.1  # about a status period, at a new pace


def shipped_cell(name: str = "trunnion_tcp", **changes: object) -> Cell:
    """A shipped cell on a serial line that is never the bottleneck."""
    cell = load_cell(name)
    cnc = cell.cnc.model_copy(update={"baud": 4_000_000})
    limits = cell.limits.model_copy(update={"purge_s": 0.5})
    return cell.model_copy(update={"cnc": cnc, "limits": limits, **changes})


class CellUnderTest:
    """Use as `async with CellUnderTest(store) as cell`."""

    def __init__(self, store: Path, *, cell: Cell | None = None, time_scale: float = 1.0) -> None:
        self.store = store
        self.facts = cell or shipped_cell()
        self.clock = ManualClock()
        devices: dict[str, Device] = {role: load_device(link.device) for role, link in self.facts.links.items()}
        self.sim = World(really(self.facts), devices, time_scale=time_scale)
        self.sim.wire_interlocks()
        self.wires = PlantWires(self.facts, devices, self.sim, self.clock)
        self.time_scale = time_scale
        self.programs: dict[str, Program] = {}
        self.events: list[Event] = []
        self.ids = itertools.count(1)
        self.witness = PlantWitness(self.sim)
        self.is_alive = False
        self.is_ticking = True

    # -- processes -----------------------------------------------------------------------------------------------------

    async def __aenter__(self) -> CellUnderTest:
        await self.power_up()
        return self

    async def __aexit__(self, *_: object) -> None:
        if self.is_alive:
            await self.end()

    async def power_up(self, *, until_idle: bool = True) -> None:
        """Start a cell process on this plant and store."""
        self.journal = Journal(self.store)
        self.journal.on_committed = self.events.extend
        self.controller = Controller(self.facts, Times(self.clock, self.unix), self.journal)
        self.commands = Commands(self.controller, self._read)
        self.connection = Connection(self.controller, self.wires, lambda cnc: None)
        self.connection.start()
        self.is_alive = True
        if until_idle:
            await self.forward(until=lambda: self.state is not State.OFFLINE, seconds=10)

    async def end(self) -> None:
        """End the process in order."""
        self.is_alive = False
        await self.commands.close()
        await self.connection.close()
        self._commit()
        self.journal.close()

    async def kill(self) -> None:
        """What kill -9 leaves: nothing is commanded, nothing queued is written, the wires fall silent."""
        self.is_alive = False
        self.journal._pending.statements.clear()  # what no commit had reached is lost
        self.journal._pending.events.clear()
        for task in self.connection._tasks:
            task.cancel()
        await asyncio.gather(*self.connection._tasks, return_exceptions=True)
        await self.commands.close()
        self.journal.close()

    async def _read(self, directory: Path) -> tuple[Program, str]:
        return self.programs[str(directory)], "d" * 64

    def unix(self) -> float:
        return UNIX_START + self.clock.now()

    # -- time ----------------------------------------------------------------------------------------------------------

    async def forward(self, *, until: Callable[[], bool] | None = None, ticks: int = 0, seconds: float = 0.0) -> None:
        """Let ticks or wire seconds go by, or as many as it takes until something holds (at most `seconds` then)."""
        tick = self.facts.limits.tick_s
        count = ticks or round((seconds or LONGEST_S) / tick)
        for done in range(count):
            if until is not None and until():
                return
            await self._go_on(tick)
            if self.is_alive and self.is_ticking:
                self.controller.tick()
                await self._settle()
                if done % 10 == 0:
                    self._commit()
        if until is not None:
            because = f"{self.state}: {self.controller.because}; waiting: {self.snapshot.waiting}; alarms: {list(self.controller.alarms)}"
            assert until(), f"not within {count * tick:g} s; {because}"

    async def _go_on(self, seconds: float) -> None:
        """Let wire time go by, with a stop at what is due between two ticks, as the cell's own loop has it."""
        end = self.clock.now() + seconds
        for _ in range(DUE_MAX):
            run, now = self.controller.run, self.clock.now()
            due = run.due_at() if run is not None and self.state is State.RUNNING and self.is_alive and self.is_ticking else None
            if due is None or due > end - DUE_APART_S:
                break
            await self._pass(max(due - now, DUE_APART_S))
            self.controller.act(self.clock.now())
            await self._settle()
        if end > self.clock.now():
            await self._pass(end - self.clock.now())

    async def _pass(self, seconds: float) -> None:
        self.sim.step(seconds * self.time_scale)
        self.clock.advance(seconds)
        await self._settle()

    async def hurry(self, until: Callable[[], bool], scale: float = 10.0) -> None:
        """Let the plant run `scale` times as fast as the wires until something holds; then again as before."""
        before = self.time_scale
        self.set_pace(scale)
        try:
            await self.forward(until=until)
        finally:
            self.set_pace(before)

    def set_pace(self, scale: float) -> None:
        """From now on the plant runs `scale` times as fast as the wires. No plant's clock does that: the follower is not made to learn it."""
        run = self.controller.run
        if run is not None:
            pace = run.follower.pace = Pace()
            pace.take(scale * KNOWN_SPAN_S, KNOWN_SPAN_S, 0.0, 0.0)
        self.time_scale = self.sim.time_scale = scale

    def _commit(self) -> None:
        """What the journal's thread does ten times a second."""
        try:
            self.journal.commit()
        except StoreError as error:
            self.controller.fault("store", error.message)

    async def _settle(self) -> None:
        """Let what can go on go on, until everything waits for the clock."""
        ready = asyncio.get_running_loop()._ready  # type: ignore[attr-defined]
        for _ in range(SPINS):
            if not ready:
                return
            await asyncio.sleep(0)

    # -- what the plant saw --------------------------------------------------------------------------------------------

    @property
    def max_standstill_emission_w(self) -> float:
        return self.witness.max_standstill_emission_w

    @property
    def standstill_s(self) -> float:
        return self.witness.standstill_s

    @property
    def burnt_lines(self) -> set[int]:
        return self.witness.burnt_lines

    # -- commands ------------------------------------------------------------------------------------------------------

    async def command(self, verb: str, ident: str = "", because: str = "test", client: str = "", **args: Any) -> Reply:
        """Send a command and let time go by until it is answered."""
        name = ident or f"c{next(self.ids)}-{self.clock.now()}"
        command = Command(name, verb, "tester", because, args, client)
        task = asyncio.get_running_loop().create_task(self.commands.handle(command))
        await self._settle()
        while not task.done():
            await self.forward(ticks=1)
        return task.result()

    async def start(self, program: Program, job: str = "job-1", ident: str = "") -> Reply:
        """Start a Program as a job."""
        self.programs[job] = program
        return await self.command("start", ident, job=job, name=program.part_name, program=job)

    # -- questions -----------------------------------------------------------------------------------------------------

    @property
    def state(self) -> State:
        return self.controller.state

    @property
    def snapshot(self) -> Snapshot:
        return snapshot(self.controller, 1, Beat(self.facts.limits.tick_s))

    @property
    def outcome(self) -> str:
        return self.controller.ended.view.outcome if self.controller.ended else ""

    def is_depositing(self) -> bool:
        """Whether the plant emits on a bead that is well under way."""
        return self.sim.laser.is_emitting and self.sim.tip_speed_mm_s > 5.0 and self.snapshot.lines.executing > 9

    async def deposit(self, **shape: Any) -> None:
        """Start one_wall and go on until it deposits."""
        reply = await self.start(one_wall(self.facts, **shape))
        assert reply.ok, reply.error
        await self.hurry(self.is_depositing)
        await self.forward(ticks=30)
        assert self.is_depositing()

    def jam_head(self) -> None:
        """The head's slide stays where it is from now on."""
        io = self.sim.io

        def step(dt_s: float, wire_dt_s: float) -> None:
            io.watch(wire_dt_s)
            io.show()

        io.step = step  # type: ignore[method-assign]

    @property
    def is_dark(self) -> bool:
        """Whether the plant emits no more than the tail of the laser's ramp."""
        return self.sim.laser_emission_w < DARK_W

    @property
    def is_still(self) -> bool:
        """Whether the plant stands."""
        return self.sim.cnc.machine.motion.speed == 0.0

    @property
    def latched(self) -> list[str]:
        """Codes of the alarms."""
        return list(self.controller.alarms)

    def is_state(self, *states: State) -> Callable[[], bool]:
        return lambda: self.state in states

    def has_event(self, kind: str, words: str = "") -> bool:
        return any(event.kind == kind and words in event.text for event in self.events)
