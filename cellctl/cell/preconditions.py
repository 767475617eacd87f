"""What has to hold before a job starts, goes on or a fault is reset; each refusal is one line with what to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cellctl.cell.cnc_checks import offset_differs
from cellctl.cell.refusal import READINESS, Refused
from cellctl.domain.interlocks import Signal, unsafe_interlocks
from cellctl.domain.reactions import INTERLOCK_CAUSE, REACTIONS
from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.modbus.device import DeviceClient
from planner.program import Channel, Program

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller


BOUNDS = {
    Channel.LASER_W: ("laser", "power_setpoint"),
    Channel.POWDER_G_MIN: ("feeder", "rate_setpoint"),
    Channel.CARRIER_GAS_L_MIN: ("feeder", "carrier_gas_setpoint"),
    Channel.SHIELD_GAS_L_MIN: ("feeder", "shield_gas_setpoint"),
}


def check_program(program: Program, cell: Cell, drivers: CellDrivers, held: dict[str, float]) -> None:
    """Whether a Program is for this cell as it stands. held : G54 that the controller has. Raises Refused."""
    if not program.lines:
        raise Refused("the program has no lines", "post the plan again")
    if program.cell_sha256 != cell.sha256:
        if program.cell_name == cell.name:
            line = f"the program was posted before the cell was changed or measured anew ({program.cell_sha256[:12]}, now {cell.sha256[:12]})"
            raise Refused(line, "post it again: POST /api/v1/jobs/{id}/post_again, then approve its new proof")
        raise Refused(
            f"the program was posted for cell {program.cell_name} ({program.cell_sha256[:12]}), this is {cell.name} ({cell.sha256[:12]})",
            "post the plan again for this cell",
        )
    gate = "stream" if cell.cnc.laser_gate_output is not None else "modbus"
    if program.gate != gate:
        raise Refused(
            f"the program gates the laser by {program.gate}, the cell by {gate}", "post the plan again for this cell"
        )
    wanted = dict(zip(program.axis_letters, map(float, program.work_offset), strict=True))
    wrong = offset_differs(held, wanted)
    if wrong:
        raise Refused(
            f"the controller's work offset is not the program's: {wrong}",
            "set G54, or measure the placement and post again",
        )
    clients = {"laser": drivers.laser.client, "feeder": drivers.feeder.client}
    for channel, (device, name) in BOUNDS.items():
        values = program.schedule["value"][program.schedule["channel"] == channel]
        register = clients[device].device.registers[name]
        if len(values) and register.max is not None and float(np.max(values)) > register.max:
            raise Refused(
                f"the program asks {device}.{name} for {float(np.max(values)):g} {register.unit}, its limit is {register.max:g}",
                "lower it in the recipe and plan again",
            )


def check_cnc(drivers: CellDrivers) -> None:
    """Whether the machine stands and waits. Raises Refused."""
    status = drivers.cnc.status
    if status is None or not status.is_idle:
        raise Refused(
            f"the CNC is {status.state if status else 'silent'}, not Idle",
            "wait until it stands, home it if it is locked",
            READINESS,
        )


def check_devices(drivers: CellDrivers, *, for_job: bool = True) -> None:
    """Whether interlocks are safe (for_job: all of them and both devices ready; otherwise E-stop and door). Raises Refused."""
    levels = {name: signal_of(drivers.io.client, name) for name in INTERLOCK_CAUSE}
    for name, why in unsafe_interlocks(levels):
        if for_job or name in ("estop_ok", "door_closed"):
            raise Refused(why, REACTIONS[INTERLOCK_CAUSE[name]].remedy, READINESS)
    if not for_job:
        return
    for name, device in (("laser", drivers.laser), ("powder feeder", drivers.feeder)):
        if device.client.is_stale("fault_word"):
            raise Refused(f"the {name} does not answer", "look at its power and cable", READINESS)
        if device.faults:
            raise Refused(
                f"the {name} reports: {'; '.join(device.faults)}",
                "remove the cause at the device; `reset` clears what it has latched",
                READINESS,
            )
    if drivers.io.faults:
        raise Refused(f"the I/O coupler is not to be trusted: {'; '.join(drivers.io.faults)}", "look at the coupler and its outputs", READINESS)


def signal_of(client: DeviceClient, name: str) -> Signal:
    """A register's level with its age and stale limit."""
    return Signal(client.value(name), client.age(name), client.device.registers[name].stale_s)


def still_there(code: str, c: Controller) -> str:
    """Why a latched cause is still there, as far as levels show it; empty when it is gone or has to be tried."""
    if code == "store":
        return c.journal.failure
    drivers = c.drivers
    if drivers is None:
        return ""
    level = next((name for name, cause in INTERLOCK_CAUSE.items() if cause == code), None)
    if level is not None:
        signal = signal_of(drivers.io.client, level)
        return REACTIONS[code].cause if signal.is_fresh and not signal.value else ""
    silent = {
        "laser_silent": drivers.laser.client,
        "feeder_silent": drivers.feeder.client,
        "io_silent": drivers.io.client,
    }
    if code == "io_fault":
        return "; ".join(drivers.io.faults)
    if code == "power":
        return next((why for name in silent if (why := still_there(name, c))), "")
    client = silent.get(code)
    if client is not None and any(
        client.is_stale(name) for name in ("fault_word", "door_closed") if name in client.device.registers
    ):
        return client.last_error.message if client.last_error is not None else "it still does not answer"
    return ""
