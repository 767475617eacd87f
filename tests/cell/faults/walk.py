"""Random walks through a cell's life: commands of several clients, faults and their repair, time, kills; after every step the plant is asked."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import random
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import structlog

from cellctl.domain.messages import Command
from cellctl.domain.states import LATCHED, State
from planner.program import Program
from tests.cell.faults.host import PREFIX
from tests.cell.faults.play import MEMORY, QUIET
from tests.cell.faults.rows import ROWS
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall

SCALE = 10.0  # the plant's time over the wires' time: a pass lasts a few dozen ticks
LIT_TICKS = 100  # from a start to light at that pace, and some more
STEPS = 3  # of one sequence
Step = tuple[str, str]
"""What is done, and to what: ("command", "hold a"), ("fault", "door_open"), ("mend", "door_close"), ("wait", "7"), ("kill", "")."""

REQUEST_S = 0.13  # 30 ms and one request
REPORT_S = 0.23  # and a status period
STALE_S = 0.5  # the longest stale limit of a level or of a status report
DEAD_MAN_S = 0.5
REACH = ("laser", "power_off", "kill")  # the laser cannot be reached, or nobody is there who could
CLIENTS = ("a", "b")
LIKELY: dict[State, tuple[str, ...]] = {
    State.IDLE: ("start",) * 12 + ("jog", "home", "stop"),
    State.UNHOMED: ("home", "home", "unlock"),
    State.RUNNING: ("hold", "abort", "stop"),
    State.PREPARING: ("hold", "abort", "stop"),
    State.HELD: ("resume", "resume", "abort"),
    State.FAULT: ("reset",),
    State.STOPPED: ("reset",),
}
BUSY = frozenset({State.RUNNING, State.PREPARING, State.HELD, State.HOLDING, State.RESUMING, State.JOGGING, State.HOMING})
PASSING = frozenset({State.PREPARING, State.HOLDING, State.RESUMING, State.ABORTING, State.RESETTING, State.HOMING, State.OFFLINE})
ANY = ("start", "hold", "resume", "abort", "stop", "reset", "home", "unlock", "jog", "take_control", "release_control")
FAULTS = [row for row in ROWS if not any(text.startswith(("+", PREFIX)) for text in row.strike) and not row.cnc]


class Violation(AssertionError):
    """Something that must never be; the message names the invariant and the steps that led to it."""


@dataclass
class Walk:
    """One cell that lives on from sequence to sequence. gate : shipped cell's name"""

    seed: int
    gate: str = "trunnion_tcp"
    steps: list[Step] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.open: list[str] = []  # repairs that are still to be made
        self.since: set[str] = set()  # what may have kept the laser or the CNC out of reach lately
        self.jobs = 0

    # -- choosing ------------------------------------------------------------------------------------------------------

    def choose(self) -> Step:
        """The next step; likelier where the life goes on."""
        dice, state = self.random.random(), self.cell.state
        if state not in BUSY:
            if self.open and dice < 0.7:
                return "mend", self.open[0]
            if state in LATCHED and dice < 0.9:
                return "command", f"reset {self._client()}"
        if state in (State.RUNNING, State.PREPARING) and not self.cell.sim.laser.is_emitting and dice < 0.8:
            return "wait", "lit"
        if state in PASSING and dice < 0.7:
            return "wait", str(self.random.choice((5, 20, 40)))
        if dice < (0.3 if state in BUSY else 0.12):
            row = self.random.choice(FAULTS)
            return "fault", row.strike[0] + "".join(f"|{text}" for text in row.mend)
        if dice < (0.55 if state in BUSY else 0.9):
            verbs = LIKELY.get(state, ANY) if self.random.random() < 0.85 else ANY
            return "command", f"{self.random.choice(verbs)} {self._client()}"
        if dice < (0.57 if state in BUSY else 0.91):
            return "kill", ""
        return "wait", str(self.random.choice((1, 3, 8, 20)))

    def _client(self) -> str:
        return CLIENTS[self.random.random() > 0.92]

    # -- doing ---------------------------------------------------------------------------------------------------------

    async def live(self, folder: Path, sequences: int, given: Sequence[Step] = ()) -> int:
        """Go through so many sequences, or through the steps that are given; how many were gone through. Raises Violation."""
        async with CellUnderTest(folder / "store.db", cell=shipped_cell(self.gate), time_scale=SCALE) as cell:
            self.cell = cell
            self.program: Program = one_wall(cell.facts, layers=1, length_mm=60.0, pieces=8, mill=False)
            if given:
                for step in given:
                    await self.take(step)
                self._check_record()
                return 1
            for _ in range(sequences):
                for _ in range(STEPS):
                    await self.take(self.choose())
                self._check_record()
            return sequences

    async def take(self, step: Step) -> None:
        """One step, and what has to hold behind it."""
        self.steps.append(step)
        kind, what = step
        cell = self.cell
        was_latched = cell.state in LATCHED
        if kind == "fault":
            strike, *mend = what.split("|")
            cell.sim.faults.add(strike)
            self.open += mend
            self.since.add(strike)
            await cell.forward(ticks=1)
        elif kind == "mend":
            if what in self.open:
                self.open.remove(what)
            cell.sim.faults.add(what)
            await cell.forward(ticks=3)
        elif what == "lit":
            await self._until_lit()
        elif kind == "wait":
            await cell.forward(ticks=int(what))
        elif kind == "kill":
            self.since.add("kill")
            await cell.kill()
            await cell.forward(ticks=self.seed % 7 + 1)
            await cell.power_up(until_idle=False)
            if was_latched and cell.state not in LATCHED:
                raise self._wrong("1: a latch did not survive a kill")
        else:
            await self._command(*what.split())
        self._check()
        if not self.open and not cell.sim.laser.is_emitting:
            self.since.clear()

    async def _until_lit(self) -> None:
        """Let the job come to a pass, if it gets there."""
        for _ in range(LIT_TICKS):
            if self.cell.sim.laser.is_emitting or self.cell.state not in (State.RUNNING, State.PREPARING):
                return
            await self.cell.forward(ticks=1)

    async def _command(self, verb: str, client: str) -> None:
        cell = self.cell
        args: dict[str, object] = {}
        if verb == "start":
            self.jobs += 1
            job = f"job-{self.jobs}"
            cell.programs[job] = self.program
            args = {"job": job, "name": job, "program": job}
        elif verb == "jog":
            args = {"axis": "X", "distance": 50.0 if cell.sim.joints[0] < 0 else -50.0, "feed": 900.0}
        ident = f"{verb}-{len(self.steps)}"
        command = Command(ident, verb, f"person {client}", "walk", args, client)
        task = asyncio.get_running_loop().create_task(cell.commands.handle(command))
        await cell.forward(ticks=1)
        while not task.done():
            await cell.forward(ticks=1)
        reply = task.result()
        if verb == "start" and reply.ok:
            cell.witness.taken.clear()
        if verb == "stop" and (not reply.ok or cell.state is not State.STOPPED):
            raise self._wrong(f"2: a stop was not carried out: {reply.error}")
        again = await cell.commands.handle(command)
        if again != reply:
            raise self._wrong("2: a command that was sent twice got two answers")

    # -- asking the plant ----------------------------------------------------------------------------------------------

    def _wrong(self, what: str) -> Violation:
        return Violation(f"invariant {what}; seed {self.seed}, {self.gate}; state {self.cell.state}; steps:\n{self.steps!r}")

    def _check(self) -> None:
        cell, seen = self.cell, self.cell.witness
        reach_s = DEAD_MAN_S if any(word in text for text in self.since for word in REACH) else 0.0
        stale_s = STALE_S if self.since else 0.0
        if seen.standstill_s > REPORT_S + stale_s + reach_s:
            raise self._wrong(f"1: light at standstill for {1000 * seen.standstill_s:.0f} ms")
        for name, lit_s in seen.unsafe_lit_s.items():
            if lit_s > REQUEST_S + stale_s + reach_s:
                raise self._wrong(f"1: light for {1000 * lit_s:.0f} ms behind an unsafe {name}")
        if seen.unguarded:
            raise self._wrong(f"7: {seen.unguarded}")
        executed, taken = cell.snapshot.lines.executed if cell.controller.run else 0, max(seen.taken, default=0)
        if executed > taken:
            raise self._wrong(f"3: {executed} lines executed, the machine took {taken}")
        if any(b <= a for a, b in seen.breaks_in_lines()):
            raise self._wrong(f"5: lines done twice: {seen.breaks_in_lines()[:2]}")
        if "internal" in cell.controller.alarms:
            raise self._wrong(f"4: {cell.controller.alarms['internal'].cause}")
        for alarm in cell.controller.alarms.values():
            if not alarm.cause or not alarm.remedy:
                raise self._wrong(f"1: alarm {alarm.code} without cause or remedy")
        seen.forget()

    def _check_record(self) -> None:
        cell = self.cell
        cell.journal.commit()
        events = cell.journal.events_since(0, 100000)
        if [event.seq for event in events] != list(range(events[0].seq, events[0].seq + len(events))):
            raise self._wrong("5: a gap in the record")
        noted = [event.data["id"] for event in events if event.kind == "command"]
        if len(noted) != len(set(noted)):
            raise self._wrong("5: a command is twice in the record")
        for event in events:
            if event.kind == "state" and event.data.get("trigger") == "moved" and not event.text:
                raise self._wrong("5: an event without words")
        unfinished = cell.journal.find().unfinished
        if len(unfinished) > (1 if cell.controller.run is not None else 0):
            raise self._wrong(f"5: jobs without an end: {[run.job for run in unfinished]}")


def gate_of(seed: int) -> str:
    """Name of the cell that a walk takes."""
    return "trunnion_rtu" if seed % 3 == 0 else "trunnion_tcp"


def walk(seed: int, sequences: int, given: Sequence[Step] = (), gate: str = "") -> int:
    """One walk in a fresh cell, every third one of it gated by Modbus; sequences gone through. Raises Violation."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(QUIET))
    chosen = gate or gate_of(seed)
    with tempfile.TemporaryDirectory(prefix="walk-", dir=MEMORY if os.access(MEMORY, os.W_OK) else None) as folder:
        return asyncio.run(Walk(seed, chosen).live(Path(folder), sequences, given))


def shrunk(seed: int, steps: Sequence[Step], gate: str) -> list[Step]:
    """The fewest steps, found by leaving out, that still lead to a violation."""
    left, size = list(steps), max(len(steps) // 2, 1)
    while True:
        start = 0
        while start < len(left):
            without = left[:start] + left[start + size :]
            if without and _fails(seed, without, gate):
                left = without
            else:
                start += size
        if size == 1:
            return left
        size = max(size // 2, 1)


def _fails(seed: int, steps: Sequence[Step], gate: str) -> bool:
    try:
        walk(seed, 1, steps, gate)
    except Violation:
        return True
    except AssertionError:
        return False
    return False


def told(job: tuple[int, int]) -> tuple[int, str]:
    """A walk in a worker process: sequences gone through, and the violation in words."""
    try:
        return walk(*job), ""
    except Violation as violation:
        return 0, str(violation)
    except Exception as error:  # noqa: BLE001  a worker's edge: what went wrong is told with its seed
        return 0, f"seed {job[0]}: {type(error).__name__}: {error}"


def walk_all(jobs: Sequence[tuple[int, int]], workers: int) -> Iterator[tuple[int, str]]:
    """Walks in worker processes, in any order."""
    with multiprocessing.get_context("forkserver").Pool(workers) as pool:
        yield from pool.imap_unordered(told, jobs, chunksize=2)
