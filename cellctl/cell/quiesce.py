"""Bringing the machine to rest: hold until it stands, said again as long as it does not; then, if asked, drop what is buffered."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from drivers.cell_wires import CellDrivers
from drivers.errors import LinkError

REPEAT_S = 0.1  # a hold that was not seen to act is said again
STAND_TIMEOUT_S = 1.5  # after that a reset is safer than more motion


class Quiesce:
    """Works on the level of every tick. `is_still`: stands; `is_reset`: what was buffered is gone."""

    def __init__(self, drivers: CellDrivers, is_harmless: Callable[[], bool]) -> None:
        """is_harmless : whether the one line that waits for its answer moves nothing"""
        self._d = drivers
        self._is_harmless = is_harmless
        self.outcome = ""  # how the run ends once the machine is at rest
        self.is_reset = False
        self._reset_at = 0.0
        self._wants_reset = False
        self._began_at = 0.0
        self._said_at = -1.0
        self._is_braking = False  # a hold was said since `begin`
        self.on_hold: Callable[[float], None] = lambda at: None  # told when the machine begins to brake, wire time (s)

    def begin(self, now: float, *, reset: bool, lead_s: float = 0.0) -> None:
        """Come to rest from now on; harmless twice: a reset that is on its way is not put off by asking again.

        reset : drop what is buffered at standstill. lead_s : let so much time go by before the first hold, so that the laser is
        dark before the tip slows down.
        """
        first_at = now + lead_s - REPEAT_S
        if reset and self._wants_reset and not self.is_reset:
            self._said_at = min(self._said_at, first_at)
        else:
            self._began_at, self._said_at = now, first_at
            self._is_braking = False
        self._wants_reset = reset
        self.is_reset = False
        self.advance(now)

    @property
    def is_still(self) -> bool:
        """Whether the last report shows a machine that stands with nothing left to move."""
        status = self._d.cnc.status
        if status is None or not self._is_told:
            return False
        if (
            status.is_held
            or status.state in ("Alarm", "Sleep")
            or (status.state == "Door" and status.substate in (0, 1, None))
        ):
            return True
        nothing_comes = self._d.cnc.is_drained or bool(self._d.cnc.is_halted) or self._is_harmless()
        return status.is_idle and nothing_comes

    @property
    def _is_told(self) -> bool:
        """Whether the last report came since: an older one may show the standstill before a resume."""
        status = self._d.cnc.status
        return status is not None and status.at > self._began_at

    @property
    def is_clear(self) -> bool:
        """Whether the machine was reset and has told since that it waits."""
        status = self._d.cnc.status
        return (
            self.is_reset
            and status is not None
            and status.at > self._reset_at
            and status.state in ("Idle", "Alarm", "Sleep")
        )

    def advance(self, now: float) -> None:
        """Say hold where motion is or may come, reset where it was asked for. A lost link is told by the driver's next events."""
        with contextlib.suppress(LinkError):
            self._advance(now)

    def _advance(self, now: float) -> None:
        cnc = self._d.cnc
        status = cnc.status
        state = status.state if status else ""
        is_time = self.is_still or state == "Home" or now - self._began_at > STAND_TIMEOUT_S
        if self._wants_reset and not self.is_reset and is_time:
            cnc.reset()
            self.is_reset = True
            self._reset_at = now
            return
        if self.is_reset or self.is_still or (self._is_told and state in ("Hold", "Door", "Check")):
            return
        if now - self._said_at >= REPEAT_S:
            self._said_at = now
            if state == "Jog":
                cnc.jog_cancel()
            cnc.hold()
            if not self._is_braking:
                self._is_braking = True
                self.on_hold(now)
