"""Homing is answered when it ends, minutes later: what the machine reports meanwhile tells sooner that no answer will come."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.cnc.events import Status

SILENT_S = 1.0  # without a report, behind a machine that has reported while it homes (grbl 1.1 reports nothing then)
UNANSWERED_S = 1.5  # standing unlocked behind homing, with its `ok` not come
NOT_BEGUN_S = 2.0  # reports of a machine that stands, so long behind `$H`: it never had the line


class HomingWatch:
    """Watches one homing. began_at : wire time (s); reports_homing : whether this firmware is known to report while it homes."""

    def __init__(self, began_at: float, *, reports_homing: bool = False) -> None:
        self._began_at = began_at
        self._reports = reports_homing
        self._asked_at: float | None = None
        self._homed_at: float | None = None  # last report that said Home
        self._stood_since: float | None = None

    def asked(self, now: float) -> None:
        """`$H` goes out at wire time `now` (s)."""
        self._asked_at = now

    def faults(self, status: Status | None, now: float) -> Iterator[tuple[str, str, str]]:
        """(code, detail, remedy) of what has to latch at wire time `now` (s)."""
        if status is None:
            return
        if status.at > self._began_at and status.state == "Home":
            self._homed_at, self._stood_since = status.at, None
        elif self._homed_at is not None and status.state == "Idle" and self._stood_since is None:
            self._stood_since = status.at
        age_s = now - max(status.at, self._began_at)
        if (self._reports or self._homed_at is not None) and age_s > SILENT_S:
            yield "cnc_silent", f"last status report {age_s:.1f} s ago, while homing", ""
        elif self._stood_since is not None and status.state == "Idle" and now - self._stood_since > UNANSWERED_S:
            yield "answer_overdue", f"$H: the CNC stands, homed, and has not answered for {now - self._stood_since:.1f} s", ""
        elif self._homed_at is None and self._asked_at is not None and status.at - self._asked_at > NOT_BEGUN_S:
            yield from self._not_begun(status, status.at - self._asked_at)

    @staticmethod
    def _not_begun(status: Status, since_s: float) -> Iterator[tuple[str, str, str]]:
        if status.state == "Hold":
            yield "step_failed", "feed hold at the machine: homing has not begun", "reset, then home again"
        elif status.state in ("Idle", "Alarm"):
            yield "answer_overdue", f"$H: the CNC stands and has not begun to home for {since_s:.1f} s", ""
