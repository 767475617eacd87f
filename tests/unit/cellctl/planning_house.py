"""A planning pool of real processes: a scheduler, planning machines and a service's engine, by TLS on loopback."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from cellctl.planning.pool.near import Pool
from cellctl.planning.pool.wire import PoolWire
from cellctl.planning.task import Task
from tests.unit.cellctl import certificates

PATIENCE_S = 100.0  # of a loaded machine that has to start processes


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def until(holds: Callable[[], object], what: str) -> None:
    """Wait until it holds."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not holds():
                await asyncio.sleep(0.02)
    except TimeoutError:
        raise AssertionError(f"{what} did not come within {PATIENCE_S:g} s") from None


def children_of(pid: int) -> list[int]:
    """Processes of tasks that a planning machine has started."""
    with suppress(OSError):
        found = [int(one) for path in Path(f"/proc/{pid}/task").glob("*/children") for one in path.read_text().split()]
        return [one for one in found if b"cellctl.planning.worker" in command_of(one)]
    return []


def is_alive(pid: int) -> bool:
    """Whether a process is there and not only waits to be buried."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def niceness(pid: int) -> int:
    return os.getpriority(os.PRIO_PROCESS, pid)


def command_of(pid: int) -> bytes:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


@dataclass
class House:
    """folder : of everything   wire : of the pool   said : why tasks waited"""

    folder: Path
    wire: PoolWire
    pool: Pool
    scheduler: subprocess.Popen[bytes] | None = None
    machines: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def _start(self, name: str, *words: str, code: str = "") -> subprocess.Popen[bytes]:
        files = ["--cert", str(self.wire.cert), "--key", str(self.wire.key)] if self.wire.is_tls else []
        begin = ["-c", code] if code else ["-m", "cellctl"]
        with (self.folder / f"{name}.log").open("ab") as log:
            return subprocess.Popen([sys.executable, *begin, *words, *files], stdout=log, stderr=log, cwd=self.folder)

    def start_scheduler(self) -> None:
        self.scheduler = self._start("scheduler", "planner-scheduler", self.wire.address)

    def start_machine(self, name: str, *words: str, code: str = "") -> None:
        own = ["planner-worker", self.wire.address, "--name", name, "--folder", str(self.folder / name), *words]
        self.machines[name] = self._start(name, *own, code=code)

    async def machines_joined(self, count: int) -> None:
        await until(lambda: self.pool.state.machines == count and self.pool.state.places == count, f"{count} machines")

    async def working(self) -> tuple[str, int]:
        """The machine that has a task in work, and the task's process."""
        await until(self._busy, "a task")
        return self._busy()[0]

    def _busy(self) -> list[tuple[str, int]]:
        return [(name, child) for name, machine in self.machines.items() for child in children_of(machine.pid)]

    async def stopped_in_the_middle(self) -> tuple[str, int]:
        """As `working`; the task's process stands still, so that whatever happens next happens in the middle of it."""
        name, child = await self.working()
        machine = self.machines[name].pid
        await until(lambda: niceness(child) > niceness(machine), "the task's own priority")  # from then on it ends with its machine
        os.kill(child, signal.SIGSTOP)
        return name, child

    def kill_machine(self, name: str) -> None:
        machine = self.machines.pop(name)
        machine.kill()
        machine.wait()

    def kill_scheduler(self) -> None:
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()

    def end(self) -> None:
        for process in (*self.machines.values(), self.scheduler):
            if process is not None:
                process.terminate()
        for process in (*self.machines.values(), self.scheduler):
            if process is not None:
                process.wait(PATIENCE_S)


@asynccontextmanager
async def pool_house(folder: Path, *, tls: bool = True) -> AsyncIterator[House]:
    """A service's engine and its link, without scheduler and machines as yet."""
    cert, key = certificates.make(folder, "pool")
    address = f"127.0.0.1:{free_port()}"
    wire = PoolWire(f"tls://{address}", cert, key) if tls else PoolWire(f"tcp://{address}")
    files, scratch = folder / "files", folder / "scratch"
    files.mkdir()
    scratch.mkdir()
    house = House(folder, wire, Pool(wire, files, scratch, "0.1.0"))
    keeping = asyncio.create_task(house.pool.keep())
    try:
        yield house
    finally:
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)
        house.end()


def inspection(mesh: Path, folder: Path) -> Task:
    """The cheapest task there is: a mesh loaded, checked and written again."""
    folder.mkdir()
    return Task(kind="inspect", folder=str(folder), parent=0, memory_bytes=0, part_name=mesh.stem, mesh=str(mesh))
