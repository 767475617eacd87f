"""What the CNC has to show before the process goes on: tool, work offset, and a spindle that stands or turns as it should."""

from __future__ import annotations

import contextlib

from cellctl.cell.transaction import Step
from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.cnc.driver import CncDriver
from drivers.cnc.events import Status
from drivers.cnc.protocol import FULL_STATUS, SPINDLE_STOP
from drivers.errors import DriverError
from drivers.interfaces import Clock

STATUS_TIMEOUT_S = 5.0  # firmware repeats WCO and T every 10 to 30 reports
OFFSET_TOLERANCE = 2e-3  # mm or deg; firmware prints three decimals
SPINDLE_TIMEOUT_S = 20.0  # from standstill to full speed, or back, with a heavy tool
SPINDLE_TOLERANCE = 0.1  # of the programmed speed, by which a loaded drive and its reading may differ
SPINDLE_STANDS_RPM = 1.0


class CncChecks:
    """Builds the steps that read the CNC's status; each needs a report that is younger than its own beginning."""

    def __init__(self, cell: Cell, drivers: CellDrivers, clock: Clock) -> None:
        self._cutters = {tool.number: tool.name for tool in cell.tools if tool.kind != "deposition"}
        self._d = drivers
        self._clock = clock

    @property
    def _status(self) -> Status | None:
        return self._d.cnc.status

    def _age_s(self) -> float:
        return self._clock.now() - self._status.at if self._status else STATUS_TIMEOUT_S

    def tool(self, number: int) -> Step:
        """The tool that the Program has mounted is the one that the CNC reports; a firmware that reports none has it from the Program alone."""
        cnc = self._d.cnc
        return Step(
            f"checking that tool {number} is mounted",
            lambda: self._mounted == number or not tells_tool(cnc),
            STATUS_TIMEOUT_S,
            age_s=self._age_s,
            code="tool",
            detail=lambda: f"the CNC reports T{self._mounted}",
        )

    def no_cutter(self) -> Step:
        """No cutter in the spindle, where no tool change of the Program says what has to be there."""
        return Step(
            "checking that no cutter is mounted",
            lambda: self._mounted not in self._cutters,
            STATUS_TIMEOUT_S,
            age_s=self._age_s,
            code="tool",
            detail=lambda: f"the CNC reports T{self._mounted}, {self._cutters.get(self._mounted or 0, '')}",
        )

    @property
    def _mounted(self) -> int | None:
        return self._status.tool if self._status else None

    def datum(self, offset: dict[str, float]) -> Step:
        """The controller's work offset is the Program's."""
        cnc = self._d.cnc

        def ask() -> None:
            if cnc.identity is not None and cnc.identity.firmware == "grblhal":
                cnc.urge(FULL_STATUS)  # with the offset; others repeat it every 10 to 30 reports

        def differs() -> str:
            return offset_differs(self._status.wco if self._status else {}, offset)

        return Step(
            "checking the work offset",
            lambda: not differs(),
            STATUS_TIMEOUT_S,
            act=ask,
            age_s=self._age_s,
            must_last_s=0.03,  # a report that was asked for before may still come first
            code="datum",
            detail=differs,
        )

    def spindle_stands(self) -> Step:
        """No turning spindle, as far as the firmware reports its speed."""
        return Step(
            "checking that the spindle stands",
            lambda: self._status is not None and self._status.rpm <= SPINDLE_STANDS_RPM,
            SPINDLE_TIMEOUT_S,
            age_s=self._age_s,
            detail=lambda: f"{self._status.rpm if self._status else 0.0:.0f} rpm reported",
            remedy="stop the spindle at the machine, then reset",
        )

    def spindle_turns(self, rpm: float) -> Step:
        """The spindle at `rpm` times its override, where the firmware reports its speed; set going again if it was stopped since."""

        def wanted() -> float:
            return rpm * (self._status.overrides[2] if self._status else 100) / 100.0

        def is_at_speed() -> bool:
            status = self._status
            if status is None or not status.has_rpm or status.state == "Door":  # behind a door the firmware restores it, before it moves
                return status is not None
            return abs(status.rpm - wanted()) <= SPINDLE_TOLERANCE * wanted()

        def turn() -> None:
            status = self._status
            if status is None or not status.has_rpm or status.rpm > SPINDLE_STANDS_RPM:
                return
            if status.is_held:
                self._d.cnc.urge(SPINDLE_STOP)  # it was stopped in the hold, and is let go again there
            else:
                self._d.cnc.enqueue(f"M3 S{rpm:.0f}")

        return Step(
            f"waiting for the spindle to turn at {rpm:.0f} rpm",
            is_at_speed,
            SPINDLE_TIMEOUT_S,
            act=turn,
            age_s=self._age_s,
            detail=lambda: f"{self._status.rpm if self._status else 0.0:.0f} rpm reported",
            remedy="look at the spindle and its drive, then reset",
            undo=(self.spindle_off(),),
        )

    def spindle_off(self) -> Step:
        """Stop the spindle of a CNC that stands and waits, or is held."""

        def stop() -> None:
            status = self._status
            if status is None or self._d.cnc.is_halted:
                return
            with contextlib.suppress(DriverError):  # a line that is lost is told by its own alarm
                if status.is_idle:
                    self._d.cnc.enqueue("M5")
                elif status.is_held and status.rpm > SPINDLE_STANDS_RPM:  # the byte lets one go that stands
                    self._d.cnc.urge(SPINDLE_STOP)

        return Step(
            "stopping the spindle",
            lambda: self._status is not None and self._status.rpm <= SPINDLE_STANDS_RPM,
            SPINDLE_TIMEOUT_S,
            act=stop,
            age_s=self._age_s,
            detail=lambda: f"{self._status.rpm if self._status else 0.0:.0f} rpm reported",
        )


def tells_tool(cnc: CncDriver) -> bool:
    """Whether this firmware reports the tool at all: grbl 1.1 does not, the Program's own tool change is what is known there."""
    return cnc.identity is None or cnc.identity.firmware != "grbl"


def offset_differs(held: dict[str, float], wanted: dict[str, float]) -> str:
    """Where the controller's offset is not the Program's, in words; empty when they agree."""
    if not held:
        return "the CNC has not told its work offset"
    wrong = [
        f"{letter} is {held.get(letter, float('nan')):.3f}, the program needs {value:.3f}"
        for letter, value in wanted.items()
        if not abs(held.get(letter, float("nan")) - value) <= OFFSET_TOLERANCE
    ]
    return "; ".join(wrong)
