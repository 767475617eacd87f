"""A cell process at the far end of the web's socket: it keeps the table as the real one does, and writes runs as it does."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from cellctl.cell.ipc import IpcServer
from cellctl.domain.messages import Command, Reply
from cellctl.domain.snapshot import JobView, Lines, Snapshot, Table

LINES = 10


@dataclass
class FarCell:
    """Call `start`, then `show` for a snapshot. unix : the clock, Unix s; started : (job, when, confirmed_at) of every start that it took"""

    store: Path
    unix: Callable[[], float]
    state: str = "IDLE"
    job: str = ""
    disturbed_at: float = 0.0
    because: str = ""
    seq: int = 0
    started: list[tuple[str, float, float]] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    answered: dict[str, Reply] = field(default_factory=dict)

    async def open(self, socket: Path) -> None:
        """Listen."""
        self.server = IpcServer(self.answer, "a cell")
        await self.server.start(socket)

    async def answer(self, command: Command) -> Reply:
        """A start on a table that was disturbed since it was looked at is refused, as is a second job; hold, resume and abort are for a job."""
        if command.verb != "start":
            if self.job and command.verb in ("hold", "resume"):
                self.state = {"hold": "HELD", "resume": "RUNNING"}[command.verb]
            elif self.job and command.verb == "abort":
                self.end("aborted")
            return Reply(command.id, True)
        if command.id not in self.answered:
            self.answered[command.id] = self._start(command)
        return self.answered[command.id]

    def _start(self, command: Command) -> Reply:
        job, confirmed_at = str(command.args["job"]), float(command.args["confirmed_at"])
        if self.state != "IDLE":
            return self._refuse(command, f"the cell is {self.state}", "state")
        if self.disturbed_at > confirmed_at:
            return self._refuse(command, f"{self.because} after the table was found clear", "table")
        self._write("INSERT INTO cell_runs (job, name, started_at, outcome, last_line, total_lines) VALUES (?, ?, ?, '', 0, ?)",
                    job, job, self.unix(), LINES)  # fmt: skip
        self.state, self.job = "RUNNING", job
        self.started.append((job, self.unix(), confirmed_at))
        return Reply(command.id, True, data={"state": self.state})

    def _refuse(self, command: Command, why: str, kind: str) -> Reply:
        self.refused.append(why)
        return Reply(command.id, False, why, "look again", kind=kind)

    def end(self, outcome: str, because: str = "a job ran") -> None:
        """The run is over."""
        self._write("UPDATE cell_runs SET outcome = ?, ended_at = ?, last_line = ? WHERE job = ?", outcome, self.unix(), LINES, self.job)
        self.state, self.job = "IDLE", ""
        self.disturb(because)

    def disturb(self, because: str) -> None:
        """Nobody may rely any more on what was seen of the table before."""
        self.disturbed_at, self.because = self.unix(), because

    def restart(self) -> None:
        """The process ended and is there again: what ran is interrupted, and nobody watched the table meanwhile."""
        if self.job:
            self.end("interrupted")
        self.disturb("the cell process was not there")

    def _write(self, sql: str, *values: object) -> None:
        with closing(sqlite3.connect(self.store / "store.db", timeout=10.0)) as db, db:
            db.execute(sql, values)

    async def show(self, is_taken: Callable[[int], bool]) -> None:
        """Publish a snapshot, and wait until it is taken."""
        self.seq += 1
        view = JobView(self.job, self.job) if self.job else None
        snapshot = Snapshot(self.seq, self.unix(), "c", "sim", self.state, "READY", job=view, table=Table(self.disturbed_at, self.because))
        shown = msgspec.structs.replace(snapshot, lines=Lines(executed=1, total=LINES), because="a person pressed hold")
        async with asyncio.timeout(20.0):
            while not is_taken(self.seq):
                self.server.publish(shown)
                await asyncio.sleep(0.002)

    async def close(self) -> None:
        """Listen no more."""
        await self.server.close()
