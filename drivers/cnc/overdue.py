"""Tells when the answer to the oldest line is overdue: not while the machine pauses or still has predicted moves ahead of it."""

from __future__ import annotations

import math

from drivers.cnc.events import AnswerOverdue, Status
from drivers.cnc.program_stream import ProgramStream
from drivers.cnc.protocol import GrblProtocol
from drivers.cnc.status import MOVING, PAUSING

STATUS_FRESH_S = 1.0  # an older report says nothing about why answers are missing
RESET_S = 3.0  # for the banner after a soft reset; boards that load their program again take about two


class AnswerWatch:
    """Knows the last sign that answers may still be on their way. timeout_s : beyond the time of the moves ahead of a line."""

    def __init__(self, protocol: GrblProtocol, timeout_s: float, now: float) -> None:
        self._protocol = protocol
        self._timeout_s = timeout_s
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

    def report(self, status: Status) -> None:
        """A status report came; a machine that moves or pauses has its reason for not answering."""
        before, self._status = self._status, status
        moves = status.state in MOVING and before is not None and (status.machine != before.machine or status.line != before.line)
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
        """Predicted time of the moves that the controller still holds, at the present overrides."""
        if program is None:
            return 0.0
        feed, rapid, _ = self._status.overrides if self._status else (100, 100, 100)
        return program.remaining_s() * 100.0 / max(1, min(feed, rapid, 100))
