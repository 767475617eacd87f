"""Who was let in lately: while a shared database is away they go on commanding their cell. Nobody new is let in then.

What an admin takes from somebody meanwhile counts here once the database is back. Nothing of this is used where nothing is shared.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict

from cellctl.store import tokens
from cellctl.store.sessions import IDLE_S, Account

MOST = 1000  # accounts remembered, those that were heard last
AGAIN_S = 5.0  # a database that is away is asked again so often: nobody's command waits for it in between
ASKED_S = 1.0  # a command of somebody who is known waits no longer than this for it


class Acquaintance:
    """Accounts by the SHA-256 of their secrets. Asked from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen: OrderedDict[str, tuple[Account, float]] = OrderedDict()
        self._away_until = float("-inf")

    @property
    def is_away(self) -> bool:
        """Whether the database was found to be away just now."""
        return time.monotonic() < self._away_until

    def went_away(self) -> None:
        """The database does not answer."""
        self._away_until = time.monotonic() + AGAIN_S

    def told(self, secret: str, account: Account | None, at: float) -> None:
        """What the database said of a secret. at : Unix time, s"""
        key = tokens.digest(secret)
        with self._lock:
            self._seen.pop(key, None)
            if account is not None:
                self._seen[key] = (account, at)
                if len(self._seen) > MOST:
                    self._seen.popitem(last=False)

    def recall(self, secret: str, at: float) -> Account | None:
        """Who this is, if the database said so no longer ago than a session may be idle. at : Unix time, s"""
        with self._lock:
            account, told_at = self._seen.get(tokens.digest(secret), (None, 0.0))
        return account if at - told_at <= IDLE_S else None
