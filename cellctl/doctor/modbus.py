"""The Modbus devices of a cell: whether they answer, how long a request takes, and every register of their maps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cellctl.doctor.figures import times_text
from cellctl.doctor.registers import examine_registers
from cellctl.doctor.report import Report
from config.cell import Cell
from config.device import Device, Register
from drivers.errors import DeviceFault, DriverError
from drivers.interfaces import Clock, ModbusLink
from drivers.modbus.registers import decode, encode, spans

SAFE_SHARE = 0.7  # of the time-out: a request that comes nearer will miss it one day
REQUESTS_BETWEEN = 6  # that may come between two readings of one register while set-points are written
BEATS_LOST = 2  # heartbeats in a row that a dead-man has to outlast
BEAT_SHARE = 0.2  # of the dead-man's time between two heartbeats
LOST_MAX = 3  # requests without an answer, after which timing ends


@dataclass(frozen=True)
class Wired:
    """One device at its line."""

    role: str
    device: Device
    device_id: int
    line: ModbusLink

    async def read(self, name: str) -> float:
        """One register's value in its unit. Raises DriverError."""
        register = self.device.registers[name]
        return decode(register, await self.line.read(self.device_id, register.table, register.address, register.count))

    async def write(self, name: str, value: float) -> None:
        """Write one register. Raises DriverError."""
        register = self.device.registers[name]
        await self.line.write(self.device_id, register.table, register.address, encode(register, value))

    def register(self, name: str) -> Register | None:
        """Of the map, None if it has none of this name."""
        return self.device.registers.get(name)


def lines_of(cell: Cell, links: tuple[ModbusLink, ...]) -> Mapping[str, ModbusLink]:
    """The line of each device: devices of one serial port share theirs, in the order in which `open_devices` makes them."""
    keys = [facts.serial_port if facts.transport == "rtu" else role for role, facts in cell.links.items()]
    order = list(dict.fromkeys(keys))
    return {role: links[order.index(key)] for role, key in zip(cell.links, keys, strict=True)}


async def examine_device(wired: Wired, cell: Cell, clock: Clock, requests: int, report: Report) -> dict[str, float]:
    """Whether it answers, its request times, its registers; what was read, by name (empty if it does not answer)."""
    section = wired.role.capitalize()
    what = f"{wired.device.name} at {wired.line.name} id {wired.device_id}"
    try:
        if not wired.line.connected:
            await wired.line.connect()
    except DriverError as error:
        report.fault(section, what, error)
        report.skip(section, "registers, request time", "the device is not reached")
        return {}
    if not await _time_requests(wired, clock, requests, section, what, report):
        report.skip(section, "registers", "the device does not answer")
        return {}
    return await examine_registers(wired.role, wired.device, wired.device_id, wired.line, cell, report)


async def _time_requests(wired: Wired, clock: Clock, requests: int, section: str, what: str, report: Report) -> bool:
    """How long a request takes, by reading alone; whether the device answers at all."""
    device = wired.device
    reads = [name for name, each in device.registers.items() if not each.writable]
    span = min(spans(device.registers, reads), key=lambda s: s.count)
    taken: list[float] = []
    lost: list[DriverError] = []
    for _ in range(requests):
        began = clock.now()
        try:
            await wired.line.read(wired.device_id, span.table, span.address, span.count)
        except DeviceFault as error:  # it answered: the registers tell what is wrong with the map
            lost.append(error)
            break
        except DriverError as error:
            lost.append(error)
            if len(lost) >= LOST_MAX:
                break
            continue
        taken.append(clock.now() - began)
    if not taken:
        report.fault(section, what, lost[0])
        return isinstance(lost[0], DeviceFault)
    report.add(section, what, "ok", "answers")
    _judge_times(device, taken, len(lost), section, report)
    return True


def _judge_times(device: Device, taken: list[float], lost: int, section: str, report: Report) -> None:
    middle_s, late_s, text = times_text(taken)
    limit_s = SAFE_SHARE * device.timeout_s
    report.judge(
        section, "request time", late_s <= limit_s and not lost, text + (f"; {lost} without answer" if lost else ""),
        f"{1e3 * limit_s:.0f} ms ({SAFE_SHARE:g} of timeout_s = {device.timeout_s:g})",
        "too near to the time-out: look at the line and the device, or give timeout_s more, and dead_man_s with it",
    )  # fmt: skip
    stale_s = min((each.stale_s for each in device.registers.values() if not each.writable), default=math.inf)
    report.judge(
        section, "readings stay fresh", REQUESTS_BETWEEN * middle_s < stale_s,
        f"{REQUESTS_BETWEEN} requests take {1e3 * REQUESTS_BETWEEN * middle_s:.0f} ms",
        f"stale_s = {stale_s:g} s", "readings would grow stale between two writes: a quicker line, or a longer stale_s",
    )  # fmt: skip
    needs_s = (1 + BEATS_LOST) * BEAT_SHARE * device.dead_man_s + late_s
    report.judge(
        section, "heartbeats in time", needs_s < device.dead_man_s, f"{BEATS_LOST} lost ones and a late one take {1e3 * needs_s:.0f} ms",
        f"dead_man_s = {device.dead_man_s:g} s", "the dead-man would trip by itself: a quicker line, or a longer dead_man_s in device and map",
    )  # fmt: skip
