"""The cell in memory at a millisecond's pace: timers between ticks, bytes taken in as they come, links with a latency of their own."""

from __future__ import annotations

import asyncio
import random
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.messages import Command
from cellctl.domain.states import State
from config.base import find_facts
from config.cell import Cell
from config.device import Table
from drivers.cell_wires import CellDrivers
from planner.program import Program
from tests.bench.sync_edges import Light
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.plant_wires import DirectLink, ManualClock

STEP_S = 0.001
READY_S = 1.0  # in which a slow line has read everything
BITS, GAP_MIN_S = 11, 0.00175  # of a character, and between frames (Modbus over serial line 1.02, 2.5.1)
SLOW_S = 0.05  # a device that answers later than this has stale limits of its own in its map
SLOW_STALE_S = 0.8


def cell_of(name: str, store: Path, *, gate: bool, slow: bool, baud: int = 0) -> Cell:
    """A shipped cell with the laser gated in the stream or by Modbus; slow: register maps that allow for slow answers. baud : of its RTU lines"""
    cell = shipped_cell(name)
    if baud:
        cell = cell.model_copy(update={"links": {role: link.model_copy(update={"baud": baud}) for role, link in cell.links.items()}})
    if not gate:
        cell = cell.model_copy(update={"cnc": cell.cnc.model_copy(update={"laser_gate_output": None})})
    if not slow:
        return cell
    links = {}
    for role, link in cell.links.items():
        text = find_facts("devices", link.device).read_text(encoding="utf-8")
        path = store / f"{role}_slow.toml"
        path.write_text(re.sub(r"stale_s = 0\.\d+", f"stale_s = {SLOW_STALE_S}", text), encoding="utf-8")
        links[role] = link.model_copy(update={"device": str(path)})
    return cell.model_copy(update={"links": links})


def _at_baud(link: DirectLink, baud: int, clock: ManualClock) -> None:
    """Question and answer of every request take the time of their characters and of the silence before each."""
    character_s, read, write = BITS / baud, link.read, link.write
    gap_s = max(GAP_MIN_S, 3.5 * character_s)

    async def paced_read(device_id: int, table: Table, address: int, count: int) -> list[int]:
        await clock.sleep(gap_s + 8 * character_s)
        words = await read(device_id, table, address, count)
        data = (count + 7) // 8 if table in ("coil", "discrete") else 2 * count
        await clock.sleep(gap_s + (5 + data) * character_s)
        return words

    async def paced_write(device_id: int, table: Table, address: int, values: list[int]) -> None:
        data = 0 if len(values) == 1 else 1 + 2 * len(values)
        await clock.sleep(gap_s + (8 + data) * character_s)
        await write(device_id, table, address, values)
        await clock.sleep(gap_s + 8 * character_s)

    link.read, link.write = paced_read, paced_write  # type: ignore[method-assign]


class FineCell(CellUnderTest):
    """The plant steps by a millisecond; set-points are sent when they are due, as the cell process's timer does it.

    delay_s, jitter_s : of every answer of laser and feeder    hands : (progress line, act) carried out once that line executes
    """

    def __init__(self, store: Path, cell: Cell, delay_s: float, jitter_s: float) -> None:
        super().__init__(store, cell=cell)
        self._gates = np.zeros(0)
        self._open_wires, self.wires.open = self.wires.open, self._open_paced  # type: ignore[method-assign]
        see = self.sim._gates

        def gates(pieces: NDArray[np.float64]) -> NDArray[np.float64]:
            self._gates = see(pieces)
            return self._gates

        self.sim._gates = gates  # type: ignore[method-assign]
        self.light = Light(cell.placement.part_origin_mm)
        self.light.gate = (lambda: self._gates) if cell.cnc.laser_gate_output is not None else None
        self.sim.metal = self.light
        self.delay_s, self.jitter_s = delay_s, jitter_s
        self._random = random.Random(5)

    async def power_up(self, *, until_idle: bool = True) -> None:
        """Start at a millisecond's pace, until every device was read a few times."""
        await super().power_up(until_idle=False)
        await self.fine(lambda: self.state is not State.OFFLINE, 20.0)
        ready_at = self.clock.now() + READY_S
        await self.fine(lambda: self.clock.now() >= ready_at, 2.0 * READY_S)

    def _open_paced(self) -> CellDrivers:
        """Drivers whose requests take the time of their characters, where the cell has RTU lines."""
        drivers = self._open_wires()
        for role, link in self.wires.links.items():
            facts = self.facts.links[role]
            if facts.transport == "rtu":
                _at_baud(link, facts.baud, self.clock)
        return drivers

    async def fine(self, until: Callable[[], bool], seconds: float) -> None:
        """Let at most so many seconds go by, until something holds."""
        per_tick = round(self.facts.limits.tick_s / STEP_S)
        for done in range(round(seconds / STEP_S)):
            for role in ("laser", "feeder"):
                self.sim.wires[role].delay_s = self.delay_s + self.jitter_s * self._random.random()
            self.sim.step(STEP_S)
            self.clock.advance(STEP_S)
            await self._settle()
            self.controller.pump()
            if done % per_tick == 0:
                self.controller.tick()
                if until():
                    return
                assert not self.latched, f"{self.latched}: {self.controller.because}"
            elif (run := self.controller.run) is not None and (due := run.due_at()) is not None and due <= self.clock.now():
                self.controller.act(self.clock.now())
            await self._settle()
            if done % (10 * per_tick) == 0:
                self._commit()
        raise AssertionError(f"not within {seconds:g} s: {self.state}, {self.controller.because}")

    async def build(self, program: Program, act: Callable[[], None] | None = None) -> None:
        """Run a Program to its end. act : called at every step while it runs"""
        self.programs["job"] = program
        task = asyncio.get_running_loop().create_task(self._ask(program))
        await self.fine(lambda: (act() if act is not None else None) is not None or (task.done() and bool(self.outcome)), 150.0)
        assert self.outcome == "completed", f"{self.outcome}: {self.latched} {task.result()}"

    async def _ask(self, program: Program) -> object:
        return await self.commands.handle(Command("s1", "start", "bench", "bench", {"job": "job", "name": "rows", "program": "job"}))
