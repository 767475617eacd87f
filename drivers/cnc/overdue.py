"""Tells when the answer to the oldest line is overdue: not while the machine pauses, its spindle turns up, or moves lie ahead."""

from __future__ import annotations

import math

from config.cell import Cnc
from drivers.cnc.events import AnswerOverdue, Status
from drivers.cnc.program_stream import InverseTime, Pauses, ProgramStream
from drivers.cnc.protocol import GrblProtocol
from drivers.cnc.status import MOVING, PAUSING

STATUS_FRESH_S = 1.0  # an older report says nothing about why answers are missing
RESET_S = 3.0  # for the banner after a soft reset; boards that load their program again take about two


SPINDLE_CHANGE_RPM = 1.0  # between two reports: less is noise of a spindle at rest or at its speed


def pauses_of(facts: Cnc) -> Pauses:
    """How long the cell's control may take over a line without motion."""
    return Pauses(facts.tool_change_s, facts.spindle_s)


class AnswerWatch:
    """Knows the last sign that answers may still be on their way. facts : answer_timeout_s is beyond the time of the moves ahead of a line"""

    def __init__(self, protocol: GrblProtocol, facts: Cnc, now: float) -> None:
        self._protocol = protocol
        self._timeout_s = facts.answer_timeout_s
        self._pauses = pauses_of(facts)
        self._empty_planner: int | None = None  # free blocks that an idle planner shows
        self._progress_at = now
        self._reset_at = -math.inf
        self._is_overdue = False
        self._status: Status | None = None

    def progress(self, now: float) -> None:
        """An answer came."""
        self._progress_at = now

    def reset_asked(self, now: float) -> None:
        """A reset was sent: its banner is due."""
        self._reset_at = now

    def was_reset(self) -> None:
        """The banner came."""
        self._is_overdue = False

    def report(self, status: Status, empty_planner: int | None) -> None:
        """A status report came; a machine that moves or pauses has its reason for not answering, and so has a spindle on its way."""
        before, self._status, self._empty_planner = self._status, status, empty_planner
        if status.state == "Tool":  # this control tells when it changes a tool: no time has to be allowed for it
            self._pauses = Pauses(0.0, self._pauses.spindle_s)
        moves = status.state in MOVING and before is not None and (status.machine != before.machine or status.line != before.line)
        moves = moves or (before is not None and abs(status.rpm - before.rpm) > SPINDLE_CHANGE_RPM * max(1.0, 0.001 * status.rpm))
        if before is None or moves or status.state in PAUSING:
            self._progress_at = max(self._progress_at, status.at)

    def look(self, now: float, program: ProgramStream | None) -> AnswerOverdue | None:
        """What has become overdue since the last look; told once."""
        protocol = self._protocol
        if protocol.reset_expected and now - self._reset_at > RESET_S:
            protocol.reset_expected = False
            return AnswerOverdue(0, "reset", now - self._reset_at, protocol.garbled)
        oldest = protocol.oldest
        if oldest is None or oldest.answer is not None:
            self._progress_at = now
            self._is_overdue = False
            return None
        waited = now - self._progress_at
        if self._is_overdue or waited <= self._timeout_s:
            return None
        status = self._status
        if status is not None and status.state in PAUSING and now - status.at < STATUS_FRESH_S:
            return None
        if waited <= self._timeout_s + self._allowance_s(program):
            return None
        self._is_overdue = True
        return AnswerOverdue(oldest.n, oldest.text, waited, protocol.garbled)

    def _allowance_s(self, program: ProgramStream | None) -> float:
        """Predicted time of the moves that the controller still holds, at the present overrides; of one that stands with an empty
        planner, the pauses among the lines that it has not answered."""
        if program is None:
            return 0.0
        if self._is_standing:
            mode = InverseTime(self._pauses)
            return sum(mode.seconds(text) for text in self._protocol.unanswered_texts)
        feed, rapid, _ = self._status.overrides if self._status else (100, 100, 100)
        return program.remaining_s() * 100.0 / max(1, min(feed, rapid, 100))

    @property
    def _is_standing(self) -> bool:
        status = self._status
        if status is None or not status.is_idle:
            return False
        return status.planner_free is None or self._empty_planner is None or status.planner_free >= self._empty_planner
