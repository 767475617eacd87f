"""Work that is done to its end although its caller is cancelled meanwhile: what holds a process or a pipe has to let go of it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable
from typing import TypeVar

T = TypeVar("T")


async def to_its_end(work: Awaitable[T]) -> T:
    """Await `work` whole. Cancelled meanwhile, however often, raises CancelledError once the work is done."""
    task = asyncio.ensure_future(work)
    is_cancelled = False
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError:
            is_cancelled = True
    if is_cancelled:
        if not task.cancelled():
            task.exception()  # seen: the cancellation is what is told
        raise asyncio.CancelledError
    return task.result()


async def kill(process: asyncio.subprocess.Process) -> None:
    """Kill a process and read its pipes to their end: a process that was only waited for leaves them open."""
    if process.returncode is None:
        process.kill()
    await process.communicate()
