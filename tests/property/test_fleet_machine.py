"""Cells of a fleet that come, die, and come back late, in any order: each job is made at most once, on the cell whose table its part lies on."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from cellctl.domain.fleet import ANY, DEAD_S, is_dead, is_living
from cellctl.domain.jobs import ENDED, JobState, WrongJobStateError
from cellctl.store import jobs, open_store, upgrade
from cellctl.store.fleet import WrongCellError
from tests.unit.cellctl.fleet_of import PLANNED, Host, job_of, made_ready, submit

J = JobState
CELLS = ("a", "b", "c")
cells = st.sampled_from(CELLS)
NEXT = {J.SUBMITTED: (J.PLANNING,), J.PLANNING: (J.PLANNED, J.POSTING), J.POSTING: (J.PROVING,), J.PROVING: (J.PROVEN, J.WAITING_FOR_APPROVAL)}


@cache
def newest() -> Path:
    """A store as it is after its first start; each example copies it."""
    folder = Path(tempfile.mkdtemp(prefix="fleet-")) / "store"
    upgrade(folder)
    atexit.register(shutil.rmtree, folder.parent, ignore_errors=True)
    return folder


class Fleet(RuleBasedStateMachine):
    """heard : when each cell was last; held : what each host believes to be working on, dead or not; started : which cell began a job"""

    @initialize()
    def begin(self) -> None:
        self.folder = tempfile.TemporaryDirectory()
        path = Path(self.folder.name) / "store"
        shutil.copytree(newest(), path)
        self.now = 1_800_000_000.0
        self.store = open_store(path, lambda: self.now)
        self.part = made_ready(self.store)
        self.hosts = {name: Host(self.store, name, lambda: self.now) for name in CELLS}
        self.heard: dict[str, float] = {}
        self.up = dict.fromkeys(CELLS, True)
        self.held: dict[str, dict[str, JobState]] = {name: {} for name in CELLS}
        self.claimed: dict[str, dict[str, None]] = {name: {} for name in CELLS}
        self.started: dict[str, str] = {}
        self.jobs: list[str] = []
        for name in CELLS:
            self.beat(name)
        self.submit([ANY, ANY, ANY, "a"])
        for name in CELLS:
            self.bring_to_its_queue(name)

    def teardown(self) -> None:
        if hasattr(self, "store"):
            self.store.close()
            self.folder.cleanup()

    @precondition(lambda self: len(self.jobs) < 6)
    @rule(asked=st.lists(st.sampled_from((*CELLS, ANY, ANY, ANY)), min_size=1, max_size=3))
    def more(self, asked: list[str]) -> None:
        self.submit(asked)

    def submit(self, asked: list[str]) -> None:
        self.jobs += [submit(self.store, self.part, cell) for cell in asked]
        self.beat("a")

    @rule(cell=cells)
    def die(self, cell: str) -> None:
        """Its host hangs: nothing is told any more; what it had begun may still come, late."""
        self.up[cell] = False

    @rule(cell=cells)
    def come_back(self, cell: str) -> None:
        self.up[cell] = True
        self.beat(cell)

    @rule(s=st.sampled_from((3.0, DEAD_S)))
    def wait(self, s: float) -> None:
        """Time goes by; who is up is heard."""
        self.now += s
        for name in CELLS:
            self.beat(name)

    def beat(self, cell: str) -> None:
        if not self.up[cell]:
            return
        self.hosts[cell].beat()
        self.heard[cell] = self.now
        living = [name for name in CELLS if name in self.heard and is_living(self.now - self.heard[name])]
        for job in map(self.job, self.jobs):
            if job.cell_wanted == ANY and job.id not in self.started and not job.claimed_by and job.state not in ENDED:
                assert job.cell in CELLS and not is_dead(self.now - self.heard[job.cell]), "it was not given to another"
                assert living

    def queued(self) -> list[str]:
        return [one for one in self.jobs if self.job(one).state is J.QUEUED]

    def job(self, job_id: str) -> Any:
        return job_of(self.store, job_id)

    @rule(cell=cells)
    def take(self, cell: str) -> None:
        """Its planner takes the next job of its queue, if the host is up."""
        job = self.hosts[cell].first(J.SUBMITTED) if self.up[cell] else None
        if job is not None:
            self.held[cell].setdefault(job.id, J.SUBMITTED)

    @rule(cell=cells)
    def hurry(self, cell: str) -> None:
        self.bring_to_its_queue(cell)

    def bring_to_its_queue(self, cell: str) -> None:
        """What was made before is not made again: its jobs are before the cell at once."""
        while self.up[cell] and (job := self.hosts[cell].first(J.SUBMITTED)) is not None:
            self.hosts[cell].move(job.id, *PLANNED)

    @precondition(lambda self: any(self.held.values()))
    @rule(data=st.data())
    def work_on(self, data: st.DataObject) -> None:
        """One step of what a host believes to be working on, however late."""
        cell = data.draw(st.sampled_from([name for name in CELLS if self.held[name]]))
        job_id = data.draw(st.sampled_from(list(self.held[cell])))
        steps = NEXT[self.held[cell][job_id]]
        before = self.job(job_id)
        try:
            after = self.hosts[cell].move(job_id, *steps)
        except (WrongCellError, WrongJobStateError):
            del self.held[cell][job_id]
            assert self.job(job_id) == before  # nothing was changed
            return
        assert before.cell == cell
        self.held[cell][job_id] = after.state
        if after.state not in NEXT:
            del self.held[cell][job_id]

    @precondition(lambda self: any(self.job(one).state is J.WAITING_FOR_APPROVAL for one in self.jobs))
    @rule()
    def approve(self) -> None:
        with self.store.write() as rows:
            for one in self.jobs:
                if jobs.get(rows, one).state is J.WAITING_FOR_APPROVAL:
                    jobs.move(rows, one, J.QUEUED, at=self.now, by="eve")

    @precondition(lambda self: self.queued())
    @rule(cell=cells, data=st.data())
    def claim(self, cell: str, data: st.DataObject) -> None:
        """A host, up or late, is about to start a job that it saw in its queue, however long ago."""
        job_id = data.draw(st.sampled_from(self.queued()))
        before = self.job(job_id)
        try:
            self.hosts[cell].claim(job_id)
        except (WrongCellError, WrongJobStateError):
            assert self.job(job_id) == before
        else:
            assert before.cell == cell and before.state is J.QUEUED
            self.claimed[cell][job_id] = None
            self.heard[cell] = self.now

    @precondition(lambda self: any(self.claimed.values()))
    @rule(cell=cells, is_refused=st.booleans())
    def start(self, cell: str, is_refused: bool) -> None:
        """The cell process takes the start, or refuses it."""
        for job_id in list(self.claimed[cell]):
            del self.claimed[cell][job_id]
            if is_refused and job_id not in self.started:
                self.hosts[cell].withdraw(job_id)
            else:
                assert self.started.setdefault(job_id, cell) == cell, "a job was started on two cells"

    @precondition(lambda self: self.started)
    @rule(data=st.data(), outcome=st.sampled_from((J.RUNNING, J.HELD, J.INTERRUPTED, J.COMPLETED)))
    def follow(self, data: st.DataObject, outcome: JobState) -> None:
        """The host follows what its cell does, whenever it is there to."""
        job_id = data.draw(st.sampled_from(list(self.started)))
        job, host = self.job(job_id), self.hosts[self.started[job_id]]
        steps = [J.RUNNING, outcome] if job.state is J.QUEUED and outcome is not J.RUNNING else [outcome]
        try:
            host.move(job_id, *steps)
        except WrongJobStateError:
            assert job.state not in (J.QUEUED,)

    @invariant()
    def a_started_job_stays_where_its_part_lies(self) -> None:
        for job_id, cell in getattr(self, "started", {}).items():
            job = self.job(job_id)
            assert job.cell == cell and job.state in {J.QUEUED, J.RUNNING, J.HELD, J.INTERRUPTED, J.COMPLETED}
            assert job.state is not J.QUEUED or job.claimed_by

    @invariant()
    def no_job_is_lost_and_named_ones_never_move(self) -> None:
        for job_id in getattr(self, "jobs", []):
            job = self.job(job_id)
            assert job.cell_wanted == ANY or job.cell == job.cell_wanted
            with self.store.read() as rows:
                steps = jobs.steps_of(rows, job_id)
            assert steps[-1].state == job.state.value
            assert all(one.state == other.left for one, other in pairwise(steps))


Fleet.TestCase.settings = settings(max_examples=10, stateful_step_count=30, deadline=None)
test_cells_that_come_and_go_make_each_job_once = Fleet.TestCase
