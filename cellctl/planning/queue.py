"""Takes submitted jobs through plan, post and proof, in the order of their queue, as many at once as its engine has places."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import structlog
from sqlalchemy import Connection
from sqlalchemy.exc import SQLAlchemyError

from cellctl.domain.jobs import JobState, WrongJobStateError
from cellctl.domain.trouble import trouble_of
from cellctl.planning.jobwork import JobWork, Stopped
from cellctl.planning.process import WorkerError
from cellctl.planning.task import Failed
from cellctl.store import Store, jobs
from cellctl.store.fleet import WrongCellError
from cellctl.store.jobs import JobRow
from cellctl.store.parts import NotFoundError
from config import Cell

J = JobState
log = structlog.get_logger(__name__)
AGAIN_S = 2.0  # between two tries of a store that refuses
UNFINISHED = (J.PLANNING, J.PLANNED, J.POSTING, J.PROVING, J.PROVEN)


@dataclass(frozen=True)
class StageProgress:
    """Where the work on a job stands. fraction : 0 to 1 of the stage"""

    stage: str
    fraction: float


class PlanningQueue:
    """Call `run` as one task; `wake` after a job was added; `cancel` after a job was cancelled in the store.

    changed : told the job's id after every change. Only jobs of the work's own cell are looked at.
    """

    def __init__(self, store: Store, work: JobWork, changed: Callable[[str], None]) -> None:
        self._store = store
        self._work = work
        self._changed = changed
        self._wake = asyncio.Event()
        self._running: dict[str, asyncio.Task[None]] = {}
        self._astray: set[str] = set()
        self.progress: dict[str, StageProgress] = {}

    def use_cell(self, cell: Cell, cell_file: Path) -> None:
        """Post and prove for this cell from now on: it was measured anew."""
        self._work = replace(self._work, cell=cell, cell_file=cell_file)

    @property
    def working(self) -> tuple[str, ...]:
        """The jobs that are worked on."""
        return tuple(self._running)

    def wake(self) -> None:
        """Look for submitted jobs now."""
        self._wake.set()

    def drawing(self, job_id: str) -> Path | None:
        """Where the layers of a job that is being planned are written as they become ready; None for any other job."""
        return self._work.drawings.get(job_id)

    def cancel(self, job_id: str) -> None:
        """End the worker of a job, if it has one."""
        task = self._running.get(job_id)
        if task is not None:
            task.cancel()

    async def run(self) -> None:
        """Work for ever. Jobs that were in work when the service ended are submitted again first. A store that refuses is asked again."""
        resubmit, told = self._resubmit, ""
        try:
            while True:
                self._wake.clear()
                try:
                    await asyncio.to_thread(resubmit)
                    resubmit = self._resubmit_astray
                    await self._start_what_fits()
                except (SQLAlchemyError, OSError) as error:
                    trouble = trouble_of(error)
                    if trouble is None:
                        raise
                    if trouble.title != told:
                        log.error("planning waits for the store", error=trouble.detail)
                    told = trouble.title
                    await asyncio.sleep(AGAIN_S)
                    continue
                told = ""
                await self._wake.wait()
        finally:
            for task in self._running.values():
                task.cancel()
            await asyncio.gather(*self._running.values(), return_exceptions=True)

    def _resubmit(self) -> None:
        with self._store.write() as connection:
            for job in jobs.oldest_in(connection, UNFINISHED, self._work.seat.cell):
                if (state := job.state) in (J.PLANNED, J.PROVEN):
                    log.error("job rests in a passing state", job=job.id, state=state.value)
                    continue
                self._submit_again(connection, job.id, "the service restarted; this step starts again")

    def _resubmit_astray(self) -> None:
        """Jobs that the work stopped on as the store refused."""
        if not self._astray:
            return
        with self._store.write() as connection:
            for job in jobs.oldest_in(connection, UNFINISHED, self._work.seat.cell):
                if job.id in self._astray and job.id not in self._running:
                    self._submit_again(connection, job.id, "the store was away; this step starts again")
        self._astray.clear()

    def _submit_again(self, connection: Connection, job_id: str, why: str) -> None:
        jobs.move(connection, job_id, J.SUBMITTED, at=self._store.clock(), seat=self._work.seat, why=why)

    async def _start_what_fits(self) -> None:
        waiting = await asyncio.to_thread(self._waiting)
        for job in waiting:
            if len(self._running) >= self._work.workers.places:
                return
            if job.id not in self._running:
                task = asyncio.create_task(self._take_through(job), name=f"job {job.id}")
                self._running[job.id] = task
                task.add_done_callback(partial(self._finished, job.id))

    def _waiting(self) -> list[JobRow]:
        with self._store.read() as connection:
            return jobs.first_in(connection, J.SUBMITTED, self._work.workers.places + len(self._running), self._work.seat.cell)

    def _finished(self, job_id: str, _task: asyncio.Task[None]) -> None:
        self._running.pop(job_id, None)
        self.progress.pop(job_id, None)
        self._changed(job_id)
        self.wake()

    async def _take_through(self, job: JobRow) -> None:
        """All stages of one job; whatever stops it ends up in the job."""

        def report(stage: str, fraction: float) -> None:
            self.progress[job.id] = StageProgress(stage, fraction)
            self._changed(job.id)

        try:
            await self._take(job, report)
        except SQLAlchemyError as error:
            if trouble_of(error) is None:
                log.exception("planning queue", job=job.id)
            self._astray.add(job.id)

    async def _take(self, job: JobRow, report: Callable[[str, float], None]) -> None:
        """Raises SQLAlchemyError where the store refuses: then nobody can be told."""
        try:
            await self._work.take_through(job, report)
        except WorkerError as error:
            await self._fail(job.id, error.failed)
        except (Stopped, WrongJobStateError, WrongCellError, NotFoundError):
            log.info("job left the planning queue", job=job.id)
        except asyncio.CancelledError:
            raise
        except Exception as error:
            if isinstance(error, SQLAlchemyError) and trouble_of(error) is not None:
                raise
            log.exception("planning queue", job=job.id)
            await self._fail(
                job.id,
                Failed("Internal fault", f"{type(error).__name__}: {error}", "the service's log has the details", 500),
            )

    async def _fail(self, job_id: str, failed: Failed) -> None:
        document = {"title": failed.title, "detail": failed.detail, "hint": failed.hint}

        def move() -> None:
            with self._store.write() as connection:
                jobs.move(connection, job_id, J.FAILED, at=self._store.clock(), seat=self._work.seat, error=document, why="")

        try:
            await asyncio.to_thread(move)
        except (WrongJobStateError, WrongCellError):
            log.info("job left the planning queue while it failed", job=job_id)
