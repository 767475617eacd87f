"""The real clock: the only place where drivers meet the wall."""

from __future__ import annotations

import asyncio
import time


class SystemClock:
    """Clock on CLOCK_MONOTONIC and the running event loop."""

    now = staticmethod(time.monotonic)
    """Seconds on the monotonic clock."""

    async def sleep(self, seconds: float) -> None:
        """Let other tasks run for `seconds`."""
        await asyncio.sleep(seconds)
