"""The laser's wired gate between programs: outputs keep their level over a reset, so that a pass that was broken off leaves it open."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from cellctl.cell.refusal import READINESS, Refused
from cellctl.cell.transaction import Step
from drivers.errors import LinkError

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller
    from drivers.cnc.protocol import Answer

ANSWER_S = 1.0  # an answer that did not come by then is lost; M65 twice is harmless
AGAIN_S = 1.0  # between two tries of a control that refuses
SHUT_S = 3.0  # for a step that waits for it: a lost answer, and another


class Gate:
    """Shuts the gate (M65) as soon as the control takes G-code and no run has its hand on it; `is_shut` when that was answered with ok.

    The permit is locked all the while: this is the second lock, and it is what a program that follows finds.
    """

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._port = controller.cell.cnc.laser_gate_output
        self._answer: Answer | None = None
        self._asked_at = 0.0
        self._again_at = 0.0
        self._why = ""
        self.is_shut = self._port is None

    def doubt(self) -> None:
        """Its level is not known any more: a program has it, or the control has begun anew."""
        self.is_shut = self._port is None
        self._answer = None
        self._again_at = 0.0

    @property
    def is_asked(self) -> bool:
        """Whether its word is on its way: a line that moves nothing."""
        return self._answer is not None

    def advance(self, now: float) -> None:
        """Ask, or take the answer in. now : wire time, s. Called by every tick; during a run the gate is the program's."""
        c = self._c
        if self._port is None:
            return
        if c.run is not None or not c.is_cnc_alive or c.drivers is None:
            if self.is_shut or self._answer is not None:
                self.doubt()
            return
        if self._answer is not None:
            self._take(self._answer, now)
        elif not self.is_shut and now >= self._again_at and self._takes_words():
            try:
                self._answer = c.drivers.cnc.enqueue(f"M65 P{self._port}")
            except LinkError:
                return
            self._asked_at = now

    def _takes_words(self) -> bool:
        drivers = self._c.drivers
        assert drivers is not None
        status, cnc = drivers.cnc.status, drivers.cnc
        return status is not None and status.is_idle and cnc.protocol.unanswered == 0 and not cnc.protocol.is_latched

    def _take(self, answer: Answer, now: float) -> None:
        if answer.done and answer.code == 0:
            self.is_shut, self._why = True, ""
        elif answer.done:
            self._refused(answer.code)
        elif not answer.is_lost:
            if now - self._asked_at < ANSWER_S:
                return
            self._say("the CNC has not answered M65")
        self._again_at = now if self.is_shut or answer.is_lost else now + AGAIN_S
        self._answer = None

    def _refused(self, code: int) -> None:
        drivers = self._c.drivers
        assert drivers is not None
        self._say(f"the CNC refuses M65 P{self._port} (error {code})")
        with contextlib.suppress(LinkError):
            drivers.cnc.enqueue("")  # after an error a control may execute nothing until it has had an empty line

    @property
    def is_awaited(self) -> bool:
        """Whether it is about to be shut: what moves waits for that, but not for a control that refuses."""
        return not self.is_shut and not self._why and not self._is_locked()

    def _say(self, line: str) -> None:
        if line != self._why:
            self._why = line
            self._c.event("gate", f"the laser's gate is not known to be shut: {line}", {"why": line})

    def step(self) -> Step:
        """Wait until it is shut; a control that is locked takes no words, nor does a cell without its CNC."""
        return Step(
            "waiting until the laser's gate is shut",
            lambda: self.is_shut or not self._c.is_cnc_alive or self._is_locked(),
            SHUT_S,
            detail=lambda: "feed hold at the machine" if self._is_held() else self._why or "the CNC has not answered M65",
            remedy="look at the serial cable, and at laser_gate_output in the cell file if the CNC refuses M65; then reset",
        )

    def _is_held(self) -> bool:
        status = self._c.drivers.cnc.status if self._c.drivers is not None else None
        return status is not None and status.state == "Hold"

    def _is_locked(self) -> bool:
        status = self._c.drivers.cnc.status if self._c.drivers is not None else None
        return status is not None and status.state in ("Alarm", "Sleep")

    def check(self) -> None:
        """Raises Refused while it is not known to be shut."""
        if not self.is_shut:
            raise Refused(
                f"the laser's gate is not known to be shut: {self._why or 'the CNC has not answered M65 yet'}",
                "try again in a second; else check laser_gate_output in the cell file and the wiring",
                READINESS,
            )
