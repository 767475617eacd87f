"""Opens the wires of a cell as its cell file says."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from config.base import ConfigError
from config.cell import Cell, Link
from config.device import Device, Role, load_device
from drivers.cnc.driver import CncDriver
from drivers.feeder import Feeder
from drivers.interfaces import Clock, ModbusLink
from drivers.interlocks import Io
from drivers.laser import Laser
from drivers.modbus.client import PymodbusLink
from drivers.modbus.device import DeviceClient
from drivers.modbus.turn import Turn
from drivers.transport.port_name import port_path
from drivers.transport.serial_port import SerialPort


@dataclass
class CellDrivers:
    """All drivers of one cell; links has one entry per Modbus line."""

    cnc: CncDriver
    laser: Laser
    feeder: Feeder
    io: Io
    links: tuple[ModbusLink, ...]

    async def close(self) -> None:
        """Give every wire back."""
        async with contextlib.AsyncExitStack() as stack:
            for link in self.links:
                stack.push_async_callback(link.close)
            stack.callback(self.cnc.close)


def clients_of(drivers: CellDrivers) -> dict[Role, DeviceClient]:
    """The Modbus devices by role."""
    return {"laser": drivers.laser.client, "feeder": drivers.feeder.client, "io": drivers.io.client}


def open_cnc(cell: Cell, run_dir: Path, clock: Clock) -> CncDriver:
    """Open the CNC's serial port (relative: in run_dir). Raises PortAbsent, PortDenied, PortBusy."""
    return CncDriver(SerialPort(port_path(cell.cnc.port, run_dir), cell.cnc.baud), cell.cnc, cell.letters, clock)


def open_devices(cell: Cell, run_dir: Path, clock: Clock) -> tuple[dict[str, DeviceClient], tuple[ModbusLink, ...]]:
    """Clients of all Modbus devices by role, and their lines, which open at the first cycle. Raises ConfigError.

    Devices with the same serial_port share one line, TCP devices have one connection each.
    """
    devices: dict[str, Device] = {role: load_device(link.device) for role, link in cell.links.items()}
    lines: dict[str, PymodbusLink] = {}
    turns: dict[str, Turn] = {}
    clients: dict[str, DeviceClient] = {}
    for role, facts in cell.links.items():
        key = facts.serial_port if facts.transport == "rtu" else f"{role} {facts.host}:{facts.tcp_port}"
        if key not in lines:
            sharing = [other for other, link in cell.links.items() if link.transport == "rtu" and link.serial_port == key]
            _check_line(key, [cell.links[other] for other in sharing])
            timeout_s = max(devices[other].timeout_s for other in (sharing or [role]))
            lines[key], turns[key] = PymodbusLink(facts, timeout_s, clock, run_dir), Turn(clock)
        line = lines[key]
        clients[role] = DeviceClient(devices[role], facts.device_id, line, clock, turn=turns[key], answer_line_s=line.write_answer_s)
    return clients, tuple(lines.values())


def open_cell(cell: Cell, run_dir: Path, clock: Clock) -> CellDrivers:
    """Open the CNC's port; Modbus lines open at the first cycle of a device and again by themselves.

    Raises PortAbsent, PortDenied or PortBusy for the CNC's port, ConfigError for a register map.
    """
    clients, links = open_devices(cell, run_dir, clock)
    cnc = open_cnc(cell, run_dir, clock)
    return CellDrivers(cnc, Laser(clients["laser"]), Feeder(clients["feeder"]), Io(clients["io"]), links)


def _check_line(port: str, sharing: list[Link]) -> None:
    """Raise ConfigError unless the devices on one serial line agree on its settings and differ in their ids."""
    if len({(link.baud, link.parity) for link in sharing}) > 1:
        raise ConfigError(f"links: devices on serial line {port} differ in baud or parity", "give all devices of one line the same")
    if len({link.device_id for link in sharing}) != len(sharing):
        raise ConfigError(f"links: a device_id stands twice on serial line {port}", "give each device of one line its own id")
