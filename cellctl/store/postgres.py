"""Shared tables on PostgreSQL: how its engine is opened, and what its transactions hold.

Writers of the whole house come one at a time, as SQLite's BEGIN IMMEDIATE has it: each takes one advisory lock as its first statement
and holds it to its end, and then sees all that was committed before. Readers see one state (REPEATABLE READ) and wait for nobody.
"""

from __future__ import annotations

from sqlalchemy import URL, Connection, Engine, create_engine, event, text

LOCK_TIMEOUT_MS = 10_000  # a writer waits so long for the others, then it fails
WRITERS = 0x63656C6C  # the advisory lock of those that write: any number, the same in all versions
IDLE_S = 20  # a writer that says nothing for so long (its host froze) is ended by the server: the others wait for it
CONNECT_S = 3  # a server that does not answer is told as gone, before somebody at a console gives up
SILENCE_S = 10  # bytes unanswered for so long: the connection is lost
POOL = 5  # connections kept, and as many more for a moment: ten hosts are within the hundred that a server has by default
SESSION = {
    "lock_timeout": f"{LOCK_TIMEOUT_MS}",
    "synchronous_commit": "on",
    "client_encoding": "UTF8",
    "tcp_keepalives_idle": f"{SILENCE_S}",
    "tcp_keepalives_interval": "2",
    "tcp_keepalives_count": "3",
}
"""Settings of a session on the server, which so finds out that a host is gone and lets go of its lock. Ignored at a Unix socket."""
CONNECT = {
    "application_name": "cellctl",
    "connect_timeout": CONNECT_S,
    "keepalives_idle": SILENCE_S,
    "keepalives_interval": 2,
    "keepalives_count": 3,
    "tcp_user_timeout": SILENCE_S * 1000,
}
TAKE_TURN = text(f"SELECT set_config('idle_in_transaction_session_timeout', '{IDLE_S * 1000}', true), pg_advisory_xact_lock({WRITERS})")


def open_postgres(url: URL) -> Engine:
    """Engine on a PostgreSQL database. Nothing is connected yet: that can fail at every use, and works again when the server does."""
    options = " ".join(f"-c {name}={value}" for name, value in SESSION.items())
    engine = create_engine(
        url.set(drivername="postgresql+psycopg"),
        connect_args={**CONNECT, "options": options},
        pool_pre_ping=True,
        pool_size=POOL,
        max_overflow=POOL,
        pool_timeout=LOCK_TIMEOUT_MS / 1000,
    )

    @event.listens_for(engine, "begin")
    def _begun(connection: Connection) -> None:
        if connection.get_execution_options().get("cellctl_write", False):
            connection.execute(TAKE_TURN)

    return engine


def only_reading(connection: Connection) -> Connection:
    """The connection, for a transaction that sees one state and can change nothing."""
    return connection.execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
