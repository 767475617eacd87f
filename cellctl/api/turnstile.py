"""Passwords are looked at two at a time, beside everything else: hashing takes memory and a core for a tenth of a second."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from cellctl import passwords
from cellctl.api.problems import ApiError

AT_ONCE = 2
WAITING_MAX = 20
Result = TypeVar("Result")


class Turnstile:
    """Threads of its own, so that a flood of sign-ins keeps no other work waiting."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(AT_ONCE, "password")
        self._inside = 0

    def warm(self) -> None:
        """Make ready what the first one would wait for."""
        self._threads.submit(passwords.make_ready)

    async def pass_through(self, work: Callable[[], Result]) -> Result:
        """The work's result, in its turn. Raises ApiError 503 if too many wait already."""
        if self._inside >= WAITING_MAX:
            raise ApiError(503, "Busy", "too many people sign in at this moment", "try again in a few seconds", {"Retry-After": "3"})
        self._inside += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._threads, work)
        finally:
            self._inside -= 1

    def close(self) -> None:
        """End the threads."""
        self._threads.shutdown(wait=True, cancel_futures=True)
