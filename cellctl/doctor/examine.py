"""The order in which a cell is looked over."""

from __future__ import annotations

import asyncio
import getpass
import hashlib
import time
from pathlib import Path

from cellctl.doctor.cnc import QuietCnc, examine_cnc
from cellctl.doctor.dead_man import examine_dead_men
from cellctl.doctor.hands import ask_for_contacts
from cellctl.doctor.jogs import jog_axes
from cellctl.doctor.modbus import Wired, examine_device, lines_of
from cellctl.doctor.options import DoctorError, Options
from cellctl.doctor.ports import WHY_NOT, list_serial_ports, probe_ports
from cellctl.doctor.report import Report
from cellctl.supervise import cell_process_at
from config import Cell, load_cell, load_device
from config.base import find_facts
from drivers import open_devices
from drivers.clock import SystemClock
from drivers.cnc.driver import STANDING
from drivers.cnc.events import Status
from drivers.errors import DriverError, PortBusy
from drivers.interfaces import BytePort, Clock
from drivers.modbus.line_budget import complaints
from drivers.transport.port_name import port_path
from drivers.transport.serial_port import SerialPort


def examine_cell(name: str, run_dir: Path, options: Options | None = None) -> Report:
    """Look at a cell. Raises ConfigError, and DoctorError while a cell process or another program holds the wires."""
    cell = load_cell(name)
    if cell_process_at(run_dir / "cell.sock") is not None:
        raise DoctorError(
            f"{run_dir}: the service is running and holds the wires",
            "stop `cellctl serve` first, or look at its console",
        )
    path = find_facts("cells", name)
    chosen = options or Options()
    report = Report(
        cell.name, cell.mode, str(path), hashlib.sha256(path.read_bytes()).hexdigest(), cell.sha256, chosen.who or getpass.getuser(), time.time()
    )
    asyncio.run(_examine(cell, run_dir, chosen, report))
    return report


async def _examine(cell: Cell, run_dir: Path, options: Options, report: Report) -> None:
    clock = SystemClock()
    paths = list_serial_ports(cell, report)
    port = _open_cnc_port(cell, run_dir, report)
    try:
        cnc = None if port is None else QuietCnc(port, cell.letters, clock)
        status = None if cnc is None else await examine_cnc(cnc, cell, clock, options.status_queries, report)
        await _look_elsewhere(paths, cell, run_dir, options, clock, report)
        await _examine_devices(cell, run_dir, options, clock, status, report)
        if options.may_move and cnc is not None and status is not None:
            await jog_axes(cnc, cell, options, clock, report)
        else:
            report.skip("Axes", "direction and distance of each axis", "nothing moves without --may-move and a CNC that answers")
    finally:
        if port is not None:
            port.close()


def _open_cnc_port(cell: Cell, run_dir: Path, report: Report) -> BytePort | None:
    """The CNC's port, held to the end, so that nobody else starts meanwhile. Raises DoctorError if another program has it."""
    try:
        return SerialPort(port_path(cell.cnc.port, run_dir), cell.cnc.baud)
    except PortBusy as error:
        raise DoctorError(f"{error.message}: nothing was asked", error.hint) from None
    except DriverError as error:
        report.fault("CNC", f"port {cell.cnc.port}", error)
        report.skip("CNC", "firmware, settings, work offset", "the port is not open")
        return None


async def _look_elsewhere(paths: list[str], cell: Cell, run_dir: Path, options: Options, clock: Clock, report: Report) -> None:
    if not options.probe_ports:
        report.skip("Serial ports", "who answers at other ports", WHY_NOT)
        return
    named = [cell.cnc.port, *(link.serial_port for link in cell.links.values() if link.serial_port)]
    await probe_ports(paths, {str(Path(port_path(name, run_dir)).resolve()) for name in named}, clock, report)


async def _examine_devices(cell: Cell, run_dir: Path, options: Options, clock: Clock, status: Status | None, report: Report) -> None:
    devices = {role: load_device(facts.device) for role, facts in cell.links.items()}
    _clients, links = open_devices(cell, run_dir, clock)
    by_line = lines_of(cell, links)
    wired = {role: Wired(role, devices[role], facts.device_id, by_line[role]) for role, facts in cell.links.items()}
    for text in complaints(cell, devices):
        report.add("Modbus lines", "requests fit on the line", "FAULT", text)
    try:
        values = {str(role): await examine_device(each, cell, clock, options.requests, report) for role, each in wired.items()}
        answering = {str(role): each for role, each in wired.items() if values[role]}
        is_standing = status is not None and status.state in STANDING
        await examine_dead_men(answering, cell, options, clock, is_standing, report)
        await ask_for_contacts(answering, options, clock, report)
    finally:
        for link in links:
            await link.close()
