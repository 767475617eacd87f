"""The engine of a service with a planning pool: starts the link, hands it tasks, and starts it again with what it had if it ends."""

from __future__ import annotations

import asyncio
import os
import sys
import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import structlog

from cellctl.planning.ending import kill, to_its_end
from cellctl.planning.engine import Progress, Waits, unheard
from cellctl.planning.pool.order import Asked, Cancelled, Costs, Ended, FromLink, Going, PoolState, ToLink, Waiting
from cellctl.planning.pool.wire import PoolWire
from cellctl.planning.process import LINE_LIMIT, WorkerError
from cellctl.planning.task import Done, Task

AGAIN_S = 1.0
STEADY_S = 30.0  # a link that ends sooner cannot work as things are: it is started again more and more seldom
COSTS_KEPT = 200
log = structlog.get_logger(__name__)


@dataclass
class _Asking:
    """A task that the link has, and who waits for it."""

    asked: Asked
    progress: Progress
    waits: Waits
    ended: asyncio.Future[Ended] = field(default_factory=lambda: asyncio.get_running_loop().create_future())


class Pool:
    """The engine of a pool. Call `keep` as one task; tasks that are run before or while the link is away wait for it.

    files : folder of the store's files   scratch : for the link's own   version : of this service, in words
    changed : told when there are other places
    """

    def __init__(self, wire: PoolWire, files: Path, scratch: Path, version: str, changed: Callable[[], None] = lambda: None) -> None:
        self._wire, self._files, self._scratch, self._version = wire, files, scratch, version
        self.changed = changed
        self.state = PoolState(0, 0, f"the scheduler of the planning pool {wire.address} is being looked for")
        self.costs: deque[Costs] = deque(maxlen=COSTS_KEPT)
        self._asking: dict[str, _Asking] = {}
        self._process: asyncio.subprocess.Process | None = None

    @property
    def places(self) -> int:
        """All places of the pool's fitting machines; one task is taken to wait for them when there are none."""
        return max(1, self.state.places)

    async def run(self, task: Task, progress: Progress, waits: Waits = unheard) -> dict[str, Any]:
        """See `cellctl.planning.engine`."""
        asking = _Asking(Asked(uuid.uuid4().hex, task), progress, waits)
        self._asking[asking.asked.id] = asking
        self._send(asking.asked)
        if self._process is None:
            waits(self.state.why)
        try:
            end = await asyncio.shield(asking.ended)
        except asyncio.CancelledError:
            self._send(Cancelled(asking.asked.id))
            if self._process is not None:
                await to_its_end(asyncio.wait({asking.ended}, timeout=AGAIN_S))  # nothing is written to its folder any more
            raise
        finally:
            self._asking.pop(asking.asked.id, None)
        self.costs.append(end.costs)
        if isinstance(end.report, Done):
            return end.report.summary
        if end.log:
            log.warning("worker failed", kind=task.kind, part=task.part_name, machine=end.costs.machine, detail=end.report.detail, stderr=end.log)
        raise WorkerError(end.report, log=end.log)

    async def keep(self) -> None:
        """Keep the link alive, for ever; cancelled, it ends with all its work."""
        delay = AGAIN_S
        while True:
            started = asyncio.get_running_loop().time()
            process = await self._started()
            try:
                self._process = process
                for asking in list(self._asking.values()):
                    self._send(asking.asked)
                await self._follow(process)
            finally:
                self._process = None
                await to_its_end(kill(process))
            log.warning("the link to the planning pool ended", code=process.returncode)
            self._take(PoolState(0, 0, "the link to the planning pool ended and is started again"))
            for asking in self._asking.values():
                asking.waits(self.state.why)
            lived = asyncio.get_running_loop().time() - started
            delay = AGAIN_S if lived > STEADY_S else min(2 * delay, STEADY_S)
            await asyncio.sleep(delay)

    async def _started(self) -> asyncio.subprocess.Process:
        words = [str(os.getpid()), str(self._files), str(self._scratch), self._version, *self._wire.words()]
        pipe = asyncio.subprocess.PIPE
        command = [sys.executable, "-m", "cellctl.planning.pool.link", *words]
        starting = asyncio.ensure_future(asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, limit=LINE_LIMIT))
        try:
            return await to_its_end(starting)
        except asyncio.CancelledError:
            if not starting.cancelled() and starting.exception() is None:
                await to_its_end(kill(starting.result()))
            raise

    def _send(self, message: ToLink) -> None:
        process = self._process
        if process is not None and process.stdin is not None and not process.stdin.is_closing():
            process.stdin.write(msgspec.json.encode(message) + b"\n")

    async def _follow(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        async for line in process.stdout:
            self._take(msgspec.json.decode(line, type=FromLink))

    def _take(self, message: FromLink) -> None:
        if isinstance(message, PoolState):
            self.state = message
            self.changed()
            return
        asking = self._asking.get(message.id)
        if asking is None:
            return
        if isinstance(message, Going):
            asking.progress(message.stage, message.fraction)
        elif isinstance(message, Waiting):
            asking.waits(message.why)
        elif not asking.ended.done():
            asking.ended.set_result(message)
