"""A store: its databases, its files, and its transactions; how it is opened and brought up to date.

Where `shared.toml` says so, what people share lies in PostgreSQL and in a folder that all hosts see; what the cell process writes, and
what is made of it, lies in SQLite in the store's folder always. Otherwise both are the same SQLite file.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import URL, Connection, Engine, event
from sqlalchemy.exc import DatabaseError

from cellctl.domain.trouble import trouble_of
from cellctl.faults import one_line
from cellctl.store.blobs import Blobs
from cellctl.store.errors import StoreError
from cellctl.store.postgres import LOCK_TIMEOUT_MS, only_reading, open_postgres
from cellctl.store.shared import FILE, shared_of
from cellctl.store.sides import Side, check_side
from cellctl.store.sqlite import BUSY_TIMEOUT_MS, DATABASE, open_engine

__all__ = ["BUSY_TIMEOUT_MS", "DATABASE", "InUse", "Store", "StoreError", "migrate", "open_engine", "open_store", "upgrade"]


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
    """An open store: what people share in `engine`, what the cell process writes in `cell_engine` (the same one where nothing is shared
    with other hosts), files in `blobs`. `clock` gives Unix seconds."""

    folder: Path
    engine: Engine
    cell_engine: Engine
    blobs: Blobs
    clock: Callable[[], float] = time.time
    in_use: InUse = field(default_factory=InUse)

    @property
    def is_shared(self) -> bool:
        """Whether other hosts work with the same jobs."""
        return self.engine is not self.cell_engine

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction of the shared tables that sees one state of them and changes nothing."""
        with self.in_use.one(), connect(self.engine, Side.SHARED) as connection, connection.begin():
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction of the shared tables that holds the write lock from its start; durable when the block is left."""
        with self.in_use.one(), connect(self.engine, Side.SHARED, write=True) as connection, connection.begin():
            yield connection

    @contextmanager
    def read_cell(self) -> Iterator[Connection]:
        """As `read`, of what the cell process wrote and what is made of it. It needs no other host."""
        with self.in_use.one(), connect(self.cell_engine, Side.OWN) as connection, connection.begin():
            yield connection

    @contextmanager
    def write_cell(self) -> Iterator[Connection]:
        """As `write`, of the cell's own tables; durable (fsync) when the block is left."""
        with self.in_use.one(), connect(self.cell_engine, Side.OWN, write=True) as connection, connection.begin():
            yield connection

    def close(self) -> None:
        """Give back every connection, once the transactions that are under way have ended."""
        self.in_use.wait(max(BUSY_TIMEOUT_MS, LOCK_TIMEOUT_MS) / 1000)
        self.engine.dispose()
        self.cell_engine.dispose()


def connect(engine: Engine, side: Side, write: bool = False) -> Connection:
    """A connection for one transaction. write : it holds the write lock from its start, else it sees one state and changes nothing"""
    connection = engine.connect().execution_options(cellctl_side=side, cellctl_write=write)
    return connection if write or engine.dialect.name == "sqlite" else only_reading(connection)


def upgrade(folder: Path) -> None:
    """Make the folder and its databases, or bring them to the newest schema. Raises StoreError if that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.chmod(folder, 0o700)
    except OSError as error:
        raise StoreError(
            f"{folder}: cannot be used as a store: {error.strerror}", "name a folder that can be written with --store"
        ) from None
    shared = shared_of(folder)
    blobs = blobs_of(folder)
    try:
        blobs.make_folders()
    except OSError as error:
        hint = "name a folder that can be written with --store" if shared is None else "mount it on this host, writable for the service"
        raise StoreError(f"{blobs.folder}: cannot be used for files: {error.strerror}", hint) from None
    engine = open_engine(folder / DATABASE)
    try:
        migrate(engine, str(folder / DATABASE))
    finally:
        engine.dispose()
    if shared is not None:
        engine = open_shared(folder, shared.database)
        try:
            migrate(engine, shared.database.render_as_string())
        finally:
            engine.dispose()


def blobs_of(folder: Path) -> Blobs:
    """The files of the store in a folder. Raises StoreError."""
    shared = shared_of(folder)
    return Blobs(folder / "blobs") if shared is None else Blobs(shared.files, folder / "blobs", shared.host)


def open_shared(folder: Path, database: URL) -> Engine:
    """The engine of the shared tables. Raises StoreError where its driver is not installed."""
    try:
        return open_postgres(database)
    except ModuleNotFoundError:
        raise StoreError(f"{folder / FILE}: PostgreSQL needs a driver that is not installed", "pip install hybridcell[postgres]") from None


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
        raise StoreError(f"{name}: {one_line(str(error.orig))}", hint) from None


def open_store(folder: Path, clock: Callable[[], float] = time.time) -> Store:
    """Open an existing store. Raises StoreError if there is none. That a server of PostgreSQL is there is seen at the first transaction."""
    if not (folder / DATABASE).is_file():
        raise StoreError(
            f"{folder}: there is no store here",
            "start the service once with `cellctl serve`, or name its folder with --store",
        )
    shared = shared_of(folder)
    own = open_engine(folder / DATABASE)
    if shared is None:
        return Store(folder, own, own, blobs_of(folder), clock)
    engine = open_shared(folder, shared.database)
    for one in (engine, own):
        event.listen(one, "before_cursor_execute", check_side)
    return Store(folder, engine, own, blobs_of(folder), clock)
