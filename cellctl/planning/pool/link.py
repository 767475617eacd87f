"""The link between a service and its planning pool: `python -m cellctl.planning.pool.link PARENT FILES SCRATCH VERSION --planning-scheduler …`.

It lives as long as the web process, takes tasks as JSON lines on stdin and tells of them as JSON lines on stdout. When the scheduler is away it
looks for it again and again, tells why tasks wait, and sends them anew. When the link itself ends, the scheduler takes its tasks off the machines.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
import time
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import structlog

from cellctl.faults import explain
from cellctl.planning.keys import software
from cellctl.planning.pool.attempt import Attempt, Losses
from cellctl.planning.pool.connection import LOOK_S, Connection, Gone
from cellctl.planning.pool.order import (
    Asked,
    Costs,
    Ended,
    FromLink,
    Going,
    Order,
    OrderError,
    PoolState,
    ToLink,
    Waiting,
)
from cellctl.planning.pool.packing import Hashes, Packed, Packing
from cellctl.planning.pool.wire import PoolWire, add_options, quiet, wire_of
from cellctl.planning.process import LINE_LIMIT
from cellctl.planning.task import Done, Failed

AGAIN_S = 1.0
log = structlog.get_logger(__name__)


class Link:
    """files : folder of the store's files   scratch : for what it writes   version : of the service, in words"""

    def __init__(self, wire: PoolWire, files: Path, scratch: Path, version: str, tell: Any) -> None:
        self._wire, self._files, self._scratch, self._version, self._tell = wire, files, scratch, version, tell
        self._topic = f"cellctl-{uuid.uuid4().hex}"
        self._hashes = Hashes()
        self._connection: Connection | None = None
        self._changed = asyncio.Condition()
        self._why_away = f"the scheduler of the planning pool {wire.address} is being looked for"
        self._state: PoolState | None = None
        self._work: dict[str, asyncio.Task[None]] = {}
        self._attempts: dict[str, Attempt] = {}  # by the order's key
        self._losses: dict[str, Losses] = {}  # by the task's id

    async def run(self, lines: asyncio.StreamReader) -> None:
        """Take tasks until stdin ends."""
        keeping = asyncio.create_task(self._keep_connected())
        try:
            while line := await lines.readline():
                asked = msgspec.json.decode(line, type=ToLink)
                if isinstance(asked, Asked):
                    self._work[asked.id] = asyncio.create_task(self._worked(asked))
                elif asked.id in self._work:
                    self._work[asked.id].cancel()
        finally:
            for task in (*self._work.values(), keeping):
                task.cancel()
            await asyncio.gather(*self._work.values(), keeping, return_exceptions=True)

    def _hear(self, message: dict[str, Any]) -> None:
        """What a machine tells; a task that a machine had to leave was not lost by any fault of the task."""
        losses = self._losses.get(str(message.get("task")))
        if losses is not None and message.get("told") == "left":
            losses.by_run.pop(str(message.get("run")), None)
        attempt = self._attempts.get(str(message.get("key")))
        if attempt is not None:
            attempt.hear(message)

    async def _keep_connected(self) -> None:
        while True:
            connection = None
            try:
                connection = await Connection.opened(self._wire, software(), self._version, self._topic, self._hear)
                await self._use(connection)
                while True:
                    self._say_state(PoolState(connection.places, len(connection.machines), connection.why_none))
                    await asyncio.sleep(LOOK_S)
                    await connection.look()
            except Exception as error:  # noqa: BLE001  whatever dask raises, the scheduler is looked for again
                if connection is not None or self._state is None:
                    log.warning("planning pool", address=self._wire.address, error=f"{type(error).__name__}: {error}"[:500])
                self._why_away = f"the scheduler of the planning pool {self._wire.address} cannot be reached; it is tried again every {AGAIN_S:g} s"
                self._say_state(PoolState(0, 0, self._why_away))
                await self._use(None)
            finally:
                if connection is not None:
                    await connection.close()
            await asyncio.sleep(AGAIN_S)

    async def _use(self, connection: Connection | None) -> None:
        async with self._changed:
            self._connection = connection
            self._changed.notify_all()

    def _say_state(self, state: PoolState) -> None:
        if state != self._state:
            self._state = state
            self._tell(state)

    async def _worked(self, asked: Asked) -> None:
        """One task from its order to its end."""
        log_lines, costs = "", Costs()
        try:
            with tempfile.TemporaryDirectory(dir=self._scratch) as scratch:
                report, costs, log_lines = await self._carried_out(asked, Path(scratch))
        except asyncio.CancelledError:
            report = Failed("Cancelled", "nobody waits for it any more")
        except Exception as error:  # noqa: BLE001  the task's edge: whatever happens is told to the one who waits
            report = _failed(error)
        self._losses.pop(asked.id, None)
        del self._work[asked.id]
        self._tell(Ended(asked.id, report, costs, log_lines))

    async def _carried_out(self, asked: Asked, scratch: Path) -> tuple[Done | Failed, Costs, str]:
        started = time.monotonic()
        packed = await asyncio.to_thread(Packing(self._files, scratch, self._hashes).pack, asked.task)
        pack_s = time.monotonic() - started
        losses, waits, number = self._losses.setdefault(asked.id, Losses()), self._waits(asked.id), 0
        while not losses.are_too_many:
            number += 1
            connection = await self._connected(waits)
            order = self._order(asked, packed, number)
            attempt = self._attempts[order.key] = Attempt(
                connection, order, packed.paths, Path(asked.task.folder), losses,
                lambda stage, share: self._tell(Going(asked.id, stage, share)), waits,
            )  # fmt: skip
            try:
                end = await attempt.carried_out()
            except Gone:
                await self._lost(connection)
                continue
            finally:
                del self._attempts[order.key]
            if end is not None:
                return end.report, attempt.costs(pack_s), end.log
            log.warning("a task's machine was lost", task=asked.id, kind=asked.task.kind, losses=list(losses.by_run.values()))
        return losses.told(asked.task.kind), Costs(pack_s), ""

    def _order(self, asked: Asked, packed: Packed, number: int) -> Order:
        key = f"cellctl-{asked.task.kind}-{asked.id}-{number}-{uuid.uuid4().hex[:8]}"
        return Order(
            asked.id, key, self._topic, software(), self._version, packed.task, packed.files, packed.cell_sha256, packed.twin_sha256
        )

    def _waits(self, task_id: str) -> Callable[[str], None]:
        """Tells why a task waits, whenever that changes."""
        last = [""]

        def tell(why: str) -> None:
            if why != last[0]:
                last[0] = why
                self._tell(Waiting(task_id, why))

        return tell

    async def _connected(self, waits: Callable[[str], None]) -> Connection:
        """The connection, once there is one."""
        async with self._changed:
            while self._connection is None:
                waits(self._why_away)
                await self._changed.wait()
            return self._connection

    async def _lost(self, connection: Connection) -> None:
        """Wait until the keeper has seen it as well."""
        async with self._changed:
            with suppress(TimeoutError):
                async with asyncio.timeout(2 * LOOK_S):
                    while self._connection is connection:
                        await self._changed.wait()


def _failed(error: Exception) -> Failed:
    fault = explain(error)
    if fault is not None:
        return Failed(fault.title, fault.detail, fault.hint, fault.status)
    if isinstance(error, OrderError):
        return Failed("A file did not come through", str(error), "submit it again; if it comes again, look at the disks of both machines", 503)
    log.exception("link to the planning pool", exc_info=error)
    return Failed("Internal fault", f"{type(error).__name__}: {error}", "the service's log has the details; please report it", 500)


async def serve(wire: PoolWire, files: Path, scratch: Path, version: str) -> None:
    """Link stdin and stdout with the pool."""
    from cellctl.planning.worker import Line

    line = Line()

    def tell(message: FromLink) -> None:
        line.write(msgspec.json.encode(message))

    reader = asyncio.StreamReader(limit=LINE_LIMIT)
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin.buffer)
    await Link(wire, files, scratch, version, tell).run(reader)


def main(words: list[str]) -> int:
    """Run until stdin ends."""
    import argparse
    import logging

    from cellctl.planning.worker import end_with

    parser = argparse.ArgumentParser(prog="python -m cellctl.planning.pool.link")
    parser.add_argument("parent", type=int)
    parser.add_argument("files", type=Path)
    parser.add_argument("scratch", type=Path)
    parser.add_argument("version")
    add_options(parser)
    given = parser.parse_args(words)
    end_with(given.parent)
    logging.basicConfig(level=logging.ERROR)
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))
    quiet()
    wire = wire_of(given)
    assert wire is not None
    asyncio.run(serve(wire, given.files, given.scratch, given.version))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
