"""A store's SQLite file: how its engine is opened, and what its transactions hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event

BUSY_TIMEOUT_MS = 10_000  # the cell process commits ten times a second; a writer waits for it rather than fails
DATABASE = "store.db"
CACHE_KIB = 512  # of one connection, beside the system's own: a pool of them grows with the store to no more than this each


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
