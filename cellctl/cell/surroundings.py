"""What the cell knows of its table and of the machine's position: facts that a person vouches for and that motion takes away."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cellctl.cell.refusal import TABLE, Refused
from cellctl.domain.snapshot import Table
from config.by_hand import ByHand
from drivers.cell_wires import CellDrivers
from drivers.cnc.events import Status
from drivers.cnc.status import MOVING

CLEAR = "the table was found clear", "look again and confirm that it is clear"
UNTOUCHED = "the part was found untouched", "look again and confirm that it stands untouched on the table"
"""What a person found, and what to do when that counts no more: before a new part, and before one is gone on with."""
SAME_CLOCK_S = 0.5  # two processes of one computer read the same clock
SAME_POSITION = 0.01  # mm or deg; firmware prints three decimals
Tell = Callable[[str, str, dict[str, Any]], None]


class TableWatch:
    """When the table was last disturbed: something ran or moved, a stop was pressed, the door was open, nobody watched."""

    def __init__(self, facts: ByHand, unix: Callable[[], float]) -> None:
        self._facts = facts
        self._unix = unix
        self.disturbed_at = unix()
        self.because = "the cell process started"
        self._tool: int | None = None

    @property
    def view(self) -> Table:
        """For the snapshot."""
        return Table(self.disturbed_at, self.because)

    def disturb(self, because: str) -> None:
        """Whoever found the table clear before has to look again."""
        self.disturbed_at, self.because = self._unix(), because

    def watch(self, drivers: CellDrivers, in_job: bool) -> None:
        """Look at motion and door; called by every tick."""
        status = drivers.cnc.status
        if in_job:
            self.disturb("a job was on the cell")
        elif status is not None and status.state in MOVING:
            self.disturb("the machine moved")
        elif not drivers.io.client.is_stale("door_closed") and not drivers.io.door_closed:
            self.disturb("the door was open")
        if status is not None and status.tool is not None:
            if self._tool is not None and status.tool != self._tool and not in_job:
                self.disturb(f"the tool was changed to T{status.tool}")
            self._tool = status.tool

    def check(self, confirmed_at: float, found: tuple[str, str] = CLEAR) -> None:
        """Raises Refused unless a confirmation of this Unix time (s) still counts. found : what was confirmed, CLEAR or UNTOUCHED"""
        seen, remedy = found
        age_s = self._unix() - confirmed_at
        if age_s < -SAME_CLOCK_S:
            raise Refused(f"the computer's clock was set back after {seen}", remedy, TABLE)
        if age_s > self._facts.table_confirmed_s:
            raise Refused(f"{seen} {age_s / 60.0:.0f} min ago", remedy, TABLE)
        if self.disturbed_at > confirmed_at:
            raise Refused(f"{self.because} after {seen}", remedy, TABLE)


class Position:
    """Whether the machine's position is to be trusted. found : data of the last event of an earlier process"""

    def __init__(self, tell: Tell, found: dict[str, Any] | None) -> None:
        self._tell = tell
        self.why = str(found.get("why", "")) if found else ""
        self._last: dict[str, float] = {}
        self._is_new = False

    def suspect(self, why: str) -> None:
        """From now on no job starts."""
        if self.why != why:
            self._tell("position", f"the machine's position is not to be trusted: {why}", {"why": why})
        self.why = why

    def trust(self, because: str) -> None:
        """Homed, or a person vouches for it."""
        if self.why:
            self._tell("position", f"the machine's position is trusted again: {because}", {"why": "", "because": because})
        self.why = ""

    def connected(self) -> None:
        """The next report comes over a line that was just opened."""
        self._is_new = True

    def report(self, status: Status) -> None:
        """Compare what a machine that was connected again tells with what it told before."""
        if self._is_new and self._last and status.state != "Alarm":
            moved = [axis for axis, value in status.machine.items() if abs(value - self._last.get(axis, value)) > SAME_POSITION]
            if moved:
                self.suspect(f"{', '.join(moved)} told another place after the CNC was connected again")
        self._is_new = False
        self._last = status.machine

    def check(self) -> None:
        """Raises Refused while the position is suspect."""
        if self.why:
            raise Refused(f"the machine's position is not to be trusted: {self.why}", "home it, or confirm its position with a reason")
