"""A PostgreSQL server of the tests' own: made in a folder under /tmp, reached by a Unix socket only, gone with the session.

A database is copied from one that has the newest schema, so that each test has one of its own for a few hundredths of a second.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:  # loaded when a test asks for a server: every session reads this file
    from sqlalchemy import URL

BINARIES = "/usr/lib/postgresql"  # Debian keeps initdb here, beside the path
PEOPLE = ("postgres", "nobody")  # who runs the server where we are root, as it refuses to be
OWNER = "cells"
TEMPLATE = "newest"
START_S = 30.0
PR_SET_PDEATHSIG = 1
SETTINGS = {
    "listen_addresses": "",
    "fsync": "off",  # the machine that tests are run on may lose power: nobody needs their databases then
    "full_page_writes": "off",
    "max_connections": "100",
    "shared_buffers": "32MB",
    "log_min_messages": "fatal",
    "autovacuum": "off",
}
LOCALE = ("--locale=C.UTF-8", "--locale-provider=icu", "--icu-locale=de-DE", "--encoding=UTF8")
"""Sorts text as a German would: what depends on the order of bytes shows."""


def find_binaries() -> Path | None:
    """Folder of initdb and postgres, the newest; None if there is none."""
    found = [path.parent for path in Path(BINARIES).glob("*/bin/initdb")]
    if found:
        return max(found, key=lambda path: float(path.parent.name))
    there = shutil.which("initdb")
    return Path(there).resolve().parent if there else None


class Cluster:
    """A server. folder : of its data and its socket; user : who runs it, None for whoever we are"""

    def __init__(self, binaries: Path, folder: Path) -> None:
        self._binaries = binaries
        self.folder = folder
        self._user = next((name for name in PEOPLE if _is_known(name)), None) if os.geteuid() == 0 else None
        self._process: subprocess.Popen[bytes] | None = None
        self._numbers = itertools.count(1)

    def make(self) -> None:
        """Make its data, start it, and make the database that others are copied from."""
        from cellctl.store.engine import migrate
        from cellctl.store.postgres import open_postgres

        if self._user is not None:
            shutil.chown(self.folder, self._user)
        words = [str(self._binaries / "initdb"), "-D", str(self.folder / "data"), "-U", OWNER, "-A", "trust", "--no-sync", *LOCALE]
        made = subprocess.run(words, user=self._user, group=self._group, cwd=self.folder, capture_output=True, text=True, check=False)
        if made.returncode:
            raise RuntimeError(f"initdb: {made.stderr.strip()}")
        self.start()
        with self._admin() as connection:
            connection.execute(f"CREATE DATABASE {TEMPLATE}")
        engine = open_postgres(self.url(TEMPLATE))
        try:
            migrate(engine, TEMPLATE)
        finally:
            engine.dispose()

    def start(self, *, port: int | None = None) -> None:
        """Start the server and wait until it answers. port : also listen there at 127.0.0.1"""
        from psycopg import OperationalError

        settings = {**SETTINGS, "unix_socket_directories": str(self.folder)}
        if port is not None:
            settings |= {"listen_addresses": "127.0.0.1", "port": str(port)}
        words = [str(self._binaries / "postgres"), "-D", str(self.folder / "data")]
        words += [word for name, value in settings.items() for word in ("-c", f"{name}={value}")]
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(
                words, user=self._user, group=self._group, cwd=self.folder, stdout=log, stderr=log, preexec_fn=_end_with_parent
            )
        end = time.monotonic() + START_S
        while True:
            try:
                self._admin().close()
            except OperationalError:
                if self._process.poll() is not None or time.monotonic() > end:
                    raise
                time.sleep(0.02)
            else:
                return

    def stop(self, sign: signal.Signals = signal.SIGINT) -> None:
        """Stop it; whoever is connected loses the connection. sign : SIGINT: in order; SIGQUIT: as by a power cut"""
        if self._process is not None:
            self._process.send_signal(sign)
            self._process.wait(START_S)
            self._process = None

    def url(self, database: str) -> URL:
        """Of a database."""
        from sqlalchemy import URL

        return URL.create("postgresql", username=OWNER, database=database, query={"host": str(self.folder)})

    def fresh(self, template: str = TEMPLATE) -> str:
        """A new database with the newest schema and no rows; its name. template : "template0": with no schema either"""
        name = f"store_{next(self._numbers)}"
        with self._admin() as connection:
            connection.execute(f"CREATE DATABASE {name} TEMPLATE {template}")
        return name

    def drop(self, database: str) -> None:
        """Remove a database; whoever is connected to it loses the connection."""
        with self._admin() as connection:
            connection.execute(f"DROP DATABASE IF EXISTS {database} WITH (FORCE)")

    def _admin(self) -> Any:
        from psycopg import connect

        return connect(host=str(self.folder), user=OWNER, dbname="postgres", autocommit=True)

    @property
    def _group(self) -> int | None:
        return None if self._user is None else pwd.getpwnam(self._user).pw_gid


def _is_known(name: str) -> bool:
    try:
        return pwd.getpwnam(name) is not None
    except KeyError:
        return False


def _end_with_parent() -> None:
    """The server goes when the tests go, however they end."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGQUIT), 0, 0, 0)


@contextmanager
def running_cluster() -> Iterator[Cluster]:
    """A server until left. Skips the test where PostgreSQL is not installed."""
    binaries = find_binaries()
    if binaries is None:
        pytest.skip("initdb of PostgreSQL is not installed")
    folder = Path(tempfile.mkdtemp(prefix="pg-", dir="/tmp"))  # a socket's path has 107 bytes, and the server's user has to get there
    cluster = Cluster(binaries, folder)
    try:
        cluster.make()
        yield cluster
    finally:
        cluster.stop(signal.SIGQUIT)
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="session")
def postgres() -> Iterator[Cluster]:
    """The session's server; a test that stops it starts it again."""
    with running_cluster() as cluster:
        yield cluster


@pytest.fixture
def database(postgres: Cluster) -> Iterator[URL]:
    """A database of the test's own, with the newest schema and no rows."""
    name = postgres.fresh()
    yield postgres.url(name)
    postgres.drop(name)
