"""An event loop that serves one line at its microsecond between its rounds: a paced write or an answer costs two or three system calls."""

from __future__ import annotations

import asyncio
import math
import select
import selectors
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass
class Served:
    """What a LineSelector serves. write, read : True if they have left something to do to the event loop.

    port : descriptor at which `read` is called when bytes come, None for none    due_at : when `write` is called (s, CLOCK_MONOTONIC)
    is_patient : bytes that come may wait until then, which `write` then reads: a wake less
    """

    port: int | None
    read: Callable[[], bool]
    write: Callable[[], bool]
    failed: Callable[[Exception], None]
    due_at: float = math.inf
    is_patient: bool = False


class LineSelector(selectors.EpollSelector):
    """Waits as EpollSelector does, and serves a line meanwhile without a round of the event loop."""

    def __init__(self) -> None:
        super().__init__()
        self._own = self.fileno()
        self._served: Served | None = None

    @property
    def is_serving(self) -> bool:
        """Whether a line is served."""
        return self._served is not None

    def serve(self, served: Served | None) -> None:
        """Serve this line from now on; None: no line."""
        self._served = served

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """What is ready within timeout seconds (None: no limit; 0 or less: now), the line's own excepted."""
        if self._served is None:
            return super().select(timeout)
        now = time.monotonic()
        end = math.inf if timeout is None else now + timeout
        try:
            while (served := self._served) is not None:
                if served.due_at <= now:
                    if served.write():
                        break
                    now = time.monotonic()
                until = served.due_at if served.due_at < end else end
                watched = (self._own,) if served.is_patient or served.port is None else (self._own, served.port)
                try:
                    ready = select.select(watched, (), (), (until - now if until > now else 0.0) if until < math.inf else None)[0]
                except (OSError, ValueError):
                    if served.port is None:
                        break
                    served.port = None  # it was closed
                    continue
                if served.port in ready and served.read():
                    break
                now = time.monotonic()
                if self._own in ready:
                    break
                if now >= end:
                    if served.due_at <= now:  # within the wait, which took longer than asked: it does not wait for the next one
                        served.write()
                    break
        except Exception as error:  # noqa: BLE001  the edge of what the event loop calls: told as it tells of its own callbacks
            failed, self._served = self._served, None
            if failed is not None:
                failed.failed(error)
        return super().select(0)


class LineLoop(asyncio.SelectorEventLoop):
    """asyncio's loop over a LineSelector: `line_selector`."""

    def __init__(self) -> None:
        self.line_selector = LineSelector()
        super().__init__(self.line_selector)
