"""A spindle that turns in a hold behind an open door is stopped, by the firmware's own override; what resumes has it turn again first."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING

from cellctl.cell.cnc_checks import SPINDLE_STANDS_RPM, SPINDLE_TIMEOUT_S
from cellctl.cell.modes import MILL
from cellctl.cell.transaction import Step
from drivers.cnc.protocol import SPINDLE_STOP
from drivers.errors import LinkError

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller
    from drivers.cnc.events import Status

SEEN_S = 1.5  # a spindle that was stopped has slowed down by then, and a report has told so
SLOWED_SHARE = 0.97  # of the speed at which it was told to stop
TRIES = 3
FAILED = "the door is open and the spindle does not stop"


class SpindleWatch:
    """Looks at every tick while the job is held or a fault is latched.

    The byte (0x9E, grbl 1.1 and grblHAL: "toggle spindle stop", in a hold alone) lets a spindle go that it has stopped, so it is said once,
    and again only to one that goes on at full speed. A control behind a door input of its own stops and restores by itself.
    """

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._tries = 0
        self._said_at = 0.0
        self._rpm = 0.0
        self._is_told = False

    def advance(self, now: float) -> None:
        """Stop what turns. now : wire time, s"""
        c = self._c
        if c.drivers is None or not c.is_cnc_alive:
            return
        status = c.drivers.cnc.status
        if status is None or not status.is_held or c.run is None:
            self._tries, self._is_told = 0, False
            return
        if c.drivers.io.door_closed or c.way_back is not None or not self._turns(status):
            return
        if self._tries and (now - self._said_at < SEEN_S or status.at < self._said_at + SEEN_S):
            return
        if self._tries and (not status.has_rpm or status.rpm < SLOWED_SHARE * self._rpm):
            return
        if self._tries >= TRIES:
            self._fail()
            return
        with contextlib.suppress(LinkError):  # a line that is lost is told by its own alarm
            c.drivers.cnc.urge(SPINDLE_STOP)
            c.drivers.cnc.query_status()
        self._tries, self._said_at, self._rpm = self._tries + 1, now, status.rpm
        if self._tries == 1:
            c.event("spindle", "the door is open: the spindle is stopped; a resume has it turn before anything moves")

    def _turns(self, status: Status) -> bool:
        """Whether it turns; with a control that does not tell its speed, whether it may: a cut is held."""
        return status.rpm > SPINDLE_STANDS_RPM if status.has_rpm else self._c.run is not None and self._c.run.mode == MILL

    def _fail(self) -> None:
        if not self._is_told:
            self._is_told = True
            self._c.fault("step_failed", FAILED, "keep away from the tool: stop the spindle at the machine; then reset")

    def settled(self) -> list[Step]:
        """Before a resume: a spindle that was told to stop has run down, so that what has it turn again knows that it stands."""
        if not self._tries or self._c.drivers is None:
            return []
        cnc = self._c.drivers.cnc
        rpm: Callable[[], float] = lambda: cnc.status.rpm if cnc.status is not None else 0.0  # noqa: E731
        return [Step("waiting until the spindle stands", lambda: rpm() <= SPINDLE_STANDS_RPM, SPINDLE_TIMEOUT_S, detail=lambda: f"{rpm():.0f} rpm")]
