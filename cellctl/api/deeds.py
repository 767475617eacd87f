"""The audit trail of commands: a row for each, that a store which is locked or full puts off but does not lose, and that no answer waits long for."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

import structlog
from sqlalchemy.exc import DBAPIError

from cellctl.domain.trouble import trouble_of
from cellctl.store import Store, audit
from cellctl.store.audit import Deed

WAITED_FOR_S = 0.3  # the command itself is in the cell's own journal before it is answered: this row says it once more
AGAIN_S = 1.0  # between two tries of a store that refuses
log = structlog.get_logger(__name__)


class Deeds:
    """Writes deeds in the background, each until the store takes it."""

    def __init__(self) -> None:
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def waiting(self) -> int:
        """How many are not written down yet."""
        return len(self._tasks)

    async def note(self, store: Store, deed: Deed, outcome: str) -> None:
        """Write it down; returns after WAITED_FOR_S if that takes longer, and goes on with it."""
        at = store.clock()

        def write() -> None:
            with store.write() as rows:
                audit.add(rows, deed, at, outcome)

        task = asyncio.create_task(_until_taken(write, f"{deed.who}: {deed.verb} {deed.target}, {outcome}"))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        with suppress(TimeoutError):
            async with asyncio.timeout(WAITED_FOR_S):
                await asyncio.shield(task)

    async def close(self) -> None:
        """Give up what the store does not take; each is in the log."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)


async def _until_taken(write: Callable[[], None], line: str) -> None:
    said = False
    while True:
        try:
            await asyncio.to_thread(write)
            return
        except (DBAPIError, OSError) as error:
            if trouble_of(error) is None:
                log.exception("a deed cannot be written down", deed=line)
                return
            if not said:
                log.error("a deed waits to be written down", deed=line, error=str(getattr(error, "orig", error)))
            said = True
        await asyncio.sleep(AGAIN_S)
