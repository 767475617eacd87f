"""Takes new samples into the thinned levels of the trends: a little at a time, in a thread, for as long as the service runs."""

from __future__ import annotations

import asyncio

import structlog
from sqlalchemy.exc import DBAPIError

from cellctl.domain.trouble import trouble_of
from cellctl.store import Store, trend_levels

PERIOD_S = 10.0  # between two looks; what is newer is read from the samples
BETWEEN_S = 0.2  # while many samples wait: others work with the store too
FORGET_S = 600.0
log = structlog.get_logger(__name__)


class TrendKeeper:
    """Call `run` as one task."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._upto: int | None = None
        self._forgot_at = float("-inf")

    async def run(self) -> None:
        """Look, take, wait, for ever; a store that refuses is asked again."""
        while True:
            taken = 0
            try:
                taken = await asyncio.to_thread(self.step)
            except (DBAPIError, OSError) as error:
                if trouble_of(error) is None:
                    log.exception("trends are not thinned")
                self._upto = None
            await asyncio.sleep(PERIOD_S if taken < trend_levels.BATCH_ROWS else BETWEEN_S)

    def step(self) -> int:
        """Take one batch; how many samples it had."""
        if self._upto is None:
            with self._store.read_cell() as rows:
                self._upto = trend_levels.upto(rows)
        if not self._is_news():
            return 0
        with self._store.write_cell() as rows:
            upto, taken = trend_levels.advance(rows, self._upto)
            now = self._store.clock()
            if now - self._forgot_at > FORGET_S:
                trend_levels.forget(rows, now)
                self._forgot_at = now
        self._upto = upto
        return taken

    def _is_news(self) -> bool:
        with self._store.read_cell() as rows:
            return trend_levels.newest(rows) > (self._upto or 0)
