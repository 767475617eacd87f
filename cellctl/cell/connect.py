"""Keeps the wires there: opens them, identifies the CNC, tries again every second, and says in one line what is missing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import structlog

from cellctl.cell.controller import Controller
from cellctl.cell.poll import lines_of, poll_line
from config.base import ConfigError
from config.cell import Cell
from drivers import open_cell, open_cnc
from drivers.cell_wires import CellDrivers, clients_of
from drivers.cnc.driver import CncDriver
from drivers.errors import CommandRefused, DeviceFault, DeviceSilent, DriverError
from drivers.interfaces import Clock
from drivers.modbus.line_budget import complaints

RETRY_S = 1.0
TICKS_ALIVE = 20  # a tick silent for so many periods is dead; then the devices' dead-man timers have to run out

log = structlog.get_logger()


class Wires(Protocol):
    """Where drivers come from: real ports, or a simulated plant in memory."""

    def open(self) -> CellDrivers:
        """All drivers. Raises LinkError."""

    def reopen_cnc(self) -> CncDriver:
        """The CNC's port anew. Raises LinkError."""


class CellWires:
    """The wires that the cell file names."""

    def __init__(self, cell: Cell, run_dir: Path, clock: Clock) -> None:
        self._cell = cell
        self._run_dir = run_dir
        self._clock = clock

    def open(self) -> CellDrivers:
        """All drivers. Raises LinkError."""
        return open_cell(self._cell, self._run_dir, self._clock)

    def reopen_cnc(self) -> CncDriver:
        """The CNC's port anew. Raises LinkError."""
        return open_cnc(self._cell, self._run_dir, self._clock)


class Connection:
    """The tasks that hold the wires: one that connects, one per Modbus line."""

    def __init__(self, controller: Controller, wires: Wires, on_cnc: Callable[[CncDriver | None], None]) -> None:
        self._c = controller
        self._wires = wires
        self._on_cnc = on_cnc
        self._clock = controller.times.wire
        self._is_port_open = False
        self._tasks: list[asyncio.Task[None]] = []

    def start(self) -> None:
        """Begin to connect."""
        self._spawn(self._keep_connected())

    async def close(self) -> None:
        """End the tasks and give the wires back. Harmless twice."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks.clear()
        self._on_cnc(None)
        if self._c.drivers is not None:
            await self._c.drivers.close()

    def _spawn(self, work: object) -> None:
        self._tasks.append(asyncio.get_running_loop().create_task(work))  # type: ignore[arg-type]

    def _is_ticking(self) -> bool:
        return self._clock.now() - self._c.last_tick_at < TICKS_ALIVE * self._c.cell.limits.tick_s

    async def _keep_connected(self) -> None:
        while True:
            if not self._c.is_cnc_alive:
                try:
                    await self._connect()
                except DriverError as error:
                    self._is_port_open = self._is_port_open and isinstance(error, DeviceSilent)
                    self._say(f"{error.message}; {error.hint}" if error.hint else error.message)
                except ConfigError as error:
                    self._say(f"{error.message}; {error.hint}")
                except Exception as error:
                    log.exception("connecting failed")
                    self._is_port_open = False
                    self._fail(f"connecting: {type(error).__name__}: {error}")
            await self._clock.sleep(RETRY_S)

    async def _connect(self) -> None:
        c = self._c
        if c.drivers is None:
            drivers = self._wires.open()
            c.attach(drivers)
            for text in complaints(c.cell, {role: client.device for role, client in clients_of(drivers).items()}):
                c.event("device", text)
            for devices in lines_of(c.cell, drivers):
                self._spawn(poll_line(devices, self._clock, self._is_ticking, self._fail))
        elif not self._is_port_open:
            self._on_cnc(None)
            c.drivers.cnc.close()
            c.drivers.cnc = self._wires.reopen_cnc()
        assert c.drivers is not None
        self._is_port_open = True
        identity = await c.drivers.cnc.identify()
        await _read_settings(c.drivers.cnc)
        c.drivers.cnc.query_status()
        c.is_cnc_alive = True
        c.position.connected()
        c.cnc_line = ""
        self._on_cnc(c.drivers.cnc)
        text = f"{identity.firmware} {identity.version}, axes {''.join(identity.letters)}, {identity.rx_bytes} bytes of receive buffer"
        c.event("connected", text, {"firmware": identity.firmware, "rx_bytes": identity.rx_bytes})

    def _fail(self, line: str) -> None:
        self._c.fault("internal", line)

    def _say(self, line: str) -> None:
        if line != self._c.cnc_line:
            self._c.cnc_line = self._c.offline_line = line
            self._c.event("offline", line)
            log.warning("offline", line=line)


async def _read_settings(cnc: CncDriver) -> None:
    """How the control accelerates, for the follower; a control that refuses to tell is followed by the cell file. Raises LinkLost."""
    try:
        await cnc.settings()
    except (CommandRefused, DeviceFault) as error:
        log.info("settings", line=error.message)
