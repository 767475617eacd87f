"""What it means that the disk or the store refuses: locked, full, read-only, gone; in the operator's words, with what to do.

Looked up by words and numbers of SQLite, PostgreSQL and the file system; none of them is imported for it.
"""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass

BUSY, NO_ROOM = 503, 507  # HTTP statuses


@dataclass(frozen=True)
class Trouble:
    """A disk or store that refuses. status : of HTTP"""

    title: str
    detail: str
    hint: str
    status: int = BUSY


ROOM = "make room on the disk, then ask again: what was accepted before is kept"
BY_WORDS: dict[str, tuple[str, str, int]] = {
    "locked": ("The store is locked", "another program holds it: close a backup or a database tool that has it open, then ask again", BUSY),
    "disk is full": ("The disk is full", ROOM, NO_ROOM),
    "readonly": ("The store is read-only", "make its folder and its file writable for the service, then ask again", BUSY),
    "unable to open": ("The store is gone", "put its folder back where it was, or name it with --store, then start the service again", BUSY),
    "no such table": ("The store is gone", "put its folder back where it was, or restore a backup, then start the service again", BUSY),
    "malformed": ("The store is damaged", "stop the service and restore a backup", BUSY),
    "not a database": ("The store is damaged", "stop the service and restore a backup", BUSY),
    "disk i/o error": ("The disk fails", "look at the disk and its cable, make room on it, then ask again", BUSY),
}
"""Words of SQLite's message -> title, hint, status. Source: sqlite.org/rescode.html."""
LOCAL = "the cell goes on with its job, and nothing new starts until then"
GONE = ("The shared database is gone", f"see that PostgreSQL runs and that this host reaches it; {LOCAL}", BUSY)
BY_STATE: dict[str, tuple[str, str, int]] = {
    "08": GONE,
    "57P": ("The shared database is stopped", f"start PostgreSQL again, or wait until it is up; {LOCAL}", BUSY),
    "53100": ("The disk of the shared database is full", "make room on PostgreSQL's disk, then ask again: what was accepted before is kept", NO_ROOM),
    "53": ("The shared database is overloaded", "ask again in a moment; raise max_connections if it stays", BUSY),
    "55P03": ("The store is locked", "another host writes for long: ask again in a moment; look at pg_stat_activity if it stays", BUSY),
    "25P03": ("The store was given up", "this host said nothing for too long while others waited: ask again", BUSY),
    "25006": ("The shared database is read-only", "name the server that takes writes in shared.toml, not its copy", BUSY),
    "28": ("The shared database lets nobody in", "set the password in ~/.pgpass or shared.toml, and look at the server's pg_hba.conf", BUSY),
    "3D000": ("There is no such shared database", "make it with createdb, or name another one in shared.toml", BUSY),
    "42501": ("The shared database permits too little", "let the database belong to the user that shared.toml names", BUSY),
    "42P01": ("The shared database has no tables", "restore its dump, or start a service anew: it makes them", BUSY),
    "58": ("The disk of the shared database fails", "look at the disk of PostgreSQL's host, then ask again", BUSY),
    "XX": ("The shared database is damaged", "stop the services and restore its dump", BUSY),
}
"""SQLSTATE, or how it begins -> title, hint, status. Source: PostgreSQL 15 documentation, appendix A."""
BUSY_POOL = ("The store is busy", "too many questions at once: ask again in a moment", BUSY)
BY_ERRNO: dict[int, tuple[str, str, int]] = {
    errno.ENOSPC: ("The disk is full", ROOM, NO_ROOM),
    errno.EDQUOT: ("The disk quota is used up", ROOM, NO_ROOM),
    errno.EFBIG: ("The file is larger than the disk allows", ROOM, NO_ROOM),
    errno.EROFS: ("The disk is read-only", "mount it so that the service can write, then ask again", BUSY),
    errno.EIO: ("The disk fails", "look at the disk and its cable, then ask again", BUSY),
    errno.EMFILE: ("Too many files are open", "ask again in a moment; raise the limit of open files if it stays", BUSY),
}


def of_server(error: BaseException) -> Trouble | None:
    """What PostgreSQL's own error means, or that of its driver; None for one that is not of the server's state."""
    state = getattr(error, "sqlstate", None)
    said = " ".join(str(error).split())
    if state is None:  # the driver's own: nothing came back
        is_lost = any(cls.__name__ in ("OperationalError", "InterfaceError") for cls in type(error).__mro__)
        found = GONE if is_lost else None
    else:
        found = next((BY_STATE[state[:size]] for size in (5, 3, 2) if state[:size] in BY_STATE), None)
    return Trouble(found[0], f"the shared database refuses: {said}", found[1], found[2]) if found is not None else None


def of_database(error: BaseException) -> Trouble | None:
    """What the words of a database's own error mean; None for one that is not of the disk. Accepts SQLAlchemy's wrapping too."""
    inner = getattr(error, "orig", None) or error
    if type(inner).__module__.partition(".")[0] == "psycopg":
        return of_server(inner)
    said = str(inner)
    if "queuepool limit" in said.lower():
        return Trouble(BUSY_POOL[0], f"the store refuses: {said}", BUSY_POOL[1], BUSY_POOL[2])
    found = next((row for words, row in BY_WORDS.items() if words in said.lower()), None)
    return Trouble(found[0], f"the store refuses: {said}", found[1], found[2]) if found is not None else None


def of_file(error: BaseException) -> Trouble | None:
    """What an error of the file system means, or one that it caused; None for one that is not of the disk."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, OSError):
            number = seen.errno if seen.errno in BY_ERRNO else next((code for code in BY_ERRNO if os.strerror(code) in str(seen)), None)
            if number is not None:
                title, hint, status = BY_ERRNO[number]
                return Trouble(title, f"a file cannot be written: {os.strerror(number)}", hint, status)
        seen = seen.__cause__ or seen.__context__
    return None


def trouble_of(error: BaseException) -> Trouble | None:
    """Of any error; None for one that has nothing to do with disk or store."""
    if any(cls.__module__.partition(".")[0] in ("sqlite3", "sqlalchemy", "psycopg") for cls in type(error).__mro__):
        return of_database(error)
    return of_file(error)
