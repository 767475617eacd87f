"""The journal: events, samples and runs written to SQLite by a thread of its own, in group commits; accepted things before the answer."""

from __future__ import annotations

import asyncio
import json
import sqlite3
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cellctl.domain.messages import Event

GROUP_S = 0.05  # at most twenty commits a second: a row is at most this old, and one commit more, when it is durable
BUSY_TIMEOUT_S = 5.0  # another process may hold the store's write lock that long
KEPT_COMMANDS = 10_000

# The same tables as the store's first migration.
TABLES = """
CREATE TABLE IF NOT EXISTS events (
  seq INTEGER PRIMARY KEY AUTOINCREMENT, at REAL NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL,
  job TEXT NOT NULL DEFAULT '', data TEXT NOT NULL DEFAULT '{}');
CREATE TABLE IF NOT EXISTS journal (
  id INTEGER PRIMARY KEY AUTOINCREMENT, at REAL, job TEXT, state TEXT, executed_line INTEGER, layer INTEGER, arc_mm REAL,
  laser_setpoint_w REAL, laser_readback_w REAL, powder_setpoint_g_min REAL, powder_readback_g_min REAL,
  tip_x REAL, tip_y REAL, tip_z REAL);
CREATE TABLE IF NOT EXISTS cell_runs (
  job TEXT PRIMARY KEY, name TEXT, program TEXT, program_sha256 TEXT, started_at REAL, ended_at REAL, outcome TEXT,
  last_line INTEGER, total_lines INTEGER, who TEXT, command_id TEXT UNIQUE);
"""
EVENT = "INSERT INTO events (at, kind, text, job, data) VALUES (?, ?, ?, ?, ?)"
SAMPLE = (
    "INSERT INTO journal (at, job, state, executed_line, layer, arc_mm, laser_setpoint_w, laser_readback_w,"
    " powder_setpoint_g_min, powder_readback_g_min, tip_x, tip_y, tip_z) VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?)"
)
RUN = (
    "INSERT INTO cell_runs (job, name, program, program_sha256, started_at, ended_at, outcome, last_line, total_lines, who,"
    " command_id) VALUES (?,?,?,?,?,NULL,'',0,?,?,?)"
)
PROGRESS = "UPDATE cell_runs SET last_line = ? WHERE job = ?"
END = "UPDATE cell_runs SET ended_at = ?, outcome = ?, last_line = ? WHERE job = ?"


class StoreError(Exception):
    """The store cannot be used. `message` is one line; `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


@dataclass(frozen=True)
class Sample:
    """One row of the journal. at : Unix time (s); executed_line : count of executed lines; arc in mm, tip in the build frame."""

    at: float
    job: str
    state: str
    executed_line: int
    layer: int
    arc_mm: float
    laser_setpoint_w: float
    laser_readback_w: float
    powder_setpoint_g_min: float
    powder_readback_g_min: float
    tip: tuple[float, float, float]

    @property
    def row(self) -> tuple[Any, ...]:
        """Values in the order of the table."""
        return (
            self.at, self.job, self.state, self.executed_line, self.layer, self.arc_mm, self.laser_setpoint_w,
            self.laser_readback_w, self.powder_setpoint_g_min, self.powder_readback_g_min, *self.tip,
        )  # fmt: skip


@dataclass(frozen=True)
class UnfinishedRun:
    """A run that no process ended."""

    job: str
    name: str
    last_line: int
    total_lines: int


@dataclass
class Found:
    """What the store held when it was opened.

    is_stopped : whether a stop was latched and not reset since
    jobs : all that were ever started; replies : per command id the reply that it got; alarms : latched and not reset since, as (code, detail, remedy)
    """

    unfinished: list[UnfinishedRun] = field(default_factory=list)
    replies: dict[str, dict[str, Any]] = field(default_factory=dict)
    jobs: set[str] = field(default_factory=set)
    alarms: list[tuple[str, str, str]] = field(default_factory=list)
    is_stopped: bool = False


@dataclass
class _Pending:
    """What waits for the next commit."""

    statements: list[tuple[str, tuple[Any, ...]]] = field(default_factory=list)
    events: list[tuple[int, Event]] = field(default_factory=list)  # position in statements
    waiting: list[Callable[[Exception | None], None]] = field(default_factory=list)


class Journal:
    """Takes rows without blocking and commits them from its own thread (`start`), or where it stands (`commit`).
    The first row after a pause is on the disk within the time of one commit; then at most 1 / GROUP_S commits a second.

    on_committed gets the events of a commit, with their seq, after they are durable; on_failure gets one line when the store fails.
    Both are called from the committing thread.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.on_committed: Callable[[list[Event]], None] = lambda events: None
        self.on_failure: Callable[[str], None] = lambda line: None
        self.commits = 0
        self._lock = threading.Lock()
        self._wake = threading.Event()  # something is queued
        self._urgent = threading.Event()  # somebody waits for it to be durable
        self._closing = False
        self._thread: threading.Thread | None = None
        self._pending = _Pending()
        try:
            self._db = sqlite3.connect(path, timeout=BUSY_TIMEOUT_S, check_same_thread=False, isolation_level=None)
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=FULL")
            self._db.executescript(TABLES)
        except sqlite3.Error as error:
            raise StoreError(
                f"{path}: the store cannot be opened: {error}", "name a file in a directory that can be written"
            ) from None

    def find(self) -> Found:
        """What an earlier process left: unfinished runs, answered commands, latched alarms."""
        found = Found()
        rows = self._db.execute(
            "SELECT job, name, last_line, total_lines FROM cell_runs WHERE ended_at IS NULL ORDER BY started_at"
        )
        found.unfinished = [UnfinishedRun(*row) for row in rows]
        found.jobs = {job for (job,) in self._db.execute("SELECT job FROM cell_runs")}
        rows = self._db.execute(
            "SELECT data FROM events WHERE kind = 'command' ORDER BY seq DESC LIMIT ?", (KEPT_COMMANDS,)
        )
        for (data,) in reversed(rows.fetchall()):
            entry = json.loads(data)
            found.replies.setdefault(entry["id"], entry["reply"])
        rows = self._db.execute(
            "SELECT data FROM events WHERE kind = 'alarm' AND seq > (SELECT coalesce(max(seq), 0) FROM events WHERE kind = 'reset') ORDER BY seq"
        )
        found.alarms = [
            (entry["code"], entry["detail"], entry["remedy"]) for entry in map(json.loads, (row[0] for row in rows))
        ]
        last = self._db.execute("SELECT data FROM events WHERE kind = 'state' ORDER BY seq DESC LIMIT 1").fetchone()
        found.is_stopped = last is not None and json.loads(last[0])["state"] == "STOPPED"
        return found

    def start(self) -> None:
        """Commit from a thread of its own from now on."""
        self._thread = threading.Thread(target=self._run, name="journal")
        self._thread.start()

    def event(self, event: Event) -> None:
        """Queue an event; its seq is given by the store at the commit."""
        text = event.text.encode("utf-8", "replace").decode()  # half a surrogate pair has no place in a store
        row = (event.at, event.kind, text, event.job, json.dumps(event.data))
        with self._lock:
            self._pending.events.append((len(self._pending.statements), event))
            self._pending.statements.append((EVENT, row))
        self._wake.set()

    def write(self, statement: str, row: tuple[Any, ...]) -> None:
        """Queue one statement (SAMPLE, RUN, PROGRESS, END)."""
        with self._lock:
            self._pending.statements.append((statement, row))
        self._wake.set()

    async def durable(self) -> None:
        """Return when all that was queued before is on the disk. Raises StoreError if it cannot be."""
        if self._thread is None:
            self.commit()
            return
        loop = asyncio.get_running_loop()
        done: asyncio.Future[None] = loop.create_future()

        def settle(error: Exception | None) -> None:
            if not done.done():
                done.set_exception(error) if error else done.set_result(None)

        with self._lock:
            self._pending.waiting.append(lambda error: _threadsafe(loop, settle, error))
        self._urgent.set()
        self._wake.set()
        await done

    def commit(self) -> None:
        """Write what is queued in one transaction. Raises StoreError; what was queued stays queued then."""
        with self._lock:
            batch, self._pending = self._pending, _Pending()
        if not batch.statements:
            _answer(batch, None)
            return
        try:
            events = self._transact(batch)
        except (sqlite3.Error, ValueError, OverflowError) as error:
            refusal = StoreError(
                f"{self.path}: the journal cannot be written: {error}",
                "make room on the disk or free the store, then reset",
            )
            with self._lock:
                self._pending.statements[:0] = batch.statements
                self._pending.events = [
                    *batch.events,
                    *((k + len(batch.statements), e) for k, e in self._pending.events),
                ]
            _answer(batch, refusal)
            raise refusal from None
        self.commits += 1
        _answer(batch, None)
        if events:
            self.on_committed(events)

    def _transact(self, batch: _Pending) -> list[Event]:
        names = dict(batch.events)
        events = []
        self._db.execute("BEGIN IMMEDIATE")
        try:
            for position, (statement, row) in enumerate(batch.statements):
                cursor = self._db.execute(statement, row)
                if position in names:
                    event = names[position]
                    events.append(
                        Event(int(cursor.lastrowid or 0), event.at, event.kind, event.text, event.job, event.data)
                    )
            self._db.execute("COMMIT")
        except (sqlite3.Error, ValueError, OverflowError):
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise
        return events

    def events_since(self, seq: int, limit: int = 1000) -> list[Event]:
        """Events after seq, oldest first, as they are on the disk."""
        rows = self._db.execute(
            "SELECT seq, at, kind, text, job, data FROM events WHERE seq > ? ORDER BY seq LIMIT ?", (seq, limit)
        )
        return [Event(row[0], row[1], row[2], row[3], row[4], json.loads(row[5])) for row in rows]

    def _run(self) -> None:
        """Commit what is queued at once, then let a while go by in which rows gather; a command does not wait for that."""
        while True:
            self._wake.wait()
            self._wake.clear()
            closing = self._closing
            self._urgent.clear()
            try:
                self.commit()
            except StoreError as error:
                self.on_failure(error.message)
                self._wake.set()
            if closing:
                return
            self._urgent.wait(GROUP_S)

    def close(self) -> None:
        """Commit what is queued, end the thread, close the store. Harmless twice."""
        if self._thread is not None:
            self._closing = True
            self._urgent.set()
            self._wake.set()
            self._thread.join()
            self._thread = None
        self._db.close()


def _answer(batch: _Pending, error: Exception | None) -> None:
    for settle in batch.waiting:
        settle(error)


def _threadsafe(
    loop: asyncio.AbstractEventLoop, settle: Callable[[Exception | None], None], error: Exception | None
) -> None:
    if not loop.is_closed():
        loop.call_soon_threadsafe(settle, error)
