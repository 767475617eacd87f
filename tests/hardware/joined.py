"""Drivers and cell process joined to the bench by its real wires, with the guard between."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cellctl.cell.commands import Commands
from cellctl.cell.connect import Connection
from cellctl.cell.controller import Controller, Times
from cellctl.cell.record import Journal
from cellctl.cell.tick import Beat
from cellctl.cell.view import snapshot
from cellctl.domain.messages import Command, Reply
from cellctl.domain.snapshot import Snapshot
from config.cell import Cell, load_cell
from drivers.cell_wires import CellDrivers, open_devices
from drivers.clock import SystemClock
from drivers.cnc.driver import CncDriver
from drivers.feeder import Feeder
from drivers.interfaces import Clock
from drivers.interlocks import Io
from drivers.laser import Laser
from drivers.transport.port_name import port_path
from drivers.transport.serial_port import SerialPort
from planner.program import LineKind, Program
from sim.server import SimServer
from sim.world import World
from tests.cell.jobs import Writer
from tests.hardware.bench_file import BenchFile
from tests.hardware.guard import GuardedLink, GuardedPort

TIME_SCALE = 5.0  # of the simulated cell
DRY_MOVES = 12
CYCLE_S = 0.01


@dataclass
class AtBench:
    """The far end, simulated or real, and everything that is guarded. world : the plant, None for hardware"""

    facts: BenchFile
    cell: Cell
    folder: Path
    world: World | None = None
    clock: Clock = field(default_factory=SystemClock)
    links: dict[str, GuardedLink] = field(default_factory=dict)
    ports: list[GuardedPort] = field(default_factory=list)

    # -- wires of a cell process ---------------------------------------------------------------------------------------

    def open(self) -> CellDrivers:
        """All drivers behind the guard. Raises LinkError."""
        clients, lines = open_devices(self.cell, self.folder, self.clock)
        for role, client in clients.items():
            client.link = self.links[role] = GuardedLink(
                client.link, role, client.device, may_write=self.facts.may_write, may_move=self.facts.may_move
            )
        return CellDrivers(self.reopen_cnc(), Laser(clients["laser"]), Feeder(clients["feeder"]), Io(clients["io"]), lines)

    def reopen_cnc(self) -> CncDriver:
        """The CNC's port behind the guard. Raises LinkError."""
        port = SerialPort(port_path(self.cell.cnc.port, self.folder), self.cell.cnc.baud)
        self.ports.append(GuardedPort(port, may_move=self.facts.may_move))
        return CncDriver(self.ports[-1], self.cell.cnc, self.cell.letters, self.clock)

    # -- what has to hold at the end -----------------------------------------------------------------------------------

    def check_dark(self) -> None:
        """Nothing was asked that could lead to light; where the plant can be seen, it stayed dark."""
        asked = [write for link in self.links.values() if link.role == "laser" for write in link.written]
        lit = [write for write in asked if write.register not in ("heartbeat", "fault_reset") and any(write.values)]
        assert lit == []
        assert [text for link in self.links.values() for text in link.refused] == []
        assert [text for port in self.ports for text in port.refused] == []
        if self.world is not None:
            values = self.world.laser.values
            assert (values["enable"], values["emission_permit"], values["power_setpoint"]) == (0.0, 0.0, 0.0)
            assert self.world.laser.emission_w == 0.0


@dataclass
class BenchDrivers:
    """Drivers at a bench, polled as a cell process does."""

    at: AtBench
    drivers: CellDrivers

    async def until(self, is_met: Callable[[], bool], seconds: float = 0.0) -> None:
        """Pump and poll until something holds. Raises AssertionError."""
        deadline = time.monotonic() + (seconds or self.at.facts.answer_s)
        views = (self.drivers.laser, self.drivers.feeder, self.drivers.io)
        polls = [asyncio.ensure_future(_poll(view)) for view in views]
        try:
            while not is_met():
                errors = [str(view.last_error) for view in views if view.last_error is not None]
                assert time.monotonic() < deadline, f"not met; {errors}, {self.drivers.cnc.status}"
                self.drivers.cnc.pump()
                await asyncio.sleep(min(0.005, max(0.0005, self.drivers.cnc.due_in_s())))
        finally:
            for poll in polls:
                poll.cancel()
            await asyncio.gather(*polls, return_exceptions=True)


async def _poll(view: Laser | Feeder | Io) -> None:
    while True:
        await view.cycle()
        await asyncio.sleep(CYCLE_S)


class BenchProcess:
    """Controller, commands and journal of a cell process, ticking in this loop."""

    def __init__(self, at: AtBench, store: Path) -> None:
        self.at = at
        self.journal = Journal(store)
        self.controller = Controller(at.cell, Times(at.clock, time.time), self.journal)
        self.programs: dict[str, Program] = {}
        self.commands = Commands(self.controller, self._read)
        self.connection = Connection(self.controller, at, lambda cnc: None)
        self._beat = Beat(at.cell.limits.tick_s)
        self._ids = 0

    async def _read(self, directory: Path) -> tuple[Program, str]:
        return self.programs[str(directory)], "d" * 64

    @property
    def snapshot(self) -> Snapshot:
        """What the cell says of itself."""
        return snapshot(self.controller, 0, self._beat)

    @property
    def state(self) -> str:
        """The cell's state."""
        return self.controller.state.value

    async def command(self, verb: str, **args: Any) -> Reply:
        """One command of one person."""
        self._ids += 1
        return await self.commands.handle(Command(f"bench-{self._ids}", verb, "tester", "bench", args, "tester/bench"))

    async def until(self, is_met: Callable[[], bool]) -> None:
        """Wait. Raises AssertionError with the cell's words."""
        deadline = time.monotonic() + self.at.facts.answer_s
        while not is_met():
            seen = self.snapshot
            assert time.monotonic() < deadline, f"{seen.state}: {seen.because}; {seen.waiting}; {[a.cause for a in seen.alarms]}"
            await asyncio.sleep(CYCLE_S)

    async def tick(self) -> None:
        """Tick for ever."""
        while True:
            self.controller.pump()
            self.controller.tick()
            await asyncio.sleep(self.at.cell.limits.tick_s)


@asynccontextmanager
async def at_bench(facts: BenchFile, cell: Cell, folder: Path) -> AsyncIterator[AtBench]:
    """The far end of a bench file. folder : of the simulated cell, if it is one"""
    if facts.is_real:
        yield AtBench(facts, cell, Path(facts.run_dir))
        return
    links = {role: link.model_copy(update={"tcp_port": 0}) for role, link in cell.links.items()}
    server = SimServer(cell.model_copy(update={"links": links}), folder, time_scale=TIME_SCALE)
    await server.start()
    running = asyncio.ensure_future(server.run())
    try:
        yield AtBench(facts, load_cell(server.cell_file), folder, server.world)
    finally:
        server.stop()
        await running
        await server.close()


@asynccontextmanager
async def drivers_at(at: AtBench) -> AsyncIterator[BenchDrivers]:
    """Drivers, safe and given back at the end."""
    drivers = at.open()
    try:
        yield BenchDrivers(at, drivers)
    finally:
        await drivers.close()


@asynccontextmanager
async def process_at(at: AtBench, store: Path) -> AsyncIterator[BenchProcess]:
    """A cell process in this loop, ended in order."""
    process = BenchProcess(at, store)
    process.connection.start()
    process.journal.start()
    ticking = asyncio.ensure_future(process.tick())
    try:
        yield process
    finally:
        ticking.cancel()
        await asyncio.gather(ticking, return_exceptions=True)
        await process.commands.close()
        await process.connection.close()
        process.journal.close()


class DryWriter(Writer):
    """Lines that go to and fro where the machine stands: `tip` is the way from there, mm."""

    start: np.ndarray

    def joints(self) -> np.ndarray:
        joints = self.start.copy()
        joints[:3] += self.tip
        return joints


def towards_middle(cell: Cell, joints: np.ndarray, distance_mm: float) -> float:
    """Way along the first axis that leads to the middle of its travel, mm."""
    axis = cell.axes[0]
    return distance_mm if joints[0] <= 0.5 * (axis.min + axis.max) else -distance_mm


def dry_program(facts: BenchFile, cell: Cell, joints: np.ndarray) -> Program:
    """DRY_MOVES moves of the first axis to and fro, with no laser, no powder, no spindle and no tool. joints : where the machine stands"""
    writer = DryWriter(cell)
    writer.start, writer.tip = joints.astype(np.float64), np.zeros(3)
    way = towards_middle(cell, joints, facts.distance_mm)
    writer.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    writer.layer = writer.operation = 0
    for k in range(DRY_MOVES):
        writer.move(way if k % 2 == 0 else 0.0, 0.0, 0.0, LineKind.LINK, facts.feed_mm_min / 60.0)
    writer.line("G94", LineKind.SETUP)
    return writer.program("dry", [1])
