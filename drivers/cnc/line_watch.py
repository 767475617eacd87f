"""Joins a CNC's line to the running event loop: read when bytes come, written when the wire has room again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.cnc.line import CncLine
from drivers.transport.one_shot import OneShot

SAME_S = 2e-5  # a timer that goes off within this of the time wanted is not set anew


class LineWatch:
    """Calls `pump` when bytes have come in, and writes to the line by itself in between.

    pump : reads the line's events (CncLine.pump) and acts on them. `rearm` is called after every other use of the line.
    """

    def __init__(self, line: CncLine, pump: Callable[[], None]) -> None:
        self._line = line
        self._pump = pump
        self._loop = asyncio.get_running_loop()
        self._timer = OneShot()
        self._due_at = 0.0
        self._port = line.fileno()
        line.is_timed = True
        self._loop.add_reader(self._timer.fd, self._on_timer)
        if self._port is not None:
            self._loop.add_reader(self._port, self._on_bytes)
        self.rearm()

    def rearm(self) -> None:
        """Set the timer to when the line has something to write; nothing happens on a closed watch."""
        due_at = self._line.due_at()
        if abs(due_at - self._due_at) > SAME_S and self._timer.fd >= 0:
            self._due_at = due_at
            self._timer.set(due_at)

    def close(self) -> None:
        """Leave the event loop. Harmless twice."""
        if self._timer.fd >= 0:
            self._line.is_timed = False
            self._loop.remove_reader(self._timer.fd)
            if self._port is not None:
                self._loop.remove_reader(self._port)
            self._timer.close()

    def _on_bytes(self) -> None:
        self._pump()
        self.rearm()

    def _on_timer(self) -> None:
        line = self._line
        line.write(line.clock.now() - self._due_at)
        if not line.is_connected:
            self._pump()
        self._due_at = 0.0
        self.rearm()
