"""The journal: events, samples and runs written to SQLite by a thread of its own, in group commits; accepted things before the answer."""

from __future__ import annotations

import asyncio
import json
import os
import sqlite3
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cellctl.cell.black_box import BlackBox
from cellctl.cell.journal_rows import END, EVENT, PROGRESS, RUN, SAMPLE, TABLES, Found, Sample, UnfinishedRun, find
from cellctl.cell.sample_keeping import KEPT_WHOLE, SampleKeeping
from cellctl.domain.messages import Event
from cellctl.domain.trouble import of_database

__all__ = ["END", "PROGRESS", "RUN", "SAMPLE", "Found", "Journal", "Sample", "StoreError", "UnfinishedRun"]

GROUP_S = 0.05  # at most twenty commits a second: a row is at most this old, and one commit more, when it is durable
CACHE_KIB = 512  # pages of the store in memory: rows are only added, at its end
BUSY_TIMEOUT_S = 5.0  # another process may hold the store's write lock that long
RETRY_S = 0.5  # between two tries of a store that refuses
KEEPING_S = 2.0  # between two steps of removing old samples: many times as fast as new ones come
Row = tuple[Any, ...]
ROW_ERRORS = (
    sqlite3.IntegrityError,
    sqlite3.DataError,
    sqlite3.InterfaceError,
    sqlite3.ProgrammingError,
    ValueError,
    OverflowError,
)
"""What says that a row cannot be written, however often it is tried; anything else says so of the store."""


class StoreError(Exception):
    """The store cannot be used. `message` is one line; `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class _RowRefusedError(Exception):
    """The store takes the batch but for one row. position : of its statement"""

    def __init__(self, position: int, why: Exception) -> None:
        super().__init__(str(why))
        self.position = position


@dataclass
class _Pending:
    """What waits for the next commit."""

    statements: list[tuple[str, Row]] = field(default_factory=list)
    events: list[tuple[int, Event]] = field(default_factory=list)  # position in statements
    waiting: list[Callable[[StoreError | None], None]] = field(default_factory=list)

    def prepend(self, earlier: _Pending) -> None:
        """Put rows that were taken out back in front."""
        self.statements[:0] = earlier.statements
        self.events = [*earlier.events, *((k + len(earlier.statements), event) for k, event in self.events)]

    def without(self, position: int) -> tuple[str, Row]:
        """Take one row out; the row."""
        self.events = [(k - (k > position), event) for k, event in self.events if k != position]
        return self.statements.pop(position)


class Journal:
    """Takes rows without blocking and commits them from its own thread (`start`), or where it stands (`commit`).
    The first row after a pause is on the disk within the time of one commit; then at most 1 / GROUP_S commits a second.
    A store that is locked, full or read-only is tried again until it takes what is queued, in order. A row that can never be
    written is set aside in a file beside the store, and an event says so; the others go on.

    on_committed gets the events of a commit, with their seq, after they are durable; on_failure gets one line when the store fails.
    Both are called from the committing thread.  box : the black box of the run, beside the store unless it is given
    samples_kept : rows of samples that are kept whole (sample_keeping.py)
    """

    def __init__(self, path: Path, box: Path | None = None, samples_kept: int = KEPT_WHOLE) -> None:
        self.path = path
        self.refused_path = path.with_name(f"{path.name}.refused.jsonl")
        self.on_committed: Callable[[list[Event]], None] = lambda events: None
        self.on_failure: Callable[[str], None] = lambda line: None
        self.commits = 0
        self.failure = ""  # why the store refused the last commit; empty once it took one
        self._lock = threading.Lock()
        self._wake = threading.Event()  # something is queued
        self._urgent = threading.Event()  # somebody waits for it to be durable
        self._closing = False
        self._thread: threading.Thread | None = None
        self._pending = _Pending()
        self._awaited: list[Row] = []  # rows queued since the last `durable` whose refusal is the asker's
        self._refusals: list[tuple[Row, StoreError]] = []
        try:
            self._db = sqlite3.connect(path, timeout=BUSY_TIMEOUT_S, check_same_thread=False, isolation_level=None)
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=FULL")
            self._db.execute(f"PRAGMA cache_size=-{CACHE_KIB}")
            self._db.executescript(TABLES)
            self._keeping = SampleKeeping(self._db, samples_kept)
            self._file = _file_of(path)
            self.box = BlackBox(box or path.with_name(f"{path.name}.box"))
        except (sqlite3.Error, OSError) as error:
            raise StoreError(
                f"{path}: the store cannot be opened: {error}", "name a file in a directory that can be written"
            ) from None

    def find(self) -> Found:
        """What an earlier process left: unfinished runs, answered commands, latched alarms."""
        return find(self._db, self.box)

    def start(self, first: Callable[[], None] = lambda: None) -> None:
        """Commit from a thread of its own from now on, which calls `first` first."""
        self._thread = threading.Thread(target=self._run, args=(first,), name="journal")
        self._thread.start()

    def event(self, event: Event) -> None:
        """Queue an event; its seq is given by the store at the commit."""
        text = event.text.encode("utf-8", "replace").decode()  # half a surrogate pair has no place in a store
        row = (event.at, event.kind, text, event.job, json.dumps(event.data, default=str))
        with self._lock:
            self._pending.events.append((len(self._pending.statements), event))
            self._pending.statements.append((EVENT, row))
        if event.kind == "command":
            self._awaited.append(row)
        self._wake.set()

    def write(self, statement: str, row: Row) -> None:
        """Queue one statement (SAMPLE, RUN, PROGRESS, END)."""
        with self._lock:
            self._pending.statements.append((statement, row))
        if statement == RUN:
            self._awaited.append(row)
        self._wake.set()

    def withdraw(self, row: Row) -> bool:
        """Take a row back that has not reached the store; whether it was still queued."""
        with self._lock:
            position = next((k for k, (_, queued) in enumerate(self._pending.statements) if queued is row), None)
            if position is not None:
                self._pending.without(position)
        return position is not None

    async def durable(self) -> None:
        """Return when all that was queued before is on the disk. Raises StoreError if it cannot be, or if the store refused a run or a
        command that was queued since the last call."""
        mine, self._awaited = self._awaited, []
        if self._thread is None:
            self.commit()
        else:
            await self._committed()
        with self._lock:
            refusal = next((why for row, why in self._refusals if any(row is one for one in mine)), None)
            self._refusals = [one for one in self._refusals if not any(one[0] is row for row in mine)]
        _raise_anew(refusal)

    async def _committed(self) -> None:
        loop = asyncio.get_running_loop()
        done: asyncio.Future[StoreError | None] = loop.create_future()

        def settle(error: StoreError | None) -> None:
            if not done.done():
                done.set_result(error)

        with self._lock:
            self._pending.waiting.append(lambda error: _threadsafe(loop, settle, error))
        self._urgent.set()
        self._wake.set()
        _raise_anew(await done)

    def commit(self) -> None:
        """Write what is queued in one transaction. Raises StoreError; what was queued stays queued then."""
        with self._lock:
            batch, self._pending = self._pending, _Pending()
        while batch.statements:
            try:
                events = self._transact(batch)
                break
            except _RowRefusedError as error:
                self._set_aside(batch, error)
            except sqlite3.Error as error:
                raise self._put_back(batch, error) from None
        else:
            _answer(batch, None)
            return
        self.commits += 1
        self.failure = ""
        _answer(batch, None)
        if events:
            self.on_committed(events)

    def _put_back(self, batch: _Pending, error: sqlite3.Error) -> StoreError:
        """The store refuses: nothing is lost, whoever waits is told."""
        trouble = of_database(error)
        refusal = StoreError(
            f"{self.path}: the journal cannot be written: {error}",
            f"{trouble.hint if trouble else 'make room on the disk or free the store'}; then reset",
        )
        self.failure = refusal.message
        with self._lock:
            self._pending.prepend(batch)
        _answer(batch, refusal)
        return refusal

    def _set_aside(self, batch: _Pending, error: _RowRefusedError) -> None:
        """Keep a row that the store will never take; an event says so, and who waits for it to be durable."""
        statement, row = batch.without(error.position)
        line = f"the store refused a row for ever ({error}); it is kept in {self.refused_path.name}"
        at = time.time()
        kept = {"at": at, "why": str(error), "statement": statement, "row": row}
        try:
            with self.refused_path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(kept, default=repr) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as failure:
            line = f"the store refused a row for ever ({error}), and {self.refused_path.name} cannot be written: {failure.strerror}"
        told = Event(0, at, "store", line, "", {"why": str(error)})
        batch.events.append((len(batch.statements), told))
        batch.statements.append((EVENT, (told.at, told.kind, told.text, told.job, json.dumps(told.data))))
        if statement == RUN or (statement == EVENT and row[1] == "command"):
            refusal = StoreError(line, "note what was asked, and tell the maintainers")
            with self._lock:
                self._refusals.append((row, refusal))

    def _transact(self, batch: _Pending) -> list[Event]:
        """Raises _RowRefusedError for a row that can never be written, sqlite3.Error for the store."""
        names = dict(batch.events)
        events = []
        if _file_of(self.path) != self._file:  # rows would go to a file that nobody finds again
            raise sqlite3.OperationalError("unable to open database file: it was removed or replaced")
        self._db.execute("BEGIN IMMEDIATE")
        try:
            for position, (statement, row) in enumerate(batch.statements):
                try:
                    cursor = self._db.execute(statement, row)
                except ROW_ERRORS as error:
                    raise _RowRefusedError(position, error) from None
                if position in names:
                    event = names[position]
                    events.append(
                        Event(int(cursor.lastrowid or 0), event.at, event.kind, event.text, event.job, event.data)
                    )
            self._db.execute("COMMIT")
        except (sqlite3.Error, _RowRefusedError):
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

    def _run(self, first: Callable[[], None]) -> None:
        """Commit what is queued at once, then let a while go by in which rows gather; a command does not wait for that."""
        first()
        kept_at = time.monotonic()
        while True:
            self._wake.wait()
            self._wake.clear()
            closing = self._closing
            self._urgent.clear()
            pause_s = GROUP_S
            try:
                self.commit()
            except StoreError as error:
                self.on_failure(error.message)
                self._wake.set()
                pause_s = RETRY_S
            if closing:
                return
            if not self.failure and not self._urgent.is_set() and time.monotonic() - kept_at > KEEPING_S:
                self._keeping.step()
                kept_at = time.monotonic()
            self._urgent.wait(pause_s)

    def close(self) -> None:
        """Commit what is queued, end the thread, close the store. Harmless twice."""
        if self._thread is not None:
            self._closing = True
            self._urgent.set()
            self._wake.set()
            self._thread.join()
            self._thread = None
        self._db.close()
        self.box.close()


def _file_of(path: Path) -> tuple[int, int]:
    """Which file the name stands for (device, inode); (0, 0) if there is none."""
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_dev, found.st_ino


def _answer(batch: _Pending, error: StoreError | None) -> None:
    for settle in batch.waiting:
        settle(error)


def _raise_anew(error: StoreError | None) -> None:
    """Raise what was found, as an error that nothing keeps: its traceback holds what is under way, a program's file among it."""
    if error is not None:
        raise StoreError(error.message, error.hint)


def _threadsafe(
    loop: asyncio.AbstractEventLoop, settle: Callable[[StoreError | None], None], error: StoreError | None
) -> None:
    if not loop.is_closed():
        loop.call_soon_threadsafe(settle, error)
