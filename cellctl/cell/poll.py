"""One task per Modbus line: cycles its devices in turn, at once when a set-point changes, otherwise at their poll period."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol

import structlog

from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.interfaces import Clock
from drivers.modbus.device import DeviceClient

log = structlog.get_logger()


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
    """Cycle the devices of one line for ever. A set-point that changed is written in the next turn of the event loop.

    is_ticking : whether the safety tick beats; without it no heartbeat is sent and the devices' dead-man timers run out.
    on_failure : told in one line what nobody foresaw; the line is polled on.
    """
    period = min(device.client.device.poll_s for device in devices)
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
        pause = max(period - (clock.now() - started), 0.001)
        if not any(device.client.wake.is_set() for device in devices):
            await _wake_or_pause([device.client.wake for device in devices], clock, pause)


async def _wake_or_pause(wakes: Sequence[asyncio.Event], clock: Clock, pause_s: float) -> None:
    loop = asyncio.get_running_loop()
    tasks = [loop.create_task(clock.sleep(pause_s)), *(loop.create_task(_wait(wake)) for wake in wakes)]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _wait(wake: asyncio.Event) -> None:
    await wake.wait()
