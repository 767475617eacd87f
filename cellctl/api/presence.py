"""When each session was last heard: kept here, and written down now and then, so that a request costs no write."""

from __future__ import annotations

import asyncio

import structlog
from sqlalchemy.exc import DBAPIError

from cellctl.store import Store, sessions, tokens

WRITE_S = 30.0  # what a restart may forget; far below the idle limit
log = structlog.get_logger(__name__)


class Presence:
    """Call `run` as one task."""

    def __init__(self) -> None:
        self._heard: dict[str, float] = {}

    def heard(self, sha256: str, at: float) -> None:
        """A session, by its SHA-256, was heard."""
        self._heard[sha256] = at

    def heard_at(self, secret: str) -> float | None:
        """When the session of this secret was last heard, None if that is written down or nothing was."""
        return self._heard.get(tokens.digest(secret))

    async def run(self, store: Store) -> None:
        """Write down what was heard, for ever."""
        while True:
            await asyncio.sleep(WRITE_S)
            await self._write(store)

    async def _write(self, store: Store) -> None:
        taken, self._heard = self._heard, {}

        def write() -> None:
            with store.write() as rows:
                sessions.heard(rows, taken)

        try:
            if taken:
                await asyncio.to_thread(write)
        except (DBAPIError, OSError) as error:  # a store that refuses: what was heard meanwhile is newer
            self._heard = {**taken, **self._heard}
            log.warning("sessions cannot be written down", error=str(getattr(error, "orig", error)))
