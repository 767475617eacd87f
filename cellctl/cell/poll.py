"""One task per Modbus line: cycles its devices in turn, at once when a set-point changes, otherwise at their poll period."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import structlog

from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.interfaces import Clock
from drivers.modbus.device import DeviceClient

log = structlog.get_logger()

LEAST_PAUSE_S = 0.001  # between two rounds of a line that is slower than its period


class Cycled(Protocol):
    """A device that is read and written in cycles."""

    client: DeviceClient

    async def cycle(self) -> None:
        """Write what changed and the heartbeat, read everything."""


def lines_of(cell: Cell, drivers: CellDrivers) -> list[list[Cycled]]:
    """Devices grouped by the line that they share: an RTU port, or a TCP connection of their own."""
    groups: dict[str, list[Cycled]] = {}
    devices: dict[str, Cycled] = {"laser": drivers.laser, "io": drivers.io, "feeder": drivers.feeder}
    for name, device in devices.items():
        link = next(link for role, link in cell.links.items() if role == name)
        key = f"rtu {link.serial_port}" if link.transport == "rtu" else f"tcp {name}"
        groups.setdefault(key, []).append(device)
    return list(groups.values())


async def poll_line(
    devices: Sequence[Cycled], clock: Clock, is_ticking: Callable[[], bool], on_failure: Callable[[str], None]
) -> None:
    """Cycle the devices of one line for ever. A set-point that changed is written as soon as the request on the wire has ended.

    is_ticking : whether the safety tick beats; without it no heartbeat is sent and the devices' dead-man timers run out.
    on_failure : told in one line what nobody foresaw; the line is polled on.
    """
    period = min(device.client.device.poll_s for device in devices)
    turn = devices[0].client.turn
    for device in devices:
        device.client.share(turn)
    while True:
        started = clock.now()
        for device in devices:
            device.client.is_beating = is_ticking()
            if not device.client.is_beating:
                device.client.safe()
            try:
                await device.cycle()
            except Exception as error:
                log.exception("poll failed", device=device.client.device.name)
                on_failure(f"{device.client.device.name}: {type(error).__name__}: {error}")
        is_hurried = any(device.client.is_waiting for device in devices)
        await turn.pause(LEAST_PAUSE_S if is_hurried else max(period - (clock.now() - started), LEAST_PAUSE_S))
