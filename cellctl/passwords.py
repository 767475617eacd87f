"""Passwords: argon2id by OWASP's parameters, and what a password must be. Hashing takes a tenth of a second: call it in a thread."""

from __future__ import annotations

import secrets
from functools import cache

from argon2 import PasswordHasher
from argon2.exceptions import Argon2Error, InvalidHashError

SHORTEST, LONGEST = 10, 200
MEMORY_KIB = 47_104  # OWASP Password Storage Cheat Sheet: m = 46 MiB, t = 1, p = 1 is the least; one pass more
HASHER = PasswordHasher(time_cost=2, memory_cost=MEMORY_KIB, parallelism=1)


class PasswordError(Exception):
    """A password that will not do. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def check(password: str, name: str) -> None:
    """Raises PasswordError for one that is easily guessed. Length counts, kinds of characters do not (NIST SP 800-63B 5.1.1.2)."""
    hint = "a sentence of a few words is easy to keep in mind"
    if len(password) < SHORTEST:
        raise PasswordError(f"a password has at least {SHORTEST} characters, this one has {len(password)}", hint)
    if len(password) > LONGEST:
        raise PasswordError(f"a password has at most {LONGEST} characters", hint)
    if len(set(password)) < 4 or (name.lower() in password.lower() and len(password) < len(name) + SHORTEST):
        raise PasswordError("this password is easily guessed", hint)


def hashed(password: str) -> str:
    """What is kept of a password."""
    return HASHER.hash(password.encode("utf-8", "replace"))


def verified(password_hash: str | None, password: str) -> bool:
    """Whether this is the password. It takes as long without a hash, so that nobody learns which names there are."""
    against = _nobody() if password_hash is None else password_hash
    try:
        return HASHER.verify(against, password.encode("utf-8", "replace")) and password_hash is not None
    except (Argon2Error, InvalidHashError):
        return False


def is_outdated(password_hash: str) -> bool:
    """Whether it was made by other parameters than those of today."""
    try:
        return HASHER.check_needs_rehash(password_hash)
    except InvalidHashError:
        return True


@cache
def _nobody() -> str:
    """A hash that no password fits, for names that are not there."""
    return HASHER.hash(secrets.token_bytes(32))


def make_ready() -> None:
    """Make now what the first unknown name would wait for."""
    _nobody()
