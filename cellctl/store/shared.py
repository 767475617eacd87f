"""What several cells share, and where: `shared.toml` in the store's folder names a PostgreSQL database and a folder of files.

Without that file nothing is shared and all lies in the store's folder. With it, the folder keeps what the cell process writes, the key
that seals records, and what can be made anew.
"""

from __future__ import annotations

import os
import secrets
import tomllib
from dataclasses import dataclass
from pathlib import Path

import tomli_w
from sqlalchemy import URL, func, inspect, make_url, select
from sqlalchemy.exc import ArgumentError, DatabaseError

from cellctl.store.errors import StoreError
from cellctl.store.schema import metadata
from cellctl.store.sides import OWN
from cellctl.store.sqlite import DATABASE, open_engine

FILE = "shared.toml"
HOW = "as in postgresql://cells@db.shop/cells, with the password in ~/.pgpass, in PGPASSFILE or in a file named as @FILE"


@dataclass(frozen=True)
class Shared:
    """Where it lies. database : of PostgreSQL; files : folder that all hosts see; host : a random word of this host's, for unfinished files"""

    database: URL
    files: Path
    host: str


@dataclass(frozen=True)
class Wanted:
    """What a command line names. database : a URL, or @FILE; files : a folder"""

    database: str
    files: Path


def url_of(text: str) -> URL:
    """A database by its URL. Raises StoreError; the message holds no password."""
    try:
        url = make_url(text.strip())
    except (ArgumentError, ValueError):
        raise StoreError("the shared database is no URL", HOW) from None
    if url.drivername != "postgresql":
        raise StoreError(f"the shared database is of {url.drivername[:40]!r}: only PostgreSQL is shared", HOW)
    if not url.database:
        raise StoreError(f"{url.render_as_string()}: names no database", HOW)
    if "options" in url.query:
        raise StoreError("the URL of the shared database has options for the server", "leave `options` out: the service sets what it needs")
    return url


def told_url(word: str) -> URL:
    """What a command line says: a URL without its password, or @FILE with the whole of it. Raises StoreError."""
    if word.startswith("@"):
        try:
            return url_of(Path(word[1:]).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise StoreError(f"{word[1:]}: cannot be read: {getattr(error, 'strerror', None) or error}", HOW) from None
    url = url_of(word)
    if url.password is not None:
        raise StoreError("the password of the shared database would be seen by everybody on this machine", HOW)
    return url


def shared_of(folder: Path) -> Shared | None:
    """What the store in a folder shares, None if nothing. Raises StoreError."""
    path = folder / FILE
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise StoreError(f"{path}: cannot be read: {error}", "make it anew: remove it, and serve with --shared-database") from None
    told = {name: document.get(name) for name in ("database", "files", "host")}
    missing = [name for name, value in told.items() if not isinstance(value, str) or not value]
    if missing:
        raise StoreError(f"{path}: has no {missing[0]}", "make it anew: remove it, and serve with --shared-database and --shared-files")
    return Shared(url_of(str(told["database"])), Path(str(told["files"])), str(told["host"]))


def share(folder: Path, named: Wanted) -> None:
    """Let the store in a folder share from now on; the same again is harmless.

    Raises StoreError where it shares something else, or holds what only this host would see.
    """
    database, files = told_url(named.database), named.files
    known = shared_of(folder)
    wanted = Shared(database, files.absolute(), known.host if known is not None else secrets.token_hex(6))
    if known is not None:
        if (known.database, known.files) != (wanted.database, wanted.files):
            raise StoreError(
                f"{folder}: shares {known.database.render_as_string()} and {known.files} already, not what is named",
                f"leave --shared-database and --shared-files out; to move, stop the service and remove {folder / FILE}",
            )
        return
    _check_empty(folder)
    document = {"database": database.render_as_string(hide_password=False), "files": str(wanted.files), "host": wanted.host}
    path, part = folder / FILE, folder / f".{FILE}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            file.write(tomli_w.dumps(document))
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror}", "name a folder that can be written with --store") from None


def _check_empty(folder: Path) -> None:
    """Raises StoreError for a store that has been worked with: its jobs and people would be there no more."""
    path = folder / DATABASE
    if not path.is_file():
        return
    engine = open_engine(path)
    try:
        with engine.connect() as rows:
            names = sorted(set(inspect(rows).get_table_names()) & set(metadata.tables) - OWN)
            held = {name: rows.execute(select(func.count()).select_from(metadata.tables[name])).scalar_one() for name in names}
    except DatabaseError as error:
        raise StoreError(f"{path}: {error.orig}", "name a fresh folder with --store") from None
    finally:
        engine.dispose()
    found = [f"{name}: {count}" for name, count in held.items() if count]
    if found:
        line = f"{folder}: is a store of its own already (rows of {', '.join(found)})"
        raise StoreError(line, "name a fresh folder with --store for a cell that shares")
