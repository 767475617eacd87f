"""The name by which a store folder's service is known to the fleet, and the lock that keeps a second one from serving a cell from it."""

from __future__ import annotations

import fcntl
import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cellctl.store.engine import StoreError

OWNER_FILE = "owner"
TAKE_OVER_S = 10.0  # a web process whose supervisor was killed ends within it
POLL_S = 0.1


def owner_of(folder: Path) -> str:
    """The random name of this store folder, made at its first use; a service that is started again has the same. Raises StoreError."""
    path = folder / OWNER_FILE
    try:
        if not path.exists():
            part = path.with_suffix(f".{os.getpid()}.part")
            part.write_text(f"{secrets.token_hex(16)}\n", encoding="ascii")
            part.replace(path)
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise StoreError(f"{path}: cannot be used: {error}", "make the store's folder writable for the service") from None


@contextmanager
def only_server(folder: Path, cell: str) -> Iterator[None]:
    """Hold the cell, as served from this store folder, until the block is left or the process dies. Raises StoreError if another has it."""
    name = "".join(sign if sign.isalnum() or sign in "-_" else "_" for sign in cell)[:100]
    with (folder / f"serving-{name}.lock").open("w") as lock:
        end = time.monotonic() + TAKE_OVER_S
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                if time.monotonic() > end:
                    raise StoreError(
                        f"{folder}: another service runs the cell {cell} from this store", "stop it, or name another --store and another cell"
                    ) from None
                time.sleep(POLL_S)
        yield
