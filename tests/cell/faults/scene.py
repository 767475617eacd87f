"""One cell of the matrix: a situation is brought about, a fault strikes at a random instant, is looked at, mended, and the cell is brought back."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from cellctl.domain.states import IN_JOB, LATCHED, State
from config.cell import Cell
from tests.cell.faults import host
from tests.cell.faults.programs import Cached, program_for
from tests.cell.faults.row import Row, bound_s
from tests.cell.harness import CellUnderTest, shipped_cell

SITUATIONS = ("preparing", "depositing", "milling", "held", "resuming", "jogging", "homing")
GATES = {"stream": "trunnion_tcp", "modbus": "trunnion_rtu"}
WATCH_S = 2.0  # at the plant's own speed, behind the fault; then faster
HURRY = 10.0
HURRIED_S = 8.0  # wire time at that speed
ROUNDS = 12  # attempts to bring the cell back
S = State


@dataclass
class Outcome:
    """What came of one run. Times in ms; `wrong` holds one line for each thing that must not be."""

    row: str
    situation: str
    gate: str
    seed: int
    lit_ms: float = 0.0
    standing_ms: float = 0.0
    ended: str = ""
    wrong: list[str] = field(default_factory=list)

    @property
    def key(self) -> str:
        """Names the run so that it can be repeated."""
        return f"{self.row}/{self.situation}/{self.gate}/{self.seed}"


@lru_cache(maxsize=8)
def facts_of(gate: str, cnc: tuple[tuple[str, object], ...]) -> Cell:
    """Cell file of a gate, with changes of its CNC."""
    facts = shipped_cell(GATES[gate])
    return facts.model_copy(update={"cnc": facts.cnc.model_copy(update=dict(cnc))}) if cnc else facts


class Scene:
    """A run of one row. seed : chooses the instant and what the operator does afterwards"""

    def __init__(self, row: Row, situation: str, gate: str, seed: int) -> None:
        self.facts = facts_of(gate, row.cnc)
        self.row, self.situation = row.on(self.facts), situation
        self.random = random.Random(f"{row.name}/{situation}/{gate}/{seed}")
        self.outcome = Outcome(row.name, situation, gate, seed)
        self.replies: list[tuple[str, str, bool]] = []  # id, verb, accepted

    async def play(self, folder: Path) -> Outcome:
        """Live through it. folder : for the store"""
        async with CellUnderTest(folder / "store.db", cell=self.facts) as cell:
            self.cell = cell
            try:
                await self._bring()
                await self._strike()
                self._judge_told()
                await self._mend()
                await self._bring_back()
            except AssertionError as error:
                self._wrong(str(error).splitlines()[0][:200])
            self._judge_light()
            self._judge_record()
        return self.outcome

    def _wrong(self, line: str) -> None:
        self.outcome.wrong.append(line)

    # -- the story -----------------------------------------------------------------------------------------------------

    async def _command(self, verb: str, **args: Any) -> bool:
        ident = f"{verb}-{len(self.replies)}"
        reply = await self.cell.command(verb, ident, **args)
        self.replies.append((ident, verb, reply.ok))
        self._refusal = reply.error
        return reply.ok

    async def _start(self) -> None:
        cell = self.cell
        self.program = program_for(self.situation, self.facts.name, Cached(self.facts))
        cell.programs["job-1"] = self.program
        assert await self._command("start", job="job-1", name="job", program="job-1"), f"start: {self._refusal}"

    async def _bring(self) -> None:
        """Bring the situation about, and a random while of it."""
        cell = self.cell
        if self.situation == "jogging":
            assert await self._command("jog", axis="X", distance=200.0, feed=3000.0), self._refusal
            await cell.forward(ticks=self.random.randrange(2, 80))
        elif self.situation == "homing":
            assert await self._command("jog", axis="X", distance=200.0, feed=12000.0), self._refusal
            await cell.forward(until=cell.is_state(S.IDLE), seconds=5.0)
            assert await self._command("home"), self._refusal
            await cell.forward(ticks=self.random.randrange(2, 40))
        else:
            await self._start()
            await self._bring_job()

    async def _bring_job(self) -> None:
        cell = self.cell
        if self.situation == "preparing":
            for _ in range(self.random.randrange(4)):
                await self._until(cell.is_state(S.RUNNING, S.IDLE), HURRY)
                await self._until(cell.is_state(S.PREPARING, S.IDLE), HURRY)
            await cell.forward(ticks=self.random.randrange(1, 100))
            return
        if self.situation == "milling":
            await self._until(lambda: cell.sim.cnc.machine.spindle_rpm > 5000 and cell.sim.tip_speed_mm_s > 5.0, HURRY)
        else:
            await self._until(lambda: cell.sim.cnc.machine.motion.line >= 4, HURRY)
            await self._until(lambda: cell.sim.laser.is_emitting and cell.sim.tip_speed_mm_s > 5.0, 2.0)
        await cell.forward(ticks=self.random.randrange(3, 120))
        if self.situation in ("held", "resuming"):
            if cell.state is S.RUNNING or cell.state is S.PREPARING:
                assert await self._command("hold"), self._refusal
            await cell.forward(until=cell.is_state(S.HELD), seconds=3.0)
            await cell.forward(ticks=self.random.randrange(1, 20))
        if self.situation == "resuming":
            assert await self._command("resume"), self._refusal
            await cell.forward(ticks=self.random.randrange(1, 120))

    async def _until(self, holds: Callable[[], bool], scale: float) -> None:
        """Let the plant hurry until something holds. Raises AssertionError if it does not come about."""
        cell = self.cell
        cell.set_pace(scale)
        try:
            await cell.forward(until=holds, seconds=HURRIED_S)
        finally:
            cell.set_pace(1.0)

    def _add(self, texts: tuple[str, ...], within_s: float) -> float:
        """Have faults strike at a random instant within a while; process time of the first."""
        sim = self.cell.sim
        begin = sim.time_s + self.random.uniform(0.0, within_s)
        for text in texts:
            delay_s = 0.0
            if text.startswith("+"):
                delay, text = text[1:].split(" ", 1)
                delay_s = float(delay)
            if text.startswith(host.PREFIX):
                host.strike(self.cell, text)
                continue
            sim.faults.add(f"at={begin + delay_s:.6f}s {text}")
        return begin

    async def _strike(self) -> None:
        cell = self.cell
        self.state_before = cell.state
        self.was_in_job = cell.controller.run is not None
        self.events_before = len(cell.events)
        cell.witness.forget()
        struck_s = self._add(self.row.strike, self.facts.limits.tick_s)
        self.struck_at = cell.sim.wire_time_s + (struck_s - cell.sim.time_s)
        await cell.forward(until=None, seconds=0.3)
        await self._watch(WATCH_S)
        if not self._is_settled:
            await self._watch_hurried()
        lit_at = cell.witness.last_lit_at
        self.lit_s = max(lit_at - self.struck_at, 0.0)

    @property
    def _is_settled(self) -> bool:
        """Whether something was told and nothing goes on any more."""
        cell = self.cell
        rests = cell.state in LATCHED or cell.state in (S.OFFLINE, S.UNHOMED, S.HELD)
        if self.situation == "held" and cell.state is S.HELD:
            return False
        return rests and cell.is_dark and not cell.controller.quiesce_pending

    async def _watch(self, seconds: float) -> None:
        tick = self.facts.limits.tick_s
        for _ in range(round(seconds / tick)):
            if self._is_settled:
                break
            await self.cell.forward(ticks=1)
        await self.cell.forward(ticks=5)

    async def _watch_hurried(self) -> None:
        """A fault that nobody notices at once: go on with the job until it does, or the job is done."""
        cell = self.cell
        cell.set_pace(HURRY)
        try:
            for _ in range(round(HURRIED_S / self.facts.limits.tick_s)):
                if self._is_settled or (cell.state is S.IDLE and cell.controller.run is None):
                    break
                if self.situation == "held" and cell.state is S.HELD:
                    break
                await cell.forward(ticks=1)
        finally:
            cell.set_pace(1.0)

    # -- verdicts ------------------------------------------------------------------------------------------------------

    def _judge_told(self) -> None:
        cell, row = self.cell, self.row
        cell._commit()
        events = cell.events[self.events_before :]
        alarms = [event for event in events if event.kind == "alarm"]
        codes = [str(event.data["code"]) for event in alarms]
        codes += [code for code in cell.controller.alarms if code not in codes]  # of a store that takes no rows, too
        texts = [event.text for event in events if event.kind in ("state", "offline", "alarm", "clock")]
        if "internal" in codes:
            self._wrong(f"told as internal: {cell.controller.because}"[:220])
        for event in alarms:
            if not event.text or not event.data.get("shown_remedy"):
                self._wrong(f"alarm {event.data['code']} without cause or remedy")
        told = next((code for code in codes if code in row.codes), "")
        if not told and any(word.lower() in text.lower() for word in row.words for text in texts):
            told = next(text for text in texts if any(word.lower() in text.lower() for word in row.words))
            told = "told: " + cell.state.value.lower()
        others = [code for code in codes if code not in row.codes and code != "internal"]
        if others and not told:
            self._wrong(f"told as {', '.join(others)}: {cell.controller.because}"[:200])
        left = [*cell.controller.alarms]
        if told in row.codes and left and not row.codes.intersection(left):
            self._wrong(f"what the operator reads in the end is {', '.join(left)}")
        if self.situation in row.must and not told and not others and self._is_within_reach:
            self._wrong(f"nothing is told; {cell.state.value}, {cell.controller.because}")
        self.outcome.ended = told or (others[0] if others else "passed")

    @property
    def _is_within_reach(self) -> bool:
        """Whether the situation still lasted when the fault struck."""
        wanted = {
            "preparing": S.PREPARING, "depositing": S.RUNNING, "milling": S.RUNNING, "held": S.HELD, "resuming": S.RESUMING,
            "jogging": S.JOGGING, "homing": S.HOMING,
        }  # fmt: skip
        return self.state_before is wanted[self.situation]

    def _judge_light(self) -> None:
        row, facts, seen = self.row, self.facts, self.cell.witness
        self.outcome.standing_ms = 1000.0 * seen.standstill_s
        if seen.standstill_s > bound_s(row.standing, facts):
            self._wrong(f"light at standstill for {self.outcome.standing_ms:.0f} ms, bound {1000 * bound_s(row.standing, facts):.0f}")
        if row.lit and hasattr(self, "lit_s"):
            self.outcome.lit_ms = 1000.0 * self.lit_s
            if self.lit_s > bound_s(row.lit, facts):
                self._wrong(f"light {self.outcome.lit_ms:.0f} ms after the cause, bound {1000 * bound_s(row.lit, facts):.0f}")

    def _judge_record(self) -> None:
        cell = self.cell
        cell.journal.commit()
        events = cell.journal.events_since(0, 100000)
        seqs = [event.seq for event in events]
        if seqs != list(range(seqs[0], seqs[0] + len(seqs))):
            self._wrong("a gap in the record's numbers")
        noted = [str(event.data["id"]) for event in events if event.kind == "command"]
        for ident, verb, _ in self.replies:
            if noted.count(ident) != 1:
                self._wrong(f"command {verb} is {noted.count(ident)} times in the record")
        unfinished = cell.journal.find().unfinished
        if unfinished and cell.controller.run is None:
            self._wrong("the record has a job without an end")
        self._judge_lines()

    def _judge_lines(self) -> None:
        taken, breaks = self.cell.witness.taken, self.cell.witness.breaks_in_lines()
        if any(b <= a for a, b in breaks):
            self._wrong(f"lines done twice: {breaks[:3]}")
        if breaks and not self.row.is_gappy:
            self._wrong(f"lines lost: {breaks[:3]}")
        if self.cell.outcome == "completed" and taken != list(range(1, len(self.program.lines) + 1)):
            self._wrong(f"completed with {len(taken)} of {len(self.program.lines)} lines taken")

    # -- the way back --------------------------------------------------------------------------------------------------

    async def _mend(self) -> None:
        self._add(self.row.mend, self.facts.limits.tick_s)
        await self.cell.forward(seconds=0.5)

    async def _bring_back(self) -> None:
        """What an operator does: reset, home, resume or abort, until the cell is IDLE."""
        cell = self.cell
        said = ""
        for _ in range(ROUNDS):
            state = cell.state
            if state is S.IDLE and cell.controller.run is None:
                return
            if state in LATCHED:
                if not await self._command("reset"):
                    said = self._refusal
                    await cell.forward(seconds=0.7)
                else:
                    await self._settle(LATCHED | {S.RESETTING})
            elif state is S.UNHOMED:
                await self._command("home")
                await self._settle({S.HOMING})
            elif state is S.HELD:
                verb = self.random.choice(["resume", "abort"])
                if not await self._command(verb):
                    said = self._refusal
                await self._settle(IN_JOB - {S.HELD})
            elif state is S.OFFLINE:
                await cell.forward(seconds=1.1)
            else:
                await self._settle(IN_JOB | {S.HOMING, S.JOGGING, S.RESETTING})
        alarms = "; ".join(alarm.cause for alarm in cell.controller.alarms.values())
        self._wrong(f"not back at IDLE: {cell.state.value}, {cell.controller.because}; {alarms}; {said}; {cell.snapshot.waiting}"[:300])

    async def _settle(self, passing: frozenset[State] | set[State]) -> None:
        """Let the plant hurry until the cell is in none of these states, or for a while."""
        cell = self.cell
        cell.set_pace(HURRY)
        try:
            for _ in range(round(HURRIED_S / self.facts.limits.tick_s)):
                await cell.forward(ticks=1)
                if cell.state not in passing or cell.state is S.HELD:
                    break
        finally:
            cell.set_pace(1.0)
