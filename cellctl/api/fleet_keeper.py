"""This service's place in the fleet: its heartbeat, the lease on its cell, and its share in giving jobs to cells."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import structlog
from sqlalchemy import Connection
from sqlalchemy.exc import DBAPIError

from cellctl.api.waits import time_in_words
from cellctl.domain.dispatch import why_it_stays
from cellctl.domain.fleet import HEARTBEAT_S, is_dead
from cellctl.domain.jobs import ENDED, JobState
from cellctl.planning import dispatcher
from cellctl.planning.queue import PlanningQueue
from cellctl.store import Store, changes, fleet, jobs
from cellctl.store.fleet import LeaseHeldError, Member, Told
from cellctl.store.jobs import JobRow

J = JobState
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Beat:
    """What a heartbeat found. changed : jobs; left : of those that are worked on here, which are not this cell's or were cancelled"""

    members: tuple[Member, ...]
    changed: tuple[str, ...]
    left: tuple[str, ...]
    has_work: bool
    change: int


class FleetKeeper:
    """Call `take` before anything else, `run` as one task, `leave` at the end.

    told : what there is to tell of the cell now; changed : told the id of each job that changed by another service's doing
    """

    def __init__(self, store: Store, told: Callable[[], Told], queue: PlanningQueue, changed: Callable[[str], None]) -> None:
        self._store = store
        self._told = told
        self._queue = queue
        self._changed = changed
        self._wake = asyncio.Event()
        self._change = 0
        self._failure = ""
        self.members: tuple[Member, ...] = ()

    def wake(self) -> None:
        """A job waits for a cell: look now."""
        self._wake.set()

    def take(self) -> None:
        """Take the cell's lease. Raises LeaseHeldError."""
        with self._store.write() as rows:
            now = fleet.now_of(rows, self._store.clock)
            fleet.tell(rows, self._told(), now)
            self.members = tuple(fleet.members(rows, now))
            self._change = changes.last_change(rows)

    def leave(self) -> None:
        """Give the lease back; a store that refuses keeps nobody from ending."""
        told = self._told()
        try:
            with self._store.write() as rows:
                fleet.leave(rows, told.cell, told.owner)
        except DBAPIError as error:
            log.warning("the lease is not given back", error=str(error.orig))

    async def run(self) -> None:
        """Tell, look and give out, for ever."""
        while True:
            self._wake.clear()
            await self._beat_once()
            try:
                async with asyncio.timeout(HEARTBEAT_S):
                    await self._wake.wait()
            except TimeoutError:
                pass

    async def _beat_once(self) -> None:
        told, working = self._told(), self._queue.working
        try:
            beat = await asyncio.to_thread(self._beat, told, working)
        except (DBAPIError, OSError) as error:  # told once; what needs the store refuses by itself meanwhile
            self._fails(str(getattr(error, "orig", error)))
        except LeaseHeldError as error:
            for job_id in working:
                self._queue.cancel(job_id)
            self._fails(f"{error.message}: nothing is planned and started here")
        except Exception:
            log.exception("fleet")
        else:
            self._failure = ""
            self._take(beat)

    def _fails(self, why: str) -> None:
        if why.split(", heard")[0] != self._failure.split(", heard")[0]:
            log.warning("no heartbeat", error=why)
        self._failure = why

    def _take(self, beat: Beat) -> None:
        self.members, self._change = beat.members, beat.change
        for job_id in beat.left:
            self._queue.cancel(job_id)
        for job_id in beat.changed:
            self._changed(job_id)
        if beat.has_work:
            self._queue.wake()
        if len(beat.changed) >= dispatcher.AT_ONCE:  # there may be more
            self.wake()

    def _beat(self, told: Told, working: Sequence[str]) -> Beat:
        silent = {member.cell for member in self.members if member.is_dead}
        with self._store.write() as rows:
            now = fleet.now_of(rows, self._store.clock)
            fleet.tell(rows, told, now)
            members = tuple(fleet.members(rows, now))
            changed: list[str] = []
            if dispatcher.is_needed(rows, members):
                changed += dispatcher.free(rows, members, now)
                changed += dispatcher.dispatch(rows, members, now)
        with self._store.read() as rows:
            change = self._change
            if len(members) > 1:  # others change jobs as well
                seen = changes.changed_since(rows, change)
                changed += [job_id for job_id, _ in seen]
                change = max((number for _, number in seen), default=change)
            for cell in {member.cell for member in members if member.is_dead} ^ silent:
                changed += _told_of(rows, cell)
            left = [job_id for job_id in working if (job := jobs.get(rows, job_id)).cell != told.cell or job.state is J.CANCELLED]
            has_work = bool(jobs.first_in(rows, J.SUBMITTED, 1, told.cell))
        return Beat(members, tuple(dict.fromkeys(changed)), tuple(left), has_work, change)

    def silence_of(self, job: JobRow) -> str:
        """Why a job stays with a cell that is not heard, in one line; empty where the cell is heard, or it does not matter to the job."""
        if job.cell == "" or job.state in ENDED - {J.INTERRUPTED} or job.cleared_at is not None:
            return ""
        member = next((one for one in self.members if one.cell == job.cell), None)
        if member is None or not is_dead(member.age_s):
            return ""
        return why_it_stays(dispatcher.holding_of(job), job.cell, time_in_words(member.heard_at))


def _told_of(rows: Connection, cell: str) -> list[str]:
    """Jobs of a cell that fell silent or came back: what they wait for has changed."""
    return [job.id for job in jobs.oldest_in(rows, [state for state in JobState if state not in ENDED or state is J.INTERRUPTED], cell)]
