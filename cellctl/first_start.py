"""What a store needs before others come: a first token, and an admin before anybody beyond this machine can reach the service."""

from __future__ import annotations

import os
from pathlib import Path

from cellctl.api.security import is_loopback
from cellctl.store import open_store, tokens, users
from cellctl.store.tokens import Role

TOKEN_FILE = "operator.token"


class ServeError(Exception):
    """The service cannot start. `message` is one line, `hint` says what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def first_token(folder: Path) -> str | None:
    """On the first start: an operator token, also kept for this user in a file of mode 0600. None if there are tokens."""
    store = open_store(folder)
    try:
        with store.write() as rows:
            if tokens.every(rows):
                return None
            _, secret = tokens.create(rows, "operator", Role.OPERATOR, store.clock())
        handle = os.open(folder / TOKEN_FILE, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(handle, "w") as file:
            file.write(secret + "\n")
        return secret
    finally:
        store.close()


def has_admin(folder: Path) -> bool:
    """Whether an admin can sign in, by password or token."""
    store = open_store(folder)
    try:
        with store.read() as rows:
            return users.count_active(rows, Role.ADMIN) > 0 or tokens.count_valid(rows, store.clock(), Role.ADMIN) > 0
    finally:
        store.close()


def check_reach(folder: Path, host: str) -> None:
    """Raises ServeError for a host beyond this machine while nobody is admin."""
    if not is_loopback(host) and not has_admin(folder):
        raise ServeError(
            f"{host} can be reached from other machines and there is no admin yet",
            "first run `cellctl user add NAME --role admin`",
        )
