"""`python -m cellctl.cell --cell FILE --run DIR --store FILE [--stop-port N]`: the cell process."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import gc
import os
import resource
import signal
import ssl
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import structlog

from cellctl.allocator import keep_little
from cellctl.cell.black_box import box_file
from cellctl.cell.commands import Commands
from cellctl.cell.connect import CellWires, Connection
from cellctl.cell.controller import Controller, Times
from cellctl.cell.ipc import IpcServer
from cellctl.cell.program_reader import ProgramReader
from cellctl.cell.record import Journal, StoreError
from cellctl.cell.stop_listener import StopListener
from cellctl.cell.stop_thread import StopThread
from cellctl.cell.tick import HELPER_PRIORITY, Beat, Ticker, be_urgent
from cellctl.cell.view import snapshot
from cellctl.domain.messages import Command
from cellctl.tls import TlsError, server_context
from config.base import ConfigError
from config.cell import Cell, load_cell
from drivers.clock import SystemClock
from drivers.cnc.driver import CncDriver
from drivers.cnc.line_watch import LineWatch
from drivers.transport.line_loop import LineLoop
from planner.errors import PlannerError

SNAPSHOT_S = 0.1
SWITCH_S = 0.0005  # how long a thread that computes may keep the tick waiting
HELPERS = 4  # threads that open programs and look names up
SELECT_DESCRIPTORS = 1024  # FD_SETSIZE of the C library
log = structlog.get_logger()


class CellProcess:
    """Joins controller, wires, socket, stop listener and timer in one event loop."""

    def __init__(self, cell: Cell, cell_file: str, run_dir: Path, store: Path, stop_host: str = "", tls: ssl.SSLContext | None = None) -> None:
        self.cell = cell
        self._run_dir = run_dir
        self._clock = SystemClock()
        self._journal = Journal(store, box_file(run_dir), cell.service.samples_kept)
        self.controller = Controller(cell, Times(self._clock, time.time), self._journal)
        self.commands = Commands(self.controller, ProgramReader(cell_file, run_dir / "forms"))
        self._beat = Beat(cell.limits.tick_s)
        self._ipc = IpcServer(self.commands.handle, cell.name)
        self._stop_listener = self._listener(stop_host or cell.service.host, tls)
        self.commands.on_pages = self._stop_listener.allow_pages
        self._stop_scheme = "http" if tls is None else "https"
        self._connection = Connection(self.controller, CellWires(cell, run_dir, self._clock), self._watch_cnc)
        self._watch: LineWatch | None = None
        self._due: asyncio.TimerHandle | None = None
        self._seq = 0
        self._published_at = 0.0
        self.ended = asyncio.Event()

    async def run(self, stop_port: int) -> None:
        """Serve until `ended` is set. Raises OSError when a socket or port cannot be had."""
        loop = asyncio.get_running_loop()
        self._journal.on_committed = lambda events: _on_loop(loop, lambda: self._ipc.broadcast(events))
        self._journal.on_failure = lambda line: _on_loop(loop, lambda: self.controller.fault("store", line))
        sys.setswitchinterval(SWITCH_S)
        loop.set_default_executor(_helpers())
        _watch_children_without_threads(loop)
        self._journal.start(_be_prompt)
        self._beat.scheduler = be_urgent()
        log.info("scheduler", scheduler=self._beat.scheduler, tick_s=self.cell.limits.tick_s)
        try:
            await self._ipc.start(self._run_dir / "cell.sock")
            port = await self._stop_listener.start(stop_port)
            (self._run_dir / "stop_scheme").write_text(self._stop_scheme, encoding="ascii")
            (self._run_dir / "stop_port").write_text(str(port), encoding="ascii")
            ticker = Ticker(self._beat, self._clock.now, self._tick)
            self._connection.start()
            self.controller.event(
                "process", f"cell process {os.getpid()} started, {self._beat.scheduler}", {"pid": os.getpid()}
            )
            log.info("ready", socket=str(self._run_dir / "cell.sock"), stop_port=port)
            gc.collect()
            gc.freeze()
            await self.ended.wait()
            ticker.close()
        finally:
            await self._close()

    def _listener(self, host: str, tls: ssl.SSLContext | None) -> StopListener | StopThread:
        def state() -> str:
            return self.controller.state.value

        return StopListener(self._stop, state, host) if tls is None else StopThread(self._stop, state, host, tls, _be_prompt)

    async def _close(self) -> None:
        """Everything off, then everything closed."""
        if self.controller.run is not None:
            self.commands.stop_now("the cell process was told to end")
            await asyncio.sleep(5 * self.cell.limits.tick_s)
        await self.commands.close()
        await self._connection.close()
        await self._stop_listener.close()
        await self._ipc.close()
        self._journal.close()
        self._journal.box.remove()

    def _tick(self) -> None:
        self._guard(self.controller.tick)
        self._pace()
        now = self._clock.now()
        if now - self._published_at >= SNAPSHOT_S - 0.5 * self.cell.limits.tick_s:
            self._published_at = now
            self._seq += 1
            self._ipc.publish(snapshot(self.controller, self._seq, self._beat))

    def _guard(self, work: Callable[[], None]) -> None:
        """Work of the tick: what nobody foresaw is logged and latched."""
        try:
            work()
        except Exception as error:
            log.exception("tick failed")
            self.controller.fault("internal", f"{type(error).__name__}: {error}")

    def _watch_cnc(self, cnc: CncDriver | None) -> None:
        """Read the CNC's port as soon as bytes come in, and write when the wire has room again."""
        if self._watch is not None:
            self._watch.close()
        self._watch = LineWatch(cnc, self._pump) if cnc is not None and cnc.fileno() is not None else None

    def _pump(self) -> None:
        """The CNC's line, and set-points whose time has come between two ticks."""
        self._guard(self.controller.pump)
        if not self.controller.is_cnc_alive:
            self._watch_cnc(None)
        run, now = self.controller.run, self._clock.now()
        due = run.due_at() if run is not None else None
        if due is not None and due <= now:
            self._guard(lambda: self.controller.act(now))
        self._pace()

    def _pace(self) -> None:
        """Go on when a set-point is due, between two ticks; the CNC's line paces itself."""
        if self._due is not None:
            self._due.cancel()
            self._due = None
        if self._watch is not None:
            self._watch.rearm()
        run = self.controller.run if self.controller.is_cnc_alive else None
        due = run.due_at() if run is not None else None
        if due is None:
            return
        left_s = due - self._clock.now()
        if 0.0 < left_s < self.cell.limits.tick_s:  # what is overdue is for the next tick
            self._due = asyncio.get_running_loop().call_later(max(left_s, 0.0005), self._pump)

    async def _stop(self, ident: str, who: str, because: str) -> str:
        self.commands.stop_now(because)
        await self.commands.handle(Command(ident or f"stop-{time.time_ns()}", "stop", who, because))
        return self.controller.state.value


def _be_prompt() -> None:
    """For a thread beside the tick's: while it holds the interpreter the tick waits for it, so it must not wait for ordinary processes."""
    be_urgent(HELPER_PRIORITY)


def _helpers() -> ThreadPoolExecutor:
    """Threads that are there before the first tick: who starts one waits until an ordinary thread has had its turn."""
    pool, all_there = ThreadPoolExecutor(HELPERS, "helper", _be_prompt), threading.Barrier(HELPERS)
    for there in [pool.submit(all_there.wait) for _ in range(HELPERS)]:
        there.result()
    return pool


def _watch_children_without_threads(loop: asyncio.AbstractEventLoop) -> None:
    """Before Python 3.12 asyncio starts a thread for every process that it starts, and waits for it to begin."""
    if sys.version_info < (3, 12) and hasattr(os, "pidfd_open"):
        watcher = asyncio.PidfdChildWatcher()
        watcher.attach_loop(loop)
        asyncio.get_event_loop_policy().set_child_watcher(watcher)


def _on_loop(loop: asyncio.AbstractEventLoop, call: object) -> None:
    with contextlib.suppress(RuntimeError):  # the loop has closed: nobody listens any more
        loop.call_soon_threadsafe(call)  # type: ignore[arg-type]


def _limit_descriptors() -> None:
    """The line is waited for by select(), which takes none beyond: one too many is refused where it is opened, in one line."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft > SELECT_DESCRIPTORS:
        resource.setrlimit(resource.RLIMIT_NOFILE, (SELECT_DESCRIPTORS, hard))


async def _main(given: argparse.Namespace) -> None:
    cell = load_cell(given.cell)
    tls = server_context(given.tls_cert, given.tls_key) if given.tls_cert is not None else None
    process = CellProcess(cell, given.cell, given.run, given.store, given.stop_host, tls)
    loop = asyncio.get_running_loop()
    for sign in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(sign, process.ended.set)
    await process.run(cell.service.stop_port if given.stop_port is None else given.stop_port)


def main(arguments: list[str] | None = None) -> int:
    """Run the cell process; 2 for bad input, with one line and a hint on stderr."""
    parser = argparse.ArgumentParser(prog="python -m cellctl.cell", description=__doc__)
    parser.add_argument("--cell", required=True, help="cell file, or the name of a shipped one")
    parser.add_argument("--run", required=True, type=Path, help="run directory: sockets, and ports with relative paths")
    parser.add_argument("--store", required=True, type=Path, help="store file (SQLite)")
    parser.add_argument("--stop-host", default="", help="where the stop listener is reached; else the cell file's host")
    parser.add_argument("--stop-port", type=int, default=None, help="port of the stop listener; 0: any free one")
    parser.add_argument("--tls-cert", type=Path, default=None, help="certificate of the stop listener (PEM)")
    parser.add_argument("--tls-key", type=Path, default=None, help="its key")
    given = parser.parse_args(arguments)
    structlog.configure(
        processors=[structlog.processors.add_log_level, structlog.processors.TimeStamper(fmt="iso"), structlog.processors.dict_tracebacks,
                    structlog.processors.JSONRenderer()],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )  # fmt: skip
    keep_little()
    _limit_descriptors()
    try:
        given.run.mkdir(parents=True, exist_ok=True)
        given.store.parent.mkdir(parents=True, exist_ok=True)
        with asyncio.Runner(loop_factory=LineLoop) as runner:
            runner.run(_main(given))
    except (ConfigError, StoreError, PlannerError, TlsError) as error:
        print(f"{error.message}\n  {error.hint}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"cell process: {error}\n  is another cell process running here?", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
