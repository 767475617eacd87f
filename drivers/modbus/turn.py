"""Whose request goes next on a Modbus line: what was set goes before what is read, and the line is kept free for a write that is due."""

from __future__ import annotations

import asyncio
from typing import Protocol

from drivers.interfaces import Clock

GUARD_S = 0.001  # between the end of a read that may still begin and the write that is due
LATE_S = 0.02  # a write that was told to come and is this late holds the line no longer
HELD_MAX_S = 0.15  # a line is kept free no longer than this at a time: readings must not grow stale for it


class Talker(Protocol):
    """A device on the line, as its turn sees it."""

    wake: asyncio.Event

    async def flush(self) -> None:
        """Write what was set; nothing else."""


class Turn:
    """The order of requests on one line. A device that shares its line with none has a turn of its own."""

    def __init__(self, clock: Clock) -> None:
        self.wake = asyncio.Event()  # set when anything was set on any device of the line
        self._clock = clock
        self._talkers: list[Talker] = []
        self._due: dict[int, float] = {}

    def join(self, talker: Talker) -> None:
        """This device is on the line. Harmless twice."""
        if talker not in self._talkers:
            self._talkers.append(talker)

    def expect(self, talker: Talker, at: float | None) -> None:
        """A write of this device is due at wire time `at` (s); None: none is known."""
        if at is None:
            self._due.pop(id(talker), None)
        else:
            self._due[id(talker)] = at

    async def let_others_write(self, talker: Talker) -> None:
        """What was set on the other devices of the line goes first."""
        for other in self._talkers:
            if other is not talker and other.wake.is_set():
                await other.flush()

    async def before_read(self, talker: Talker, takes_s: float) -> None:
        """Return when a read that takes `takes_s` neither holds up what was set nor what is due on any device of the line.

        What `talker` itself wants written is for itself to look after: its `wake` is set then.
        """
        began = self._clock.now()
        while True:
            await self.let_others_write(talker)
            now = self._clock.now()
            left = self._kept_free_s(now, takes_s)
            if talker.wake.is_set() or left <= 0.0 or now - began >= HELD_MAX_S:
                return
            await self.pause(left)

    def _kept_free_s(self, now: float, takes_s: float) -> float:
        """How long a read that takes `takes_s` has to wait for what is due (s); 0 when it may go."""
        waits = [at + LATE_S - now for at in self._due.values() if at - now < takes_s + GUARD_S and now - at < LATE_S]
        return max(waits, default=0.0)

    async def pause(self, seconds: float) -> None:
        """Return after `seconds`, or as soon as anything is set on the line."""
        self.wake.clear()
        if any(talker.wake.is_set() for talker in self._talkers):
            return
        loop = asyncio.get_running_loop()
        tasks = [loop.create_task(self._clock.sleep(seconds)), loop.create_task(_woken(self.wake))]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


async def _woken(event: asyncio.Event) -> None:
    await event.wait()
