"""What becomes of jobs, as the shop is promised it: a table of its own and a few sentences, beside the service and without its code."""

from __future__ import annotations

from dataclasses import dataclass, field

CONFIRMED_S = 900.0  # so long a person's word for the table counts
BEFORE_CELL = ("submitted", "planning", "planned", "posting", "proving", "proven", "waiting_for_approval", "queued")
ON_CELL = ("running", "held")
ENDED = ("completed", "failed", "aborted", "cancelled", "interrupted")
LANE_OF = {"submitted": "planning", "queued": "cell"}
_POSTED = (("planned", "posting"), ("proving",))
_LAID_BEFORE = (("proven", "waiting_for_approval"),)
PLANNER: dict[str, tuple[tuple[str, ...], ...]] = {  # steps that are told at once stand together: planned and proven are passed through
    "passes": (("planning",), *_POSTED, *_LAID_BEFORE),
    "has findings": (("planning",), *_POSTED, ("waiting_for_approval",)),
    "cannot be planned": (("planning",), ("failed",)),
    "cannot be proven": (("planning",), *_POSTED, ("failed",)),
    "loses its worker": (("planning",), ("submitted",)),
}
REST: dict[str, tuple[tuple[str, ...], ...]] = {  # of a job that goes on with another: its plan is there
    "passes": (("posting",), ("proving",), *_LAID_BEFORE),
    "has findings": (("posting",), ("proving",), ("waiting_for_approval",)),
    "cannot be planned": (("posting",), ("failed",)),
    "cannot be proven": (("posting",), ("proving",), ("failed",)),
    "loses its worker": (("posting",), ("submitted",)),
}


@dataclass
class Job:
    """One job. after : (other, until); confirmed_at : when a person vouched for its table; number : in the order of submission"""

    id: str
    number: int
    priority: int = 5
    state: str = "submitted"
    after: set[tuple[str, str]] = field(default_factory=set)
    tags: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    not_before: float | None = None
    confirmed_at: float | None = None
    passed: bool = False
    ran: bool = False
    cleared: bool = False
    moved: bool = False
    continues: str | None = None
    life: list[str] = field(default_factory=lambda: ["submitted"])


@dataclass
class Shop:
    """All jobs, the two queues, the cell and its table. on_table : whose part lies there; disturbed_at : nobody's look before counts"""

    jobs: dict[str, Job] = field(default_factory=dict)
    lanes: dict[str, list[str]] = field(default_factory=lambda: {"planning": [], "cell": []})
    cell: str = "IDLE"
    running: str = ""
    on_table: str = ""
    disturbed_at: float = 0.0
    started: list[str] = field(default_factory=list)
    runs: list[tuple[str, str]] = field(default_factory=list)

    def add(self, job: Job) -> None:
        """A new job stands behind all others of its priority."""
        self.jobs[job.id] = job

    def go(self, job: Job, *states: str) -> None:
        """Steps of its life."""
        job.life += states
        job.state = states[-1]

    def chain(self, job: Job) -> list[Job]:
        """All that worked on one part, this one first."""
        return [job, *self.chain(self.jobs[job.continues])] if job.continues else [job]

    def clear(self) -> None:
        """What lay on the table is away."""
        if self.on_table:
            for one in self.chain(self.jobs[self.on_table]):
                one.cleared = True
        self.on_table = ""

    def confirm(self, job: Job, now: float) -> None:
        """A person vouches for the table, or for the part on it."""
        job.confirmed_at = now
        if job.continues is None:
            self.clear()

    def is_met(self, on: str, until: str) -> bool:
        other = self.jobs[on]
        return other.state == "completed" if until == "completed" else other.cleared or (other.state in ENDED and not other.ran)

    def hindrances(self, job: Job, now: float) -> list[str]:
        """Kinds of what other jobs and the clock have against its start."""
        found = ["job" for one in job.after if not self.is_met(*one)]
        return found + (["time"] if job.not_before is not None and now < job.not_before else [])

    def would_wait_for_itself(self, job: Job, on: str) -> bool:
        """Whether `on` waits for the job, however many stand between."""
        return on == job.id or any(self.would_wait_for_itself(job, other) for other, _ in self.jobs[on].after)

    def start(self, job: Job) -> None:
        """The cell takes it; whoever looked at the table has to look again."""
        self.go(job, "running")
        job.ran, self.cell, self.running, self.on_table = True, "RUNNING", job.id, job.id
        self.started.append(job.id)
        for other in self.jobs.values():
            other.confirmed_at = None

    def end(self, outcome: str, now: float) -> None:
        """The run is over; its part lies there."""
        self.go(self.jobs[self.running], *(("running",) if outcome == "completed" and self.cell == "HELD" else ()), outcome)
        self.runs.append((self.running, outcome))
        self.cell, self.running, self.disturbed_at = "IDLE", "", now

    def settle(self, now: float) -> None:
        """What the service does by itself: takes words back that count no more, and starts the first job that may start."""
        for job in [self.jobs[one] for one in self.lanes["cell"]]:
            if job.confirmed_at is not None and (self.disturbed_at > job.confirmed_at or now - job.confirmed_at > CONFIRMED_S):
                job.confirmed_at = None
        for job in [self.jobs[one] for one in self.lanes["cell"]]:
            if self.cell == "IDLE" and job.confirmed_at is not None and not self.hindrances(job, now):
                self.try_start(job)

    def try_start(self, job: Job) -> bool:
        """Whether a job that nothing hinders starts: the rest of a part that is gone does not, and its part has to be looked for again."""
        if job.continues is not None and self.part_is_gone(job):
            job.confirmed_at = None
            return False
        self.start(job)
        return True

    def why_not_gone_on_with(self, job: Job) -> str:
        """Why nobody can go on with its part; empty if one can."""
        if job.state not in ("interrupted", "aborted", "failed") or not job.ran:
            return "it was not interrupted on the cell"
        later = [one for one in self.jobs.values() if one.continues == job.id]
        if any(one.state not in ENDED or one.ran for one in later):
            return "another goes on with it"
        return "the plate was cleared for another" if self.part_is_gone(job) else ""

    def part_is_gone(self, job: Job) -> bool:
        """Whether another job was completed on that table since."""
        own = [one.id for one in self.chain(job)]
        last = max((index for index, (one, _) in enumerate(self.runs) if one in own), default=len(self.runs))
        return any(outcome == "completed" for one, outcome in self.runs[last + 1 :] if one not in own)

    def check_order(self, lane: str, told: list[str]) -> None:
        """Take the order of a lane as told, if it is one: nobody missing, nobody overtaken but by priority."""
        inside = {one.id for one in self.jobs.values() if LANE_OF.get(one.state) == lane}
        assert set(told) == inside and len(told) == len(inside), f"{lane}: {told} are not {inside}"
        found = [self.jobs[one] for one in told]
        assert [one.priority for one in found] == sorted(one.priority for one in found), f"{lane}: not by priority"
        for priority in {one.priority for one in found}:
            untouched = [one.number for one in found if one.priority == priority and not one.moved]
            assert untouched == sorted(untouched), f"{lane}: a later job stands before an earlier one that nobody moved"
        stayed = [one for one in self.lanes[lane] if one in inside]
        assert [one for one in told if one in stayed] == stayed, f"{lane}: who stood there changed places"
        self.lanes[lane] = told
