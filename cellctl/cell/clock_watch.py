"""The computer's clock of day is only written down. When somebody sets it, the cell says so: the order of events is that of their numbers."""

from __future__ import annotations

from collections.abc import Callable

from cellctl.cell.surroundings import TableWatch
from drivers.interfaces import Clock

STEP_S = 1.0  # between two looks; a clock that is slewed by NTP changes by less than a millisecond in a second
Tell = Callable[[str, str, dict[str, float]], None]


class ClockWatch:
    """Compares the clock of day with the monotonic one, at every tick."""

    def __init__(self, wire: Clock, unix: Callable[[], float], tell: Tell, table: TableWatch) -> None:
        self._wire, self._unix, self._tell, self._table = wire, unix, tell, table
        self._ahead_s = unix() - wire.now()

    def look(self) -> None:
        """Tell a step, once. What was found on the table before is to be looked at again: its age is not known any more."""
        ahead_s = self._unix() - self._wire.now()
        step_s = ahead_s - self._ahead_s
        self._ahead_s = ahead_s
        if abs(step_s) < STEP_S:
            return
        way = "forward" if step_s > 0.0 else "back"
        self._table.disturb("the computer's clock was set")
        self._tell(
            "clock",
            f"the computer's clock was set {way} by {abs(step_s):.1f} s; times before and after do not compare, the numbers of events do",
            {"step_s": round(step_s, 3)},
        )
