"""Whose request goes next on a Modbus line: what was set goes before what is read, and the line is kept free for a write that is due."""

from __future__ import annotations

import asyncio
from typing import Protocol

from drivers.interfaces import Clock

GUARD_S = 0.001  # between the end of a read that may still begin and the write that is due
LATE_S = 0.02  # a write that was told to come and is this late holds the line no longer
SENSES_APART = 4.0  # times what a reading takes: nearer to its stale limit it is not put off for contacts of another device
HELD_MAX_S = 0.15  # a line is kept free no longer than this at a time: readings must not grow stale for it


class Talker(Protocol):
    """A device on the line, as its turn sees it."""

    wake: asyncio.Event

    @property
    def is_sense_due(self) -> bool:
        """Whether its contacts are to be read before anything else is."""

    @property
    def is_beat_due(self) -> bool:
        """Whether its heartbeat goes before anybody's next reading."""

    @property
    def beats_by(self) -> float:
        """Wire time (s) by which its next heartbeat has to go."""

    async def flush(self) -> None:
        """Write what was set, and a heartbeat that is due; nothing else."""

    async def sense(self) -> None:
        """Read the contacts; nothing else."""


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

    @property
    def is_shared(self) -> bool:
        """Whether several devices are on the line."""
        return len(self._talkers) > 1

    def expect(self, talker: object, at: float | None) -> None:
        """A write of this device is due at wire time `at` (s); None: none is known."""
        if at is None:
            self._due.pop(id(talker), None)
        else:
            self._due[id(talker)] = at

    async def let_others_write(self, talker: Talker) -> None:
        """What was set on the other devices of the line goes first, and their heartbeats that are due."""
        for other in self._talkers:
            if other is not talker and (other.wake.is_set() or other.is_beat_due):
                await other.flush()

    async def let_others_sense(self, talker: Talker) -> None:
        """Contacts that are due on another device of the line are read first: safety does not wait for a whole round."""
        for other in self._talkers:
            if other is not talker and other.is_sense_due:
                await other.sense()
                await self.let_others_write(talker)

    async def before_read(self, talker: Talker, takes_s: float, patience_s: float) -> None:
        """Return when a read that takes `takes_s` neither holds up what was set nor what is due on any device of the line.

        patience_s : a read that would have to wait longer than that goes at once, whatever is due
        What `talker` itself wants written is for itself to look after: its `wake` is set then, or its heartbeat is due.
        """
        if patience_s > SENSES_APART * takes_s:  # else this reading is as urgent as contacts are
            await self.let_others_sense(talker)
        until = self._clock.now() + min(patience_s, HELD_MAX_S)
        while True:
            await self.let_others_write(talker)
            now = self._clock.now()
            due = self.taken_at(now, takes_s)
            if talker.wake.is_set() or talker.is_beat_due or due is None or due > until or now > until:
                return
            beats_by = min(each.beats_by for each in self._talkers)
            await self.pause(max(min(due + LATE_S, beats_by) - now, 0.0))

    def taken_at(self, now: float, takes_s: float) -> float | None:
        """Wire time (s) of what is due before a request that takes `takes_s` would have ended; None: the line is free for it."""
        return max((at for at in self._due.values() if at - now < takes_s + GUARD_S and now - at < LATE_S), default=None)

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
