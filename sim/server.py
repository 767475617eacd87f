"""A simulated cell as a process: wires open, time running, a control socket, and nothing left behind at the end."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from config import Cell
from sim.control import SOCKET_PATH_MAX, Answer, Control, Extra
from sim.real_machine import really
from sim.wires import WireError, Wires, load_devices, write_cell
from sim.workshop import Workshop
from sim.world import World

TICK_S = 0.005
LAG_MAX_S = 0.05  # a world that is late does not catch up more than this in one step
TIME_SCALE_MAX = 200.0


class SimServer:
    """One simulated cell behind its wires.

    `await start()` opens everything and writes `run_dir/cell.toml`; `await run()` moves time until `stop()`; `await close()` cleans up.
    """

    def __init__(
        self,
        cell: Cell,
        run_dir: Path,
        *,
        time_scale: float = 1.0,
        faults: Sequence[str] = (),
        stock_cell_mm: float = 0.5,
        mesh_path: Path | None = None,
        at_baud: bool = False,
    ) -> None:
        """Raises WireError for a cell that is not to be simulated, FaultScriptError for a fault text."""
        if cell.mode != "sim":
            raise WireError(f'{cell.name}: mode = "{cell.mode}"', 'the simulator plays only cells with mode = "sim"')
        if not 0.01 <= time_scale <= TIME_SCALE_MAX:
            raise WireError(f"time scale {time_scale:g}", f"give 0.01 to {TIME_SCALE_MAX:g}")
        self.run_dir = Path(os.path.abspath(run_dir))
        self.world = World(really(cell), load_devices(cell), time_scale=time_scale, faults=faults)
        self._given = cell
        self.cell = cell
        self.workshop = Workshop(self.world, stock_cell_mm)
        self._mesh_path = mesh_path
        self._wires = Wires(self.world, cell, self.run_dir, time.monotonic, at_baud)
        extras: dict[str, Extra] = {
            "workpiece": self.workshop.clamp,
            "as_built": self.workshop.measure,
            "stop": self._stop_command,
        }
        self._control = Control(self.world, self.run_dir / "sim.sock", extras)
        self._stopping = asyncio.Event()

    @property
    def cell_file(self) -> Path:
        """The cell file with the ports as they are."""
        return self.run_dir / "cell.toml"

    async def start(self) -> None:
        """Open the wires and the control socket, write the cell file. Raises WireError."""
        try:
            self.run_dir.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise WireError(f"{self.run_dir}: cannot be made: {error.strerror}", "name another run directory") from None
        if len(os.fsencode(self.run_dir / "sim.sock")) > SOCKET_PATH_MAX:
            raise WireError(f"{self.run_dir}: too long for a socket's name", "use a shorter run directory")
        self.cell = await self._wires.open()
        async with contextlib.AsyncExitStack() as undo:
            undo.push_async_callback(self.close)
            if self._mesh_path is not None:
                await self.workshop.clamp({"mesh": str(self._mesh_path)})
            await self._control.open()
            write_cell(self.cell, self.cell_file)
            undo.pop_all()

    def stop(self) -> None:
        """Have `run` come back."""
        self._stopping.set()

    async def _stop_command(self, command: dict[str, Any]) -> Answer:
        self.stop()
        return {}

    async def run(self) -> None:
        """Move the world in steps of TICK_S of wire time until `stop`."""
        last = time.monotonic()
        due = last
        while not self._stopping.is_set():
            due = max(due + TICK_S, time.monotonic())
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._stopping.wait(), max(due - time.monotonic(), 0.0))
            now = time.monotonic()
            wire_dt_s, last = min(now - last, LAG_MAX_S), now
            self.world.step(wire_dt_s * self.world.time_scale)
            await self._wires.tend()
            self._wires.pace(wire_dt_s)

    async def close(self) -> None:
        """Close all wires, finish the metal, remove links and socket. Harmless twice."""
        await self._control.close()
        await self._wires.close()
        await self.workshop.close()

    def ready_line(self) -> str:
        """One line that says where everything is."""
        links = ", ".join(
            f"{role} {link.host}:{link.tcp_port}"
            if link.transport == "tcp"
            else f"{role} {link.serial_port} id {link.device_id}"
            for role, link in self.cell.links.items()
        )
        return (
            f"sim ready: cell {self.cell_file}, cnc {self.cell.cnc.port}, {links}, control {self.run_dir / 'sim.sock'}"
        )


async def serve(
    cell: Cell,
    run_dir: Path,
    *,
    time_scale: float = 1.0,
    faults: Sequence[str] = (),
    stock_cell_mm: float = 0.5,
    mesh_path: Path | None = None,
    at_baud: bool = False,
) -> None:
    """Run a simulated cell until SIGTERM, SIGINT or the control command `stop`; prints one ready line when all is open.

    Raises WireError, FaultScriptError, ConfigError before anything is left open.
    """
    server = SimServer(
        cell, run_dir, time_scale=time_scale, faults=faults, stock_cell_mm=stock_cell_mm, mesh_path=mesh_path, at_baud=at_baud
    )  # fmt: skip
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, server.stop)
    try:
        await server.start()
        print(server.ready_line(), flush=True)
        await server.run()
    finally:
        await server.close()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.remove_signal_handler(number)
