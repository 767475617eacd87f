"""Whether one Modbus line reads everything often enough, and whether its dead-men outlast a lost answer: requests, and their time on the wire."""

from __future__ import annotations

from collections.abc import Mapping

from config.cell import Cell, Link
from config.device import Device, Role
from drivers.modbus.beats import LOST_TIMEOUTS, Beats
from drivers.modbus.client import BITS_PER_CHARACTER, FRAME_GAP_CHARACTERS, FRAME_GAP_MIN_S
from drivers.modbus.registers import Span, spans

READ_CHARACTERS = 13  # question 8, answer 5 and its data (Modbus over serial line 1.02, 2.5.1)
WRITE_CHARACTERS = 8 + 8 + 5  # question and answer, and the data of the longest set-point
SET_POINTS = 2  # writes that one round may carry besides heartbeats: a gate and a level


def read_s(span: Span, device: Device, link: Link) -> float:
    """Time that one reading takes by the register map's and the cell file's word (s)."""
    data = (span.count + 7) // 8 if span.table in ("coil", "discrete") else 2 * span.count
    return device.latency_s + _characters_s(READ_CHARACTERS + data, link)


def write_s(device: Device, link: Link) -> float:
    """The same of one write."""
    return device.latency_s + _characters_s(WRITE_CHARACTERS, link)


def worst_ages_s(devices: Mapping[Role, Device], links: Mapping[Role, Link]) -> dict[tuple[Role, Span], float]:
    """Age (s) that readings of each span reach at worst, by role, on a line that these devices share.

    A round: every span once, contacts of an I/O coupler once more in between, the heartbeats that come due meanwhile, and SET_POINTS.
    """
    reads = {
        (role, span): read_s(span, device, links[role])
        for role, device in devices.items()
        for span in spans(device.registers, [name for name, each in device.registers.items() if not each.writable])
    }
    writes = [write_s(device, links[role]) for role, device in devices.items()]
    round_s = sum(reads.values()) + sum(writes) + SET_POINTS * max(writes)
    if len(devices) > 1:
        round_s += sum(taken for (role, span), taken in reads.items() if devices[role].role == "io" and span.table == "discrete")
    is_shared = len(devices) > 1
    more = {role: int(round_s / Beats(device).period_s(is_shared=is_shared)) for role, device in devices.items()}
    round_s += sum(count * write_s(devices[role], links[role]) for role, count in more.items())
    return {which: round_s + taken for which, taken in reads.items()}


def dead_man_needs_s(role: Role, devices: Mapping[Role, Device], links: Mapping[Role, Link]) -> float:
    """Least dead-man (s) of one device on a line that outlasts an answer that is lost there, of whichever device: by role as above.

    The heartbeat before it is a period old, and one request; on RTU the lost one is waited out as well.
    """
    is_shared = len(devices) > 1
    longest_s = max(write_s(device, links[each]) for each, device in devices.items())
    lost_s = max(device.timeout_s for device in devices.values()) * (LOST_TIMEOUTS if links[role].transport == "rtu" else 1.0)
    return Beats(devices[role]).period_s(is_shared=is_shared) + longest_s + lost_s + write_s(devices[role], links[role])


def complaints(cell: Cell, devices: Mapping[Role, Device]) -> list[str]:
    """One line for each line of the cell that cannot keep a stale limit, or else a dead-man, with what to do; none when all can. devices : by role"""
    found = []
    for key, roles in lines_of_roles(cell).items():
        there, links = {role: devices[role] for role in roles}, {role: cell.links[role] for role in roles}
        ages = worst_ages_s(there, links)
        late = [
            (age - devices[role].registers[name].stale_s, age, role, name)
            for (role, span), age in ages.items()
            for name in span.names
            if age > devices[role].registers[name].stale_s
        ]
        if late:
            _, age, role, name = max(late)
            limit_ms = 1e3 * devices[role].registers[name].stale_s
            remedy = "raise baud, or give the device a line of its own" if len(roles) > 1 else "the device is too slow for it"
            found.append(
                f"{key}: {role} {name} may be {1e3 * age:.0f} ms old between two readings, its stale_s is {limit_ms:.0f} ms; "
                f"{remedy}, or raise stale_s in its register map"
            )
        else:
            found += [
                f"{key}: one lost answer costs the dead-man of {role}: it needs {need_s:.2f} s, its dead_man_s is {devices[role].dead_man_s:g} s; "
                "set it longer at the device and in its register map, or give the device a line of its own"
                for role in roles
                if (need_s := dead_man_needs_s(role, there, links)) > devices[role].dead_man_s
            ]
    return found


def lines_of_roles(cell: Cell) -> dict[str, list[Role]]:
    """Roles on each line, by the line's name: an RTU port, or a TCP connection of one device."""
    groups: dict[str, list[Role]] = {}
    for role, link in cell.links.items():
        key = f"RTU line {link.serial_port} at {link.baud} baud" if link.transport == "rtu" else f"TCP {link.host}:{link.tcp_port}"
        groups.setdefault(key if link.transport == "rtu" else f"{role} at {key}", []).append(role)
    return groups


def _characters_s(count: int, link: Link) -> float:
    """Characters of question and answer and the silences around them; nothing on TCP."""
    if link.transport != "rtu":
        return 0.0
    gap_s = max(FRAME_GAP_MIN_S, FRAME_GAP_CHARACTERS * BITS_PER_CHARACTER / link.baud)
    return count * BITS_PER_CHARACTER / link.baud + 2.0 * gap_s
