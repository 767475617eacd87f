"""A scheduler of one's own for a planning pool: dask's, with TLS where others can reach it, and without its web pages."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from urllib.parse import urlsplit

from cellctl.planning.pool.wire import PORT, PoolError, PoolWire


async def serve(wire: PoolWire, stop: asyncio.Event, ready: Callable[[str], None]) -> None:
    """Schedule at the wire's address until told to stop. ready : told the address. Raises PoolError if it cannot listen there."""
    from distributed import Scheduler

    parts = urlsplit(wire.address)
    try:
        scheduler = await Scheduler(
            host=parts.hostname,
            port=parts.port or PORT,
            protocol=parts.scheme,
            security=wire.security(),
            dashboard=False,
            dashboard_address="127.0.0.1:0",  # its health page, for this machine alone
        )
    except (OSError, RuntimeError) as error:
        told = (error.__cause__ or error).args[-1]
        raise PoolError(f"cannot listen at {wire.address}: {told}", "name another address or port") from None
    try:
        ready(scheduler.address)
        await stop.wait()
    finally:
        await scheduler.close(reason="told to end")
