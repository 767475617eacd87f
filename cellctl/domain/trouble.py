"""What it means that the disk or the store refuses: locked, full, read-only, gone; in the operator's words, with what to do."""

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
BY_ERRNO: dict[int, tuple[str, str, int]] = {
    errno.ENOSPC: ("The disk is full", ROOM, NO_ROOM),
    errno.EDQUOT: ("The disk quota is used up", ROOM, NO_ROOM),
    errno.EFBIG: ("The file is larger than the disk allows", ROOM, NO_ROOM),
    errno.EROFS: ("The disk is read-only", "mount it so that the service can write, then ask again", BUSY),
    errno.EIO: ("The disk fails", "look at the disk and its cable, then ask again", BUSY),
    errno.EMFILE: ("Too many files are open", "ask again in a moment; raise the limit of open files if it stays", BUSY),
}


def of_database(error: BaseException) -> Trouble | None:
    """What the words of SQLite's own error mean; None for one that is not of the disk. Accepts SQLAlchemy's wrapping too."""
    said = str(getattr(error, "orig", None) or error)
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
    if any(cls.__module__ in ("sqlite3", "sqlalchemy.exc") for cls in type(error).__mro__):
        return of_database(error)
    return of_file(error)
