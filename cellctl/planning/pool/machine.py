"""A planning machine: joins a pool, takes one task per place, each in a process of its own as at home; comes back when the scheduler was away."""

from __future__ import annotations

import asyncio
import fcntl
import os
import shutil
import tempfile
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import structlog

from cellctl.faults import explain
from cellctl.planning.keys import software, software_version
from cellctl.planning.pool import far
from cellctl.planning.pool.cache import Cache
from cellctl.planning.pool.order import LIVE_FOLDER, Away, End, File, Machine, Order, OrderError, as_json, resource_of
from cellctl.planning.pool.unpacking import MADE, finished_so_far, results, unpacked
from cellctl.planning.pool.wire import LOOPBACK, PoolError, PoolWire
from cellctl.planning.process import WorkerError, Workers
from cellctl.planning.task import Done, Failed

AGAIN_S = 1.0  # between two looks for the scheduler
CONNECT_S = 10.0
LOOK_S = 0.2  # how often is looked whether anybody still wants a task
SIGN_S = 5.0  # the longest silence of a task that lives
FETCH_S = 300.0  # results that nobody fetches within this time are lost
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Place:
    """How a planning machine works. folder : of its cache and scratch files   shared : where the store's files are seen from here, if they are"""

    name: str
    folder: Path
    places: int
    memory_bytes: int
    cache_bytes: int
    host: str = ""
    port: int = 0
    shared: Path | None = None


@dataclass
class Run:
    """One task here. missing : hashes of files still to come   told : files that the link has heard of"""

    id: str
    order: Order
    folder: Path
    missing: dict[str, File] = field(default_factory=dict)
    all_here: asyncio.Event = field(default_factory=asyncio.Event)
    is_taken: asyncio.Event = field(default_factory=asyncio.Event)
    end: End | None = None
    told: set[str] = field(default_factory=set)


class PlanningMachine:
    """Call `serve`. say : told lines for a person"""

    def __init__(self, wire: PoolWire, place: Place, say: Callable[[str], None]) -> None:
        self._wire, self._place, self._say = wire, place, say
        self._scratch = place.folder / "scratch"
        shutil.rmtree(self._scratch, ignore_errors=True)
        self._scratch.mkdir(parents=True)
        self.cache = Cache(place.folder / "files", place.cache_bytes, place.shared)
        self.runs: dict[str, Run] = {}
        self._broken_off: list[Run] = []
        self._worker: Any = None

    @property
    def facts(self) -> Machine:
        """What it says of itself."""
        return Machine(self._place.name, software_version(), software(), self._place.places)

    async def serve(self, stop: asyncio.Event) -> None:
        """Join the pool and work, again and again, until told to stop. Raises TlsError."""
        far.MACHINE = self
        stopped = asyncio.create_task(stop.wait())
        was_away = False
        try:
            while not stop.is_set():
                member = asyncio.create_task(self._member(was_away))
                await asyncio.wait({member, stopped}, return_when=asyncio.FIRST_COMPLETED)
                member.cancel()
                with suppress(asyncio.CancelledError):
                    was_away = await member or was_away
                if not stop.is_set():
                    await asyncio.wait({stopped}, timeout=AGAIN_S)
        finally:
            stopped.cancel()
            far.MACHINE = None

    async def _member(self, was_away: bool) -> bool:
        """Be in the pool until the scheduler goes; whether it was told that it cannot be reached."""
        from distributed import Worker

        try:
            self._worker = await asyncio.wait_for(self._joined(Worker), 3 * CONNECT_S)
        except (OSError, TimeoutError) as error:
            if not was_away:
                self._say(f"the scheduler {self._wire.address} cannot be reached ({_words(error)}); it is tried again every {AGAIN_S:g} s")
            return True
        self._say(f"{self._place.name} is in the pool of {self._wire.address}: {self._place.places} places, at {self._worker.address}")
        for run in self._broken_off:
            self._tell(run, "left")
        self._broken_off.clear()
        try:
            await self._worker.finished()
            self._say("the scheduler is gone; looking for it")
        finally:
            await self._leave()
        return True

    async def _joined(self, worker_class: Any) -> Any:
        place, software_hash = self._place, software()
        worker = worker_class(
            self._wire.address,
            security=self._wire.security(),
            host=place.host or await asyncio.to_thread(_own_address, self._wire),
            port=place.port,
            name=f"{place.name}-{uuid.uuid4().hex[:8]}",
            nthreads=place.places,
            resources={resource_of(software_hash): place.places},
            memory_limit=0,  # tasks are processes with a cap of their own
            local_directory=str(self._scratch),
            death_timeout=CONNECT_S,
            dashboard=False,
            dashboard_address="127.0.0.1:0",
            startup_information={"cellctl": lambda _worker: msgspec.to_builtins(self.facts)},
        )
        try:
            return await worker
        except BaseException:
            await worker.close(nanny=False, reason="not joined")
            raise

    async def _leave(self) -> None:
        """End all tasks here; they are not at fault."""
        with suppress(OSError):
            for run in self.runs.values():
                self._tell(run, "left")
        worker, self._worker = self._worker, None
        with suppress(TimeoutError, OSError):
            await asyncio.wait_for(worker.close(nanny=False, reason="leaves"), CONNECT_S)

    def _tell(self, run: Run, told: str, **more: Any) -> None:
        """Tell whoever waits for a task what happens to it."""
        if self._worker is not None:
            where = {"address": self._worker.address, "machine": self._place.name}
            message = {"told": told, "task": run.order.id, "key": run.order.key, "run": run.id, **where, **more}
            self._worker.log_event(run.order.topic, message)

    async def carry_out(self, order: Order) -> None:
        """One task from its arrival until its results are fetched."""
        run = Run(uuid.uuid4().hex, order, Path(tempfile.mkdtemp(dir=self._scratch)))
        self.runs[run.id] = run
        self._tell(run, "begun")
        working = asyncio.create_task(self._to_its_end(run))
        try:
            while not working.done():
                await asyncio.wait({working}, timeout=LOOK_S)
                if not self._is_wanted(order.key) and not run.is_taken.is_set():
                    log.info("task is not wanted any more", task=order.id)
                    return
            working.result()
        except asyncio.CancelledError:
            self._broken_off.append(run)  # dask ends its tasks when it loses its scheduler
            raise
        finally:
            working.cancel()
            await asyncio.wait({working})
            del self.runs[run.id]
            await asyncio.to_thread(shutil.rmtree, run.folder, ignore_errors=True)
            await asyncio.to_thread(self.cache.sweep)

    def _is_wanted(self, key: str) -> bool:
        """Whether the scheduler still has this attempt on its list for this machine: it takes it off when the service cancels it or is gone."""
        state = self._worker.state.tasks.get(key) if self._worker is not None else None
        return state is not None and state.state == "executing"

    async def _to_its_end(self, run: Run) -> None:
        signs = asyncio.create_task(self._signs_of_life(run))
        try:
            run.end = await self._worked(run)
            self._tell(run, "made")
            async with asyncio.timeout(FETCH_S):
                await run.is_taken.wait()
        finally:
            signs.cancel()

    async def _signs_of_life(self, run: Run) -> None:
        while True:
            await asyncio.sleep(SIGN_S)
            self._tell(run, "lives")

    async def _worked(self, run: Run) -> End:
        """Fetch what the task reads, do it, and look what it made."""
        order, place = run.order, self._place
        if order.software != software():
            return End(refusal(order, self.facts))
        try:
            await self._fetched(run)
            task = await asyncio.to_thread(unpacked, order, self.cache, run.folder, place.folder / "checkpoints")
            self._tell(run, "works")
            summary = await Workers(run.folder, place.memory_bytes).run(task, lambda stage, share: self._tell(run, "going", stage=stage, share=share))
            return End(Done(summary), await asyncio.to_thread(results, run.folder / MADE))
        except WorkerError as error:
            return End(error.failed, is_lost=error.is_lost, log=error.log)
        except Exception as error:  # noqa: BLE001  the task's edge: whatever happens is told to the one who waits
            return End(_failed(error, place.name))

    async def _fetched(self, run: Run) -> None:
        """All files are in the cache. The link sends what is missing."""
        missing = await asyncio.to_thread(self.cache.missing, run.order.files)
        run.missing = {file.sha256: file for file in missing}
        if run.missing:
            self._tell(run, "wants", files=list(run.missing))
            await run.all_here.wait()

    def run_of(self, run_id: str) -> Run:
        """A task that is here. Raises Away."""
        if run_id not in self.runs:
            raise Away("the task is not at this machine any more")
        return self.runs[run_id]

    async def put(self, run_id: str, sha256: str, offset: int, data: bytes) -> None:
        """A piece of a file that a task waits for. Raises OrderError, OSError."""
        run = self.run_of(run_id)
        if sha256 not in run.missing:
            raise OrderError("nobody waits for this file")
        if await asyncio.to_thread(self.cache.put, run_id, run.missing[sha256], offset, data):
            del run.missing[sha256]
            if not run.missing:
                run.all_here.set()

    async def so_far(self, run_id: str) -> bytes:
        """Results of a task that still runs that were not told before, as JSON. Raises OrderError."""
        run = self.run_of(run_id)
        fresh = await asyncio.to_thread(finished_so_far, run.folder / MADE, LIVE_FOLDER, run.told)
        run.told.update(file.name for file in fresh)
        return as_json(fresh)

    def ended(self, run_id: str) -> bytes:
        """How a task ended, as JSON. Raises OrderError."""
        end = self.run_of(run_id).end
        if end is None:
            raise OrderError("the task has not ended")
        return as_json(end)

    async def piece(self, run_id: str, name: str, offset: int, size: int) -> bytes:
        """A piece of a result. Raises OrderError, OSError."""
        made = self.run_of(run_id).folder / MADE

        def read() -> bytes:
            path = (made / name).resolve()
            if not path.is_relative_to(made.resolve()):
                raise OrderError(f"{name} is no result")
            with path.open("rb") as file:
                file.seek(offset)
                return file.read(size)

        return await asyncio.to_thread(read)

    def taken(self, run_id: str) -> None:
        """All results were fetched."""
        if run_id in self.runs:
            self.runs[run_id].is_taken.set()


def refusal(order: Order, here: Machine) -> Failed:
    """A task of another version of the software, refused."""
    detail = f"{here.name} plans with version {here.version} ({here.software[:12]}), the service with {order.version} ({order.software[:12]})"
    return Failed("Another version of the software", detail, "install the same version on both machines", 503)


def _failed(error: Exception, machine: str) -> Failed:
    fault = explain(error)
    if fault is not None:
        return Failed(fault.title, fault.detail, fault.hint, fault.status)
    log.exception("planning machine", exc_info=error)
    hint = f"the log of the planning machine {machine} has the details; please report it"
    return Failed("Internal fault", f"{type(error).__name__}: {error}", hint, 500)


def _own_address(wire: PoolWire) -> str:
    """Address of this machine on the way to the scheduler: no other network reaches it. Raises OSError."""
    from distributed import utils

    ask: Any = utils.get_ip
    return "127.0.0.1" if wire.host in LOOPBACK else str(ask(wire.host))


def _words(error: BaseException) -> str:
    cause = error.__cause__ or error
    if isinstance(cause, OSError) and cause.errno:
        return os.strerror(cause.errno).lower()
    return str(cause).splitlines()[0] if str(cause) else "no answer"


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold the folder of a planning machine. Raises PoolError if another one works in it."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "machine.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise PoolError(f"{folder}: another planning machine works here", "name another --folder") from None
        yield
