"""Failed sign-ins, counted by account and by address and kept over a restart: after a few, each further one is waited for longer."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from sqlalchemy import Connection, delete, insert, select, update

from cellctl.store.schema import sign_in_tries

FORGOTTEN_S = 24 * 3600.0  # a count that nothing was added to for so long
KNOWN_S = 30 * 86_400.0  # an address from which an account was signed in to


@dataclass(frozen=True)
class Limit:
    """free : failures that cost nothing; then a wait of 1 s that doubles with each, up to longest_s"""

    free: int
    longest_s: float

    def wait_s(self, failures: int) -> float:
        """Until the next try is looked at."""
        over = failures - self.free
        return 0.0 if over < 0 else min(2.0 ** min(over, 30), self.longest_s)


# An account waits at most a minute, so that nobody keeps its owner out for long; an address may be many people's behind one router.
ACCOUNT, PLACE, ADDRESS = Limit(10, 60.0), Limit(4, 900.0), Limit(30, 900.0)


@dataclass(frozen=True)
class Try:
    """One sign-in. account : name of a user, or "" for a token; address : where it comes from"""

    account: str
    address: str

    @property
    def place(self) -> str:
        """The account at this address."""
        return _key("place", f"{self.account}@{self.address}")

    @property
    def known(self) -> str:
        """Under which it is kept that the account was signed in to from here."""
        return _key("known", f"{self.account}@{self.address}")

    def counts(self) -> dict[str, Limit]:
        """What a failure is counted under."""
        counted = {_key("address", self.address): ADDRESS}
        if self.account:
            counted |= {_key("account", self.account): ACCOUNT, self.place: PLACE}
        return counted


def _key(kind: str, name: str) -> str:
    return f"{kind}:{hashlib.sha256(name.encode('utf-8', 'replace')).hexdigest()[:40]}"  # of one length, whatever was typed


def begin(connection: Connection, one: Try, at: float) -> float:
    """How long this try has to wait, s. If that is 0 it may be looked at, and counts as failed until `succeeded` is told.

    Counted before it is looked at, so that many at once are as many. Where the account was signed in to before, only
    failures from there count: a stranger elsewhere cannot keep its owner out.
    """
    keys = set(one.counts())
    if _is_known(connection, one, at):
        keys.discard(_key("account", one.account))
    query = select(sign_in_tries.c.free_at).where(sign_in_tries.c.key.in_(keys))
    wait_s = max((float(free_at) - at for (free_at,) in connection.execute(query)), default=0.0)
    if wait_s > 0:
        return wait_s
    _count(connection, one, at)
    return 0.0


def _is_known(connection: Connection, one: Try, at: float) -> bool:
    query = select(sign_in_tries.c.last_at).where(sign_in_tries.c.key == one.known)
    seen = connection.execute(query).scalar()
    return seen is not None and seen > at - KNOWN_S


def _count(connection: Connection, one: Try, at: float) -> None:
    connection.execute(delete(sign_in_tries).where(sign_in_tries.c.last_at < at - KNOWN_S))
    for key, limit in one.counts().items():
        row = connection.execute(select(sign_in_tries).where(sign_in_tries.c.key == key)).mappings().first()
        is_fresh = row is not None and row["last_at"] > at - FORGOTTEN_S
        failures = (int(row["failures"]) if row is not None and is_fresh else 0) + 1
        _put(connection, key, failures, at, at + limit.wait_s(failures))


def succeeded(connection: Connection, one: Try, at: float) -> None:
    """Take the count of this try back, forget those of the account here, and keep that it was signed in to from here."""
    for key in one.counts():
        lowered = {"failures": sign_in_tries.c.failures - 1, "free_at": at}
        connection.execute(update(sign_in_tries).where(sign_in_tries.c.key == key, sign_in_tries.c.failures > 0).values(**lowered))
    if one.account:
        connection.execute(delete(sign_in_tries).where(sign_in_tries.c.key == one.place))
        _put(connection, one.known, 0, at, at)


def _put(connection: Connection, key: str, failures: int, at: float, free_at: float) -> None:
    values = {"failures": failures, "last_at": at, "free_at": free_at}
    if not connection.execute(update(sign_in_tries).where(sign_in_tries.c.key == key).values(**values)).rowcount:
        connection.execute(insert(sign_in_tries).values(key=key, **values))
