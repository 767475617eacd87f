"""The stop listener behind TLS, in a thread of its own: handshakes take milliseconds each, which the tick must not wait for."""

from __future__ import annotations

import asyncio
import ssl
import threading
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from cellctl.cell.stop_listener import Stop, StopListener

JOIN_S = 5.0
Result = TypeVar("Result")


class StopThread:
    """As StopListener. stop is carried out in the loop that called `start`; begin : told in the thread before it listens"""

    def __init__(self, stop: Stop, state: Callable[[], str], host: str, tls: ssl.SSLContext, begin: Callable[[], None]) -> None:
        self._stop = stop
        self._begin = begin
        self._listener = StopListener(self._stop_at_home, state, host, tls)
        self._home: asyncio.AbstractEventLoop | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="stop", daemon=True)

    def allow_pages(self, hosts: frozenset[str]) -> None:
        """As StopListener's."""
        self._listener.allow_pages(hosts)

    async def start(self, port: int) -> int:
        """Listen; the port that was taken. Raises OSError."""
        self._home = asyncio.get_running_loop()
        self._thread.start()
        return await self._in_thread(self._listener.start(port))

    async def close(self) -> None:
        """Stop listening and end the thread. Harmless twice."""
        if not self._thread.is_alive():
            return
        await self._in_thread(self._listener.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        self._begin()
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()
        left = asyncio.all_tasks(self._loop)
        for task in left:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        self._loop.close()

    async def _in_thread(self, work: Coroutine[Any, Any, Result]) -> Result:
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(work, self._loop))

    async def _stop_at_home(self, ident: str, who: str, because: str) -> str:
        assert self._home is not None  # set before the thread runs
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(_carried_out(self._stop, ident, who, because), self._home))


async def _carried_out(stop: Stop, ident: str, who: str, because: str) -> str:
    return await stop(ident, who, because)
