"""One fault of the matrix: how it is made and mended, what the operator has to be told, how long light may stay."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from config.cell import Cell
from config.device import Device, load_device

TICK_S = 0.03
"""From cause to laser off at the plant, beyond what is waited for on the wires."""
IN_JOB = frozenset({"preparing", "depositing", "milling", "held", "resuming"})
STREAMING = frozenset({"depositing", "milling"})
MOVING = frozenset({*STREAMING, "jogging", "homing"})
EVERYWHERE = frozenset({*IN_JOB, "jogging", "homing"})
ACTIVE = IN_JOB - {"held"}


@dataclass(frozen=True)
class Row:
    """One fault.

    strike : fault texts of the simulated cell, or of the computer (host.py), at once; a text that begins with "+S " comes S seconds
        (wire time) later. mend : the same, for the repair
    codes : alarms of which one has to be told; words : or words of what the cell says of itself (empty: alarms alone)
    must : situations in which it has to be told (elsewhere the cell may go on if nothing is wrong)
    lit : signal whose bound (BOUNDS) light has to keep after the cause; "" if the cause forbids no light
    standing : the same for light at standstill
    is_gappy : whether lines may be missing at the machine, because it drops some and goes on
    cnc : changes of the cell file
    shared : changes of this row in a cell whose laser, feeder and I/O coupler share one line
    """

    name: str
    strike: tuple[str, ...]
    mend: tuple[str, ...] = ()
    codes: frozenset[str] = frozenset()
    words: tuple[str, ...] = ()
    must: frozenset[str] = frozenset()
    lit: str = ""
    standing: str = "request"
    is_gappy: bool = False
    cnc: tuple[tuple[str, object], ...] = ()
    shared: tuple[tuple[str, Any], ...] = ()

    def on(self, cell: Cell) -> Row:
        """This row as it is judged in a cell."""
        ports = {link.serial_port for link in cell.links.values() if link.transport == "rtu"}
        shares = len(cell.links) > 1 and len(ports) == 1 and all(link.transport == "rtu" for link in cell.links.values())
        return replace(self, **dict(self.shared)) if shares else self


def bound_s(signal: str, cell: Cell) -> float:
    """How long light may stay (s, wire time): 30 ms, one request, and the stale limit of the signal that was lost.

    request : its level is read, or the wire says so at once. status : told by the next status report, or by none
    laser : nobody can reach the laser, its own dead-man turns it off. Others: the device's shortest stale limit, and the request that was waited for
    """
    devices: dict[str, Device] = {role: load_device(link.device) for role, link in cell.links.items()}
    request_s = max(device.timeout_s for device in devices.values())
    if signal == "request":
        return TICK_S + request_s
    if signal == "report":
        return TICK_S + request_s + cell.cnc.status_period_s
    if signal == "status":
        return TICK_S + request_s + cell.limits.status_stale_s
    if signal == "laser":
        return TICK_S + request_s + devices["laser"].dead_man_s
    device = devices[signal]
    stale_s = {name: register.stale_s for name, register in device.registers.items() if register.stale_s is not None}
    chosen = {"io": ("estop_ok", "door_closed"), "feeder": ("fault_word",)}[signal]
    return TICK_S + request_s + max(stale_s[name] for name in chosen)
