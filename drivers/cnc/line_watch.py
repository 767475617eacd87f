"""Joins a CNC's line to the running event loop: read when bytes come, written when the wire has room again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.cnc.line import CncLine
from drivers.transport.line_loop import LineLoop, Served
from drivers.transport.one_shot import OneShot

SAME_S = 2e-5  # a timer that goes off within this of the time wanted is not set anew


class LineWatch:
    """Reads the line when bytes come, calls `pump` when it has something to tell, and writes to the line by itself in between.

    On a LineLoop that is done between the rounds of the event loop, and accepted lines alone bring no call of `pump` (the tick's comes);
    on any other loop by a timer in it.
    pump : reads the line's events (CncLine.pump) and acts on them. `rearm` is called after every other use of the line.
    """

    def __init__(self, line: CncLine, pump: Callable[[], None]) -> None:
        self._line = line
        self._pump = pump
        self._loop = asyncio.get_running_loop()
        self._is_open = True
        self._due_at = 0.0
        self._port = line.fileno()
        self._served: Served | None = None
        self._timer: OneShot | None = None
        line.is_timed = True
        if isinstance(self._loop, LineLoop) and not self._loop.line_selector.is_serving:
            self._served = Served(self._port, self._read, self._write, self._failed)
            self._loop.line_selector.serve(self._served)
        else:
            self._timer = OneShot()
            self._loop.add_reader(self._timer.fd, self._on_timer)
            if self._port is not None:
                self._loop.add_reader(self._port, self._on_bytes)
        self.rearm()

    def rearm(self) -> None:
        """Set the timer to when the line has something to write; nothing happens on a closed watch."""
        if self._served is not None:
            self._served.due_at, self._served.is_patient = self._line.outlook()
        elif self._timer is not None:
            due_at = self._line.due_at()
            if abs(due_at - self._due_at) > SAME_S:
                self._due_at = due_at
                self._timer.set(due_at)

    def close(self) -> None:
        """Leave the event loop. Harmless twice."""
        if not self._is_open:
            return
        self._is_open = False
        self._line.is_timed = False
        if self._served is not None and isinstance(self._loop, LineLoop):
            self._loop.line_selector.serve(None)
            self._served = None
        if self._timer is not None:
            self._loop.remove_reader(self._timer.fd)
            self._timer.close()
            self._timer = None
            if self._port is not None:
                self._loop.remove_reader(self._port)

    def _on_bytes(self) -> None:
        self._pump()
        self.rearm()

    def _on_timer(self) -> None:
        self._line.write(self._line.clock.now() - self._due_at)
        if not self._line.is_connected:
            self._pump()
        self._due_at = 0.0
        self.rearm()

    # -- between the rounds of a LineLoop: whether it has something to do now --------------------------------------------

    def _write(self) -> bool:
        served = self._served
        if served is None:
            return False
        self._line.serve(served.due_at, reads=served.is_patient)
        return self._is_told(served)

    def _read(self) -> bool:
        if self._served is None:
            return False
        self._line.step()
        return self._is_told(self._served)

    def _is_told(self, served: Served) -> bool:
        line = self._line
        served.due_at, served.is_patient = line.outlook()
        if not line.is_connected:
            served.port = None
        elif not line.has_news:
            return False
        self._loop.call_soon(self._on_bytes)
        return True

    def _failed(self, error: Exception) -> None:
        self._loop.call_exception_handler({"message": "serving the CNC's line failed", "exception": error})
