"""Opens the far ends of all wires of a cell and writes the cell file that says where they are."""

from __future__ import annotations

import asyncio
import contextlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import tomli_w

from config import Cell, Device, Link, load_device
from sim.cnc.serial import BITS_PER_BYTE, CncSerial
from sim.modbus.registers import RegisterBank
from sim.modbus.rtu import BITS_PER_CHARACTER, RtuLine
from sim.modbus.tcp import TcpDevice
from sim.modbus.wire import Wire
from sim.pseudo_terminal import TerminalError
from sim.world import World

CELL_FILE_MODE = 0o644
BAUD_MAX = 4_000_000  # the cell file's bound


class WireError(Exception):
    """A wire that cannot be opened. `message` is one line, `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class Wires:
    """All wires of one simulated cell. `open` in a running event loop, `close` leaves nothing behind."""

    def __init__(self, world: World, cell: Cell, run_dir: Path, clock: Callable[[], float], at_baud: bool) -> None:
        self._world, self._cell, self._run_dir, self._clock = world, cell, run_dir, clock
        self._at_baud = at_baud
        self._serial: CncSerial | None = None
        self._lines: list[RtuLine] = []
        self._devices: list[TcpDevice] = []
        self._links: dict[str, Link] = {}
        self._port = cell.cnc.port
        # a machine that runs S times as fast takes S times the lines: so its line is S times as fast, and the cell file says so
        self._baud = min(round(cell.cnc.baud * max(world.time_scale, 1.0)), BAUD_MAX)

    def _path(self, port: str) -> Path:
        return Path(os.path.abspath(self._run_dir / port))

    async def open(self) -> Cell:
        """Open everything; returns the cell with the real ports and the serial line's speed at this time scale.

        Raises WireError when a name or a port is taken; then nothing stays open.
        """
        async with contextlib.AsyncExitStack() as undo:
            undo.push_async_callback(self.close)
            try:
                self._open_serial()
                self._open_lines()
            except TerminalError as error:
                raise WireError(error.message, error.hint) from None
            await self._open_sockets()
            undo.pop_all()
        cnc = self._cell.cnc.model_copy(update={"port": self._port, "baud": self._baud})
        return self._cell.model_copy(update={"cnc": cnc, "links": self._links})

    def _open_serial(self) -> None:
        cnc = self._cell.cnc
        pace = self._baud / BITS_PER_BYTE if self._at_baud else None
        path = self._path(cnc.port)
        self._serial = CncSerial(self._world.cnc, self._world.plug, path, pace)
        self._port = str(path)

    def _open_lines(self) -> None:
        shared: dict[str, dict[int, tuple[RegisterBank, Wire]]] = {}
        speed: dict[str, int] = {}
        for role, link in self._cell.links.items():
            if link.transport != "rtu":
                continue
            path = str(self._path(link.serial_port))
            devices = shared.setdefault(path, {})
            if link.device_id in devices:
                raise WireError(
                    f"links.{role}: device_id {link.device_id} stands twice on {link.serial_port}",
                    "give each device its own id",
                )
            devices[link.device_id] = self._world.banks[role], self._world.wires[role]
            speed[path] = link.baud
            self._links[role] = link.model_copy(update={"serial_port": path, "device": _absolute(link.device)})
        for path, devices in shared.items():
            character_s = BITS_PER_CHARACTER / speed[path] if self._at_baud else 0.0
            self._lines.append(RtuLine(Path(path), devices, self._clock, character_s))

    async def _open_sockets(self) -> None:
        for role, link in self._cell.links.items():
            if link.transport != "tcp":
                continue
            device = TcpDevice(self._world.banks[role], self._world.wires[role], link.device_id)
            try:
                port = await device.listen(link.host, link.tcp_port)
            except OSError as error:
                raise WireError(
                    f"links.{role}: {link.host}:{link.tcp_port} cannot be opened: {error.strerror or error}",
                    "end the program that has it, or set tcp_port = 0 for any free one",
                ) from None
            self._devices.append(device)
            self._links[role] = link.model_copy(update={"tcp_port": port, "device": _absolute(link.device)})

    async def tend(self) -> None:
        """Take away what is unplugged or gone, bring back what is there again."""
        if self._serial is not None:
            self._serial.tend()
        for line in self._lines:
            line.tend()
        for device in self._devices:
            await device.tend()

    def pace(self, wire_dt_s: float) -> None:
        """Let the wire's time go by and hand over what the CNC has said."""
        if self._serial is not None:
            self._serial.send()
            self._serial.pace(wire_dt_s)

    async def close(self) -> None:
        """Close everything and remove the links."""
        if self._serial is not None:
            self._serial.close()
            self._serial = None
        for line in self._lines:
            line.close()
        self._lines.clear()
        await asyncio.gather(*(device.close() for device in self._devices))
        self._devices.clear()


def _absolute(device: str) -> str:
    """A map given by path is named so that it is found from any directory; a shipped one keeps its name."""
    return str(Path(device).resolve()) if device.endswith(".toml") else device


def load_devices(cell: Cell) -> dict[str, Device]:
    """The register maps of a cell, by role. Raises ConfigError."""
    return {role: load_device(link.device) for role, link in cell.links.items()}


def write_cell(cell: Cell, path: Path) -> None:
    """Write a cell file so that a reader sees the old one or the whole new one."""
    text = tomli_w.dumps(cell.model_dump(mode="json", exclude_none=True))
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=path.name)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.chmod(name, CELL_FILE_MODE)
    os.replace(name, path)
