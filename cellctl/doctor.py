"""`cellctl doctor`: identifies the CNC and reads every register of every device. It writes no register and sends no motion."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median

from cellctl.supervise import cell_process_at
from config import Cell, Device, load_cell, load_device
from drivers import open_cnc, open_devices
from drivers.clock import SystemClock
from drivers.errors import DriverError
from drivers.interfaces import ModbusLink
from drivers.modbus.line_budget import complaints
from drivers.modbus.registers import decode, meanings, spans

REQUESTS = 20  # read to learn how long one takes
SAFE_SHARE = 0.7  # of the time-out: a request that comes nearer will miss it one day
REQUESTS_BETWEEN = 6  # that may come between two readings of one register while set-points are written


class DoctorError(Exception):
    """The cell cannot be examined now. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


@dataclass(frozen=True)
class Row:
    """One thing that was looked at. found : the value with its unit, or the fault with what to do"""

    ok: bool
    what: str
    found: str


@dataclass
class Report:
    """Everything that was looked at."""

    cell: str
    mode: str
    rows: list[Row] = field(default_factory=list)

    @property
    def is_well(self) -> bool:
        """Whether everything answered as the cell file says."""
        return all(row.ok for row in self.rows)

    def document(self) -> dict[str, object]:
        """For programs."""
        return {"cell": self.cell, "mode": self.mode, "ok": self.is_well, "rows": [asdict(row) for row in self.rows]}

    def fault(self, what: str, error: DriverError) -> None:
        """Note what is wrong, and what to do."""
        self.rows.append(Row(False, what, error.message + (f"; {error.hint}" if error.hint else "")))


def examine_cell(name: str, run_dir: Path) -> Report:
    """Look at a cell. Raises ConfigError, and DoctorError while a cell process holds the wires."""
    cell = load_cell(name)
    if cell_process_at(run_dir / "cell.sock") is not None:
        raise DoctorError(
            f"{run_dir}: the service is running and holds the wires",
            "stop `cellctl serve` first, or look at its console",
        )
    return asyncio.run(_examine(cell, run_dir))


async def _examine(cell: Cell, run_dir: Path) -> Report:
    report = Report(cell.name, cell.mode)
    await _examine_cnc(cell, run_dir, report)
    _clients, links = open_devices(cell, run_dir, SystemClock())
    by_line = _lines_of(cell, links)
    report.rows += [Row(False, "line", text) for text in complaints(cell, {role: load_device(facts.device) for role, facts in cell.links.items()})]
    try:
        for role, facts in cell.links.items():
            await _examine_device(role, load_device(facts.device), facts.device_id, by_line[role], report)
    finally:
        for link in links:
            await link.close()
    return report


def _lines_of(cell: Cell, links: tuple[ModbusLink, ...]) -> Mapping[str, ModbusLink]:
    """The line of each device: devices of one serial port share theirs, in the order in which `open_devices` makes them."""
    keys = [facts.serial_port if facts.transport == "rtu" else role for role, facts in cell.links.items()]
    order = list(dict.fromkeys(keys))
    return {role: links[order.index(key)] for role, key in zip(cell.links, keys, strict=True)}


async def _examine_cnc(cell: Cell, run_dir: Path, report: Report) -> None:
    what = f"CNC at {cell.cnc.port}"
    try:
        cnc = open_cnc(cell, run_dir, SystemClock())
    except DriverError as error:
        report.fault(what, error)
        return
    try:
        seen = await cnc.identify()
        report.rows.append(Row(True, what, f"{seen.firmware} {seen.version}, axes {' '.join(seen.letters)}"))
        report.rows.append(Row(True, f"{what}: buffers", f"{seen.rx_bytes} bytes, {seen.planner_blocks} blocks"))
        if cnc.status is not None:
            report.rows.append(Row(True, f"{what}: state", cnc.status.state))
        offsets = await cnc.work_offset()
        wanted = cell.placement.work_offset
        differ = [letter for letter, value in wanted.items() if abs(offsets.get(letter, 0.0) - value) > 1e-3]
        text = ", ".join(f"{letter} {value:g}" for letter, value in offsets.items())
        report.rows.append(
            Row(
                not differ,
                f"{what}: work offset",
                text + (f"; the cell file differs in {', '.join(differ)}" if differ else ""),
            )
        )
    except DriverError as error:
        report.fault(what, error)
    finally:
        cnc.close()


async def _examine_latency(role: str, device: Device, device_id: int, line: ModbusLink, report: Report) -> None:
    """How long a request takes, by reading alone; what the device does with a write is learnt while the cell runs."""
    span = min(spans(device.registers, [name for name, each in device.registers.items() if not each.writable]), key=lambda s: s.count)
    clock, taken = SystemClock(), []
    try:
        for _ in range(REQUESTS):
            began = clock.now()
            await line.read(device_id, span.table, span.address, span.count)
            taken.append(clock.now() - began)
    except DriverError as error:
        report.fault(f"{role}: request time", error)
        return
    middle_ms, longest_ms, said_ms = 1e3 * median(taken), 1e3 * max(taken), 1e3 * device.latency_s
    is_quick = max(taken) < SAFE_SHARE * device.timeout_s
    readings = [each.stale_s for each in device.registers.values() if not each.writable]
    is_fresh = median(taken) * REQUESTS_BETWEEN < min(readings, default=math.inf)
    text = f"{middle_ms:.1f} ms, longest of {REQUESTS}: {longest_ms:.1f} ms; the register map begins with latency_s = {said_ms:g} ms"
    text += "" if is_quick else f"; too near to timeout_s = {1e3 * device.timeout_s:g} ms"
    text += "" if is_fresh else f"; readings would grow stale between two writes: stale_s has to be above {REQUESTS_BETWEEN * middle_ms:.0f} ms"
    report.rows.append(Row(is_quick and is_fresh, f"{role}: request time", text))


async def _examine_device(role: str, device: Device, device_id: int, line: ModbusLink, report: Report) -> None:
    """Read every register of one device, in the fewest requests."""
    try:
        if not line.connected:
            await line.connect()
    except DriverError as error:
        report.fault(role, error)
        return
    await _examine_latency(role, device, device_id, line, report)
    for span in spans(device.registers, device.registers):
        try:
            words = await line.read(device_id, span.table, span.address, span.count)
        except DriverError as error:
            report.fault(f"{role}: {span.table} {span.address}..{span.address + span.count - 1}", error)
            continue
        for name in span.names:
            register = device.registers[name]
            start = register.address - span.address
            value = decode(register, words[start : start + register.count])
            flags = meanings(name, register, value) if register.bits else []
            shown = ", ".join(flags) or f"{value:g} {register.unit}".strip()
            report.rows.append(Row(not flags, f"{role}: {name}", shown))
