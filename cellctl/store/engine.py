"""The database and the folder of a store: how both are opened, brought up to date and locked."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.exc import DatabaseError

from cellctl.domain.trouble import trouble_of
from cellctl.store.blobs import Blobs
from cellctl.store.postgres import only_reading

BUSY_TIMEOUT_MS = 10_000  # the cell process commits ten times a second; a writer waits for it rather than fails
DATABASE = "store.db"
CACHE_KIB = 512  # of one connection, beside the system's own: a pool of them grows with the store to no more than this each


class StoreError(Exception):
    """The store cannot be opened. `message` is one line, `hint` says what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class InUse:
    """Counts open transactions, so that a store is closed behind the last one: threads outlive the tasks that wait for them."""

    def __init__(self) -> None:
        self._free = threading.Condition()
        self._count = 0

    @contextmanager
    def one(self) -> Iterator[None]:
        """One more for the time of the block."""
        with self._free:
            self._count += 1
        try:
            yield
        finally:
            with self._free:
                self._count -= 1
                self._free.notify_all()

    def wait(self, timeout_s: float) -> bool:
        """Block until none is open; False if that takes longer than timeout_s."""
        with self._free:
            return self._free.wait_for(lambda: self._count == 0, timeout_s)


@dataclass(frozen=True)
class Store:
    """An open store: rows in `engine`, files in `blobs`. `clock` gives Unix seconds."""

    folder: Path
    engine: Engine
    blobs: Blobs
    clock: Callable[[], float] = time.time
    in_use: InUse = field(default_factory=InUse)

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction that sees one state of the store and changes nothing."""
        with self.in_use.one(), reading(self.engine) as connection, connection.begin():
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction that holds the write lock from its start; durable (fsync) when the block is left."""
        connect = self.engine.connect
        with self.in_use.one(), connect().execution_options(cellctl_write=True) as connection, connection.begin():
            yield connection

    def close(self) -> None:
        """Give back every connection, once the transactions that are under way have ended."""
        self.in_use.wait(BUSY_TIMEOUT_MS / 1000)
        self.engine.dispose()


def reading(engine: Engine) -> Connection:
    """A connection whose transactions see one state of the store and change nothing."""
    connection = engine.connect()
    return only_reading(connection) if engine.dialect.name == "postgresql" else connection


def open_engine(database: Path) -> Engine:
    """Engine on a SQLite file: WAL, synchronous=FULL, foreign keys, explicit BEGIN."""
    engine = create_engine(
        f"sqlite:///{database}", connect_args={"check_same_thread": False, "timeout": BUSY_TIMEOUT_MS / 1000}
    )

    @event.listens_for(engine, "connect")
    def _connected(connection: Any, _record: Any) -> None:
        connection.isolation_level = None  # BEGIN is sent below, so that it can be IMMEDIATE
        pragmas = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", f"busy_timeout={BUSY_TIMEOUT_MS}", f"cache_size=-{CACHE_KIB}")
        for pragma in pragmas:
            connection.execute(f"PRAGMA {pragma}").close()

    @event.listens_for(engine, "begin")
    def _begun(connection: Connection) -> None:
        immediate = connection.get_execution_options().get("cellctl_write", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if immediate else "BEGIN")

    return engine


def upgrade(folder: Path) -> None:
    """Make the folder and its database, or bring them to the newest schema. Raises StoreError if that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.chmod(folder, 0o700)
        Blobs(folder / "blobs").make_folders()
    except OSError as error:
        raise StoreError(
            f"{folder}: cannot be used as a store: {error.strerror}", "name a folder that can be written with --store"
        ) from None
    engine = open_engine(folder / DATABASE)
    try:
        migrate(engine, str(folder / DATABASE))
    finally:
        engine.dispose()


def migrate(engine: Engine, name: str) -> None:
    """Bring a database to the newest schema. name : as it is told in errors. Raises StoreError."""
    from alembic import command
    from alembic.config import Config
    from alembic.util.exc import CommandError

    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    config.attributes["engine"] = engine
    try:
        command.upgrade(config, "head")
    except CommandError as error:
        raise StoreError(f"{name}: was written by another version: {error}", "use the version that wrote it, or a fresh --store") from None
    except DatabaseError as error:
        trouble = trouble_of(error)
        hint = trouble.hint if trouble is not None else "it may be damaged: restore a backup, or name a fresh --store"
        raise StoreError(f"{name}: {error.orig}", hint) from None


def open_store(folder: Path, clock: Callable[[], float] = time.time) -> Store:
    """Open an existing store. Raises StoreError if there is none."""
    if not (folder / DATABASE).is_file():
        raise StoreError(
            f"{folder}: there is no store here",
            "start the service once with `cellctl serve`, or name its folder with --store",
        )
    return Store(folder, open_engine(folder / DATABASE), Blobs(folder / "blobs"), clock)
