"""`cellctl serve`: brings the store up to date, starts the cell process and the web process, and starts them again when one dies."""

from __future__ import annotations

import asyncio
import fcntl
import json
import os
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from cellctl.first_start import ServeError, check_reach, first_token
from cellctl.planning.pool.wire import PoolWire, check_installed, check_pool
from cellctl.reach import Wire, check_wire
from cellctl.store import upgrade
from cellctl.store.engine import DATABASE
from cellctl.store.shared import Wanted, share
from cellctl.tls import pinned_context
from config import find_facts, load_cell

BACK_OFF_FIRST_S = 0.2
BACK_OFF_MAX_S = 5.0
STEADY_S = 30.0  # a process that ended by itself within this time did so because its input is bad, if it says so
LASTING_S = 4.0  # a process that lived this long starts again without delay
END_S = 10.0
READY_S = 60.0
POLL_S = 0.2
ADDRESS_FILE = "service.json"
TAKE_OVER_S = 10.0  # a service that was killed has left a web process that ends within that time
START_NICE = -15  # of the cell process until it has its own scheduler: a machine without its controller waits for nobody
BAD_INPUT = 2  # exit code of a process that cannot work with what it was given


@dataclass(frozen=True)
class Options:
    """What is served, and where. A port of 0 means any free one."""

    cell: str
    store: Path
    run: Path
    host: str | None = None
    port: int | None = None
    stop_port: int | None = None
    upload_limit_mb: float = 200.0
    worker_memory_mb: float = 8192.0
    wire: Wire = field(default_factory=Wire)
    pool: PoolWire | None = None
    shared: Wanted | None = None


@dataclass(frozen=True)
class Address:
    """Where the service listens."""

    host: str
    port: int
    stop_port: int
    scheme: str = "http"

    @property
    def url(self) -> str:
        """Of the console and of REST."""
        shown = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host
        return f"{self.scheme}://{f'[{shown}]' if ':' in shown else shown}:{self.port}"


@dataclass
class Keeper:
    """Keeps one process alive. say : told a line when it starts again    nice : its priority, where that is permitted"""

    name: str
    command: list[str]
    log: Path
    say: Callable[[str], None]
    nice: int = 0
    process: asyncio.subprocess.Process | None = None
    ending: bool = False
    failure: str = ""
    starts: int = field(default=0)
    _starting: asyncio.Lock = field(default_factory=asyncio.Lock)
    has_worked: bool = False  # with this input: what it refuses later (a disk that is full, a store that is locked) will pass

    async def keep(self) -> None:
        """Start, wait, start again, until `end`. Returns with `failure` set if the process says that its input is bad."""
        delay = 0.0
        while not self.ending:
            await asyncio.sleep(delay)
            started = time.monotonic()
            process = await self._start()
            if process is None:
                return
            code = await process.wait()
            lived = time.monotonic() - started
            if self.ending:
                return
            self.has_worked = self.has_worked or lived > STEADY_S
            if code == BAD_INPUT and not self.has_worked:
                self.failure = last_line(self.log) or f"the {self.name} process cannot start"
                return
            delay = 0.0 if lived > LASTING_S and code else min(max(2 * delay, BACK_OFF_FIRST_S), BACK_OFF_MAX_S)  # 0: told to end, as we may be
            how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
            how += f", {last_line(self.log)}" if code == BAD_INPUT else ""
            self.say(f"the {self.name} process {how}; it starts again in {delay:.1f} s (log: {self.log})")

    async def _start(self) -> asyncio.subprocess.Process | None:
        """The process; None if it is to end. Nobody ends the keeper while it is being started: it would be left behind."""
        async with self._starting:
            if self.ending:
                return None
            self.starts += 1
            with self.log.open("ab") as log:
                self.process = await asyncio.create_subprocess_exec(
                    *self.command, stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log
                )
            if self.nice:
                with suppress(OSError):
                    os.setpriority(os.PRIO_PROCESS, self.process.pid, self.nice)
            return self.process

    async def end(self) -> None:
        """Ask it to end, kill it if it does not."""
        self.ending = True
        async with self._starting:
            process = self.process
        if process is None or process.returncode is not None:
            return
        with suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(END_S):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()


def last_line(log: Path) -> str:
    """The last line of a log that is not a hint."""
    lines = [
        line
        for line in log.read_text(encoding="utf-8", errors="replace").splitlines()
        if line and not line.startswith(" ")
    ]
    return lines[-1] if lines else ""


def free_port(host: str, port: int) -> int:
    """The port, if it can be had; any free one for 0. Raises ServeError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise ServeError(
                f"cannot listen at {host}:{port}: {error.strerror}", "name another one with --port or --stop-port"
            ) from None
        return int(probe.getsockname()[1])


async def port_left(run: Path, host: str, port: int) -> int:
    """`free_port`; where a service was killed, once its web process has let go of it. Raises ServeError."""
    left = run / ADDRESS_FILE
    end = time.monotonic() + (TAKE_OVER_S if left.exists() else 0.0)
    while True:
        try:
            taken = free_port(host, port)
        except ServeError:
            if time.monotonic() > end:
                raise
            await asyncio.sleep(POLL_S)
        else:
            left.unlink(missing_ok=True)
            return taken


@contextmanager
def only_one(run: Path) -> Iterator[None]:
    """Hold the run directory. Raises ServeError if another service has it."""
    run.mkdir(parents=True, exist_ok=True)
    with (run / "serve.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ServeError(
                f"{run}: another service runs here", "stop it, or name another --run and --store"
            ) from None
        yield


def cell_process_at(path: Path) -> int | None:
    """Process id of the cell process that listens at this socket, None if nobody does."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return None
        pid, _, _ = struct.unpack("3i", probe.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
        return int(pid)


def check_adopted(run: Path, scheme: str, process: int) -> None:
    """Raises ServeError if the cell process of an earlier service listens for STOP in a way that pages of this one cannot use."""
    kept = run / "stop_scheme"
    if kept.is_file() and (before := kept.read_text(encoding="ascii")) != scheme:
        raise ServeError(
            f"the cell process {process} of an earlier service listens for STOP by {before}, this service would be {scheme}",
            "serve as before, or end that process first (it may be in a job)",
        )


class Supervisor:
    """One service: `run` until SIGTERM or SIGINT. say : told lines for a person; ready : told the address and the first token"""

    def __init__(
        self, options: Options, say: Callable[[str], None], ready: Callable[[Address, str | None], None]
    ) -> None:
        self._options = options
        self._say = say
        self._ready = ready
        self._stop = asyncio.Event()

    async def run(self) -> None:
        """Serve. Raises ServeError, StoreError, ConfigError."""
        options = self._options
        cell_file = find_facts("cells", options.cell).resolve()
        cell = load_cell(cell_file)
        host = options.host or cell.service.host
        with only_one(options.run):
            if options.shared is not None:
                share(options.store, options.shared)
            upgrade(options.store)
            check_reach(options.store, host)
            for warning in (*check_wire(options.wire, host), *self._check_pool()):
                self._say(warning)
            scheme = options.wire.scheme
            adopted = cell_process_at(options.run / "cell.sock")
            if adopted is not None:
                check_adopted(options.run, scheme, adopted)
            port = await port_left(options.run, host, cell.service.port if options.port is None else options.port)
            wanted = cell.service.stop_port if options.stop_port is None else options.stop_port
            stop_port = int((options.run / "stop_port").read_text()) if adopted else free_port(host, wanted)
            address = Address(host, port, stop_port, scheme)
            secret = first_token(options.store)
            cell_keeper, web_keeper = self._keepers(cell_file, address)
            for sign in (signal.SIGTERM, signal.SIGINT):
                asyncio.get_running_loop().add_signal_handler(sign, self._stop.set)
            await self._serve(cell_keeper, web_keeper, address, secret, adopted)

    def _check_pool(self) -> list[str]:
        """Lines of warning. Raises PoolError, TlsError."""
        if self._options.pool is None:
            return []
        check_installed()
        warning = check_pool(self._options.pool)
        return [warning] if warning else []

    def _keepers(self, cell_file: Path, address: Address) -> tuple[Keeper, Keeper]:
        options, python = self._options, sys.executable
        shared = ["--cell", str(cell_file), "--run", str(options.run.resolve())]
        cell = [python, "-m", "cellctl.cell", *shared, "--store", str(options.store.resolve() / DATABASE)]
        web = [python, "-m", "cellctl.api", *shared, "--store", str(options.store.resolve())]
        files = options.wire.files()
        web += [*files, *options.wire.for_web(), *(options.pool.words() if options.pool is not None else [])]
        limits = {"upload-limit": options.upload_limit_mb * 1e6, "worker-memory": options.worker_memory_mb * 2**20}
        web += [word for name, value in limits.items() for word in (f"--{name}-bytes", str(int(value)))]
        web += ["--host", address.host, "--port", str(address.port), "--parent", str(os.getpid())]
        return (
            Keeper(
                "cell",
                [*cell, *files, "--stop-host", address.host, "--stop-port", str(address.stop_port)],
                options.run / "cell.log",
                self._say,
                START_NICE,
            ),
            Keeper("web", [*web, "--stop-port", str(address.stop_port)], options.run / "web.log", self._say),
        )

    async def _serve(
        self, cell: Keeper, web: Keeper, address: Address, secret: str | None, adopted: int | None
    ) -> None:
        tasks = [asyncio.create_task(self._keep_cell(cell, adopted)), asyncio.create_task(web.keep())]
        tasks += [asyncio.create_task(self._announce(address, secret)), asyncio.create_task(self._stopped())]
        announced, stopped = tasks[2], tasks[3]
        try:
            pending = set(tasks)
            while not stopped.done():
                done, pending = await asyncio.wait(pending, return_when=asyncio.FIRST_COMPLETED)
                failure = cell.failure or web.failure
                if failure:
                    raise ServeError(failure, f"the logs are in {self._options.run}")
                if announced in done and announced.exception() is not None:
                    announced.result()
        finally:
            (self._options.run / ADDRESS_FILE).unlink(missing_ok=True)
            await asyncio.gather(web.end(), cell.end(), self._end_adopted(cell))
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _stopped(self) -> None:
        await self._stop.wait()

    async def _keep_cell(self, cell: Keeper, adopted: int | None) -> None:
        """A cell process that an earlier service left running is kept until it ends: it may be in a job."""
        socket_path = self._options.run / "cell.sock"
        while True:
            if adopted is not None:
                self._say(f"the cell process {adopted} of an earlier service is running; it is kept")
                cell.has_worked = True
            while adopted is not None and cell_process_at(socket_path) == adopted:
                await asyncio.sleep(POLL_S)
            await cell.keep()
            adopted = cell_process_at(socket_path) if cell.failure else None
            if adopted is None:
                return
            cell.failure = ""  # one of an earlier service, that was on its way up, was first

    async def _end_adopted(self, cell: Keeper) -> None:
        own = cell.process.pid if cell.process is not None else None
        adopted = cell_process_at(self._options.run / "cell.sock")
        if adopted is not None and adopted != own:
            with suppress(ProcessLookupError):
                os.kill(adopted, signal.SIGTERM)

    async def _announce(self, address: Address, secret: str | None) -> None:
        """Wait until the web process answers, then tell the address. Raises ServeError after READY_S."""
        cert = self._options.wire.cert
        verify = pinned_context(cert) if cert is not None else True
        async with httpx.AsyncClient(trust_env=False, timeout=2.0, verify=verify) as client:
            for _ in range(int(READY_S / POLL_S)):
                with suppress(httpx.HTTPError):
                    if (await client.get(f"{address.url}/healthz")).status_code == 200:
                        break
                await asyncio.sleep(POLL_S)
            else:
                raise ServeError("the web process does not answer", f"its log is {self._options.run / 'web.log'}")
        document = {"url": address.url, "stop_url": f"{address.scheme}://127.0.0.1:{address.stop_port}/stop", "pid": os.getpid()}
        document["store"] = str(self._options.store.resolve())
        if cert is not None:
            document["tls_cert"] = str(cert.resolve())
        (self._options.run / ADDRESS_FILE).write_text(json.dumps(document), encoding="utf-8")
        self._ready(address, secret)
