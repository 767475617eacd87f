"""Starts queued jobs when the cell is idle and a person has confirmed the table clear, and follows runs in what the cell process wrote."""

from __future__ import annotations

import asyncio
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import structlog

from cellctl.api.cell_link import CellAbsentError, CellLink
from cellctl.api.run_states import is_job_of, path_to, target_of
from cellctl.api.table import found_of
from cellctl.api.waits import why_not_yet
from cellctl.domain.jobs import JobState, WrongJobStateError
from cellctl.domain.messages import Reply
from cellctl.domain.snapshot import Snapshot
from cellctl.domain.trouble import trouble_of
from cellctl.planning.at_hand import bring
from cellctl.store import Store, cell_table, claims, consumables, dependencies, fleet, history, jobs, lineage
from cellctl.store.cell_table import Lying
from cellctl.store.claims import ClaimedError
from cellctl.store.fleet import Seat, WrongCellError
from cellctl.store.history import Run
from cellctl.store.jobs import JobRow
from config.by_hand import ByHand

J = JobState
PERIOD_S = 1.0
REFUSED = "the cell refused to start it"
CLAIM_SETTLES_S = 90.0  # behind a start that was not answered: by then the cell has told whether it runs
RETRIED = "tried again by itself: "
log = structlog.get_logger(__name__)


class StartRefusedError(Exception):
    """The cell would not start the job. `message`, `hint` : one line each; kind : of the refusal (Reply.kind)"""

    def __init__(self, message: str, hint: str = "", kind: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.kind = kind


@dataclass
class Refusals:
    """Starts of one confirmation that were refused. first_at : monotonic (s)"""

    confirmed_at: float
    first_at: float
    count: int = 0


class Runs:
    """Call `run` as one task; `wake` whenever the cell or a queued job may have changed."""

    def __init__(self, store: Store, link: CellLink, changed: Callable[[str], None], by_hand: ByHand, seat: Seat) -> None:
        self._store = store
        self._seat = seat
        self._by_hand = by_hand
        self._refusals: dict[str, Refusals] = {}
        self._link = link
        self._changed = changed
        self._wake = asyncio.Event()
        self._lock = asyncio.Lock()
        self._start_lock = asyncio.Lock()
        self.starting: set[str] = set()

    def wake(self) -> None:
        """Look now."""
        self._wake.set()

    async def run(self) -> None:
        """Follow and start, for ever. That the store refuses is told once."""
        told = ""
        while True:
            self._wake.clear()
            try:
                await self.follow()
                await self._start_next()
                told = ""
            except Exception as error:
                trouble = trouble_of(error)
                if trouble is None:
                    log.exception("runs")
                elif trouble.title != told:
                    log.error("runs wait for the store", error=trouble.detail)
                    told = trouble.title
            try:
                async with asyncio.timeout(PERIOD_S):
                    await self._wake.wait()
            except TimeoutError:
                pass

    async def follow(self) -> None:
        """Bring the states of jobs in step with the runs that the cell process wrote down."""
        snapshot = self._link.fresh
        async with self._lock:
            for job_id in await asyncio.to_thread(self._follow_all, snapshot):
                self._changed(job_id)

    def _follow_all(self, snapshot: Snapshot | None) -> list[str]:
        with self._store.read_cell() as cell_rows:
            recent = history.recent_runs(cell_rows)
        with self._store.read() as connection:
            near = jobs.on_or_near_cell(connection, recent, self._seat.cell)
        with self._store.read_cell() as cell_rows:
            runs = history.runs_of(cell_rows, [job.id for job in near])
        changed = []
        for job in near:
            run = runs.get(job.id)
            try:
                is_changed = self._follow_one(job, run, snapshot) if run is not None else self._let_go(job, snapshot)
            except WrongCellError as error:
                log.error("a run of another cell's job", job=job.id, error=str(error))
                continue
            if is_changed:
                changed.append(job.id)
        if not changed:
            return []
        with self._store.read() as connection:  # what those wait for that wait for these has changed with them
            return changed + [other for job_id in changed for other in dependencies.dependents_of(connection, job_id)]

    def _follow_one(self, job: JobRow, run: Run, snapshot: Snapshot | None) -> bool:
        target, why = target_of(job, run, snapshot)
        steps = path_to(job.state, target)
        lines = max(run.last_line, snapshot.lines.executed if snapshot and is_job_of(snapshot, job.id) else 0)
        if not steps and why == job.why and lines == job.lines_executed:
            return False
        changes: dict[str, Any] = {"why": why, "lines_executed": min(lines, run.total_lines or lines)}
        if target is J.FAILED:
            changes["error"] = {
                "title": "The run failed",
                "detail": why or "see the events of the job",
                "hint": "look at the record",
            }
        end = None
        if steps and run.outcome:
            with self._store.read_cell() as cell_rows:
                end = lineage.end_of(cell_rows, job.id)
        with self._store.write() as connection:
            if steps:
                at, reason = run.ended_at or self._store.clock(), end.text if end else ""
                jobs.move(connection, job.id, *steps, at=at, reason=reason, seat=self._seat, **changes)
            else:
                jobs.change(connection, job.id, **changes)
            if job.state is J.QUEUED:
                jobs.forget_clear_tables(connection, self._seat.cell)
        return True

    def _let_go(self, job: JobRow, snapshot: Snapshot | None) -> bool:
        """Withdraw the claim on a job whose start was never answered, once the cell stands idle and has not run it."""
        if job.claimed_at is None or snapshot is None or snapshot.state != "IDLE" or job.id in self.starting:
            return False
        with self._store.read() as connection:
            claimed_for_s = fleet.now_of(connection, self._store.clock) - job.claimed_at  # by the clock that the claim was written by
        if claimed_for_s <= CLAIM_SETTLES_S:
            return False
        with self._store.write() as connection:
            claims.withdraw(connection, job.id, self._seat)
        return True

    async def _start_next(self) -> None:
        queued = await asyncio.to_thread(self._queued)
        is_cell_free = True
        for job, against, lying in queued:
            lost = self._why_confirmed_no_more(job, lying)
            if lost:
                await self._tell(job, f"{found_of(job).again}: {lost}", table_clear=False)
                continue
            why = against or self._why_not(job, is_cell_free)
            if why:
                await self._tell(job, why)
                continue
            is_cell_free = False
            try:
                await self.start(job, acts_for(job)[0], job.approve_because or "approved and the table was confirmed clear")
            except StartRefusedError as error:
                log.warning("start refused", job=job.id, error=error.message)

    def _queued(self) -> list[tuple[JobRow, str, Lying]]:
        """Jobs for whose table somebody vouches and that the cell has not run, in order; what other jobs and the clock have against each;
        and what lies on its table."""
        now = self._store.clock()
        with self._store.read() as connection:
            confirmed = [
                (job, why_not_yet(connection, job, now), cell_table.lying_on(connection, job.cell))
                for job in jobs.confirmed(connection, self._seat.cell)
            ]
        with self._store.read_cell() as cell_rows:  # later than the jobs: what was started meanwhile is among the runs
            ran = history.runs_of(cell_rows, [job.id for job, _, _ in confirmed])
        return [one for one in confirmed if one[0].id not in ran]

    def _why_confirmed_no_more(self, job: JobRow, lying: Lying) -> str:
        """Why a confirmation of the table, or of the part on it, counts no more; empty while it does."""
        seen = found_of(job).seen
        confirmed_at = job.timestamps.get("table_clear", 0.0)
        if lying.job_id and lying.since >= confirmed_at:
            return f"another part was made on it after {seen}"
        if self._store.clock() < confirmed_at:
            return f"the computer's clock was set back after {seen}"
        if self._store.clock() - confirmed_at > self._by_hand.table_confirmed_s:
            return f"{seen} more than {self._by_hand.table_confirmed_s / 60.0:.0f} min ago"
        snapshot = self._link.fresh
        if snapshot is not None and snapshot.table.disturbed_at > confirmed_at:
            return f"{snapshot.table.because} after {seen}"
        refusals = self._refusals.get(job.id)
        is_over = refusals is not None and refusals.confirmed_at == confirmed_at and self._retry_left_s(refusals) <= 0.0
        return f"the cell was not ready for {self._by_hand.start_retry_s:g} s: {job.why.removeprefix(RETRIED)}" if is_over else ""

    def _retry_left_s(self, refusals: Refusals) -> float:
        return refusals.first_at + self._by_hand.start_retry_s - time.monotonic()

    def _why_not(self, job: JobRow, is_cell_free: bool) -> str:
        """Why a queued job for whose table somebody vouches cannot start now; empty if it can."""
        snapshot = self._link.fresh
        if snapshot is None:
            return "waits for the cell process to answer"
        if snapshot.state != "IDLE" or not is_cell_free:
            return job.why if job.why.startswith(RETRIED) else f"waits for the cell to be IDLE (it is {snapshot.state})"
        held = snapshot.control
        who, client = acts_for(job)
        if held is not None and held.client != client:
            return f"waits for control: {held.holder} has it; {who} may take it over, or {held.holder} start the job"
        return ""

    async def _tell(self, job: JobRow, why: str, **changes: object) -> None:
        if why == job.why and not changes:
            return

        def write() -> None:
            with self._store.write() as connection:
                if jobs.get(connection, job.id).state is J.QUEUED:
                    jobs.change(connection, job.id, why=why, **changes)

        await asyncio.to_thread(write)
        self._changed(job.id)

    async def start(self, job: JobRow, who: str, because: str) -> Reply:
        """Send one queued job to the cell, for the client that confirmed the table. Raises StartRefusedError.

        The table has to be confirmed again then, unless the cell was only not ready: that is tried again for a while.
        """
        against = await asyncio.to_thread(self._why_not_yet, job)
        if against:
            raise StartRefusedError(against, "wait for it, or change what the job waits for")
        await self._check_powder(job)
        program = await self._at_hand(job)
        confirmed = job.timestamps.get("table_clear", 0.0)
        args = {"job": job.id, "name": job.name, "program": str(program.resolve()), "confirmed_at": confirmed}
        if job.continues_job is not None:
            await self._check_part(job)
            args["continues"] = job.continues_job
        earlier = self._refusals.get(job.id)
        if earlier is None or earlier.confirmed_at != confirmed:
            earlier = self._refusals[job.id] = Refusals(confirmed, time.monotonic())
        await self._claim(job)
        self.starting.add(job.id)
        try:
            # The id belongs to one try of one confirmation: asked again after a lost answer, the cell starts it once.
            ident = f"start-{job.id}-{confirmed:.3f}" + (f"-{earlier.count}" if earlier.count else "")
            client = acts_for(job)[1]
            async with self._start_lock:  # by hand and by itself at once: one after the other, under one id
                reply = await self._link.command("start", who, because, args, ident=ident, timeout_s=60.0, client=client)
        except CellAbsentError as error:
            if not error.was_asked:
                await asyncio.to_thread(self._withdraw, job)
            raise StartRefusedError(
                str(error), "the cell process is restarted by itself; look again in a moment"
            ) from None
        finally:
            self.starting.discard(job.id)
        if not reply.ok:
            earlier.count += 1
            await asyncio.to_thread(self._withdraw, job)
            await self._refused(job, earlier, reply)
        self._refusals.pop(job.id, None)
        await self.follow()
        return reply

    async def _at_hand(self, job: JobRow) -> Path:
        """The program on this host's own disk. Raises StartRefusedError if it cannot be brought there."""
        try:
            return await asyncio.to_thread(bring, self._store.blobs, job.program_sha256 or "")
        except OSError as error:
            why = f"the program cannot be read: {error.strerror or error}"
            await self._tell(job, f"waits for its files: {why}")
            raise StartRefusedError(why, "look at the folder of files and at this host's disk; it is tried again by itself") from None

    async def _claim(self, job: JobRow) -> None:
        """From here on nobody takes the job away, wherever it is asked for. Raises StartRefusedError."""

        def write() -> None:
            with self._store.write() as connection:
                claims.claim(connection, job.id, self._seat, fleet.now_of(connection, self._store.clock))

        try:
            await asyncio.to_thread(write)
        except ClaimedError as error:
            raise StartRefusedError(error.message, error.hint) from None
        except (WrongCellError, WrongJobStateError) as error:
            raise StartRefusedError(str(error), "look at the job again") from None

    def _withdraw(self, job: JobRow) -> None:
        with self._store.write() as connection:
            claims.withdraw(connection, job.id, self._seat)

    def _why_not_yet(self, job: JobRow) -> str:
        with self._store.read() as connection:
            return why_not_yet(connection, job, self._store.clock())

    async def _check_powder(self, job: JobRow) -> None:
        """Raises StartRefusedError if somebody told that the feeder holds another powder than the job needs."""

        def look() -> str:
            with self._store.read() as connection:
                return consumables.wrong_powder(consumables.loaded(connection), job.material)

        why = "" if tomllib.loads(job.recipe_toml).get("process") == "mill" else await asyncio.to_thread(look)
        if why:
            await self._tell(job, f"{REFUSED}: {why}", table_clear=False)
            raise StartRefusedError(why, "change the powder and tell its lot, or submit the part with the material that is loaded")

    async def _check_part(self, job: JobRow) -> None:
        """Raises StartRefusedError if the part that the job goes on with was taken off since."""

        def look() -> str:
            with self._store.read() as connection, self._store.read_cell() as cell_rows:
                return lineage.why_part_is_gone(connection, cell_rows, job)

        why = await asyncio.to_thread(look)
        if why:
            await self._tell(job, f"{REFUSED}: {why}", table_clear=False)
            raise StartRefusedError(why, "cancel this job, and submit the part again")

    async def _refused(self, job: JobRow, refusals: Refusals, reply: Reply) -> None:
        """Tell why, and whether the confirmation of the table is kept. Raises StartRefusedError."""
        line = f"{reply.error}" + (f" ({reply.hint})" if reply.hint else "")
        if reply.kind == "control":
            await self._tell(job, f"waits for control: {line}")
        elif reply.kind == "table":
            await self._tell(job, f"{found_of(job).again}: {reply.error}", table_clear=False)
        elif reply.kind == "readiness" and self._retry_left_s(refusals) > 0.0:
            await self._tell(job, f"{RETRIED}{line}")
            raise StartRefusedError(reply.error, f"{reply.hint}; it is tried again by itself for {self._by_hand.start_retry_s:g} s", reply.kind)
        else:
            await self._tell(job, f"{REFUSED}: {line}", table_clear=False)
        raise StartRefusedError(reply.error, reply.hint, reply.kind)


def acts_for(job: JobRow) -> tuple[str, str]:
    """For whom a start by the service acts: who confirmed the table, and at which client."""
    who = job.confirmed_by or job.approved_by
    return who, job.confirmed_client or who
