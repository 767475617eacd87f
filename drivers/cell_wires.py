"""Opens the wires of a cell as its cell file says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from config.cell import Cell
from drivers.cnc.driver import CncDriver
from drivers.feeder import Feeder
from drivers.interfaces import Clock, ModbusLink
from drivers.interlocks import Io
from drivers.laser import Laser


@dataclass
class CellDrivers:
    """All drivers of one cell."""

    cnc: CncDriver
    laser: Laser
    feeder: Feeder
    io: Io
    links: tuple[ModbusLink, ...]

    async def close(self) -> None:
        """Give every wire back."""


def open_cnc(cell: Cell, run_dir: Path, clock: Clock) -> CncDriver:
    """Open the CNC's serial port. Raises PortAbsent, PortBusy, PortDenied."""
    raise NotImplementedError


def open_cell(cell: Cell, run_dir: Path, clock: Clock) -> CellDrivers:
    """Open the CNC's port; Modbus lines open at the first cycle and reopen by themselves. Raises as open_cnc."""
    raise NotImplementedError
