"""Whatever people, planner and cell do with jobs, in whatever order: over REST they are told as `job_model` has it, and nothing else starts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import invariant, precondition, rule, run_state_machine_as_test

from cellctl.domain.jobs import JobState, WrongJobStateError
from cellctl.store import jobs
from config import find_facts, load_cell
from tests.unit.cellctl.interrupted import wall_in
from tests.unit.cellctl.job_life_driven import PROGRAM, Driven
from tests.unit.cellctl.job_model import BEFORE_CELL, ENDED, LANE_OF, ON_CELL, PLANNER, REST, Job

EXAMPLES, STEPS = 5, 25  # 5 s of one core; `-m slow` has a hundred times as many
JOBS_MAX = 7
PICK = st.integers(0, 60)
UNTIL = st.sampled_from(["completed", "cleared"])
TAGS = st.lists(st.sampled_from("xyz"), max_size=2)


class Life(Driven):
    """Rules are what people, planner, cell and time do; after each the service is told as the model has it."""

    # What people do.

    @precondition(lambda self: len(self.shop.jobs) < JOBS_MAX)
    @rule(priority=st.sampled_from([5, 5, 5, 1, 9]), after=st.lists(st.tuples(PICK, UNTIL), max_size=1), tags=TAGS)
    def submit(self, priority: int, after: list[tuple[int, str]], tags: list[str]) -> None:
        wanted = [(self.job(pick), until) for pick, until in after]
        ok = not any(until == "completed" and other.state in ENDED and other.state != "completed" for other, until in wanted)
        body = {"part_id": self.served.part_id, "recipe": {"process": "deposit"}, "priority": priority, "tags": tags}
        told = self.post("/jobs", ok, {**body, "after": [{"job": other.id, "until": until} for other, until in wanted]})
        if ok:
            self.made(told, priority=priority, after={(other.id, until) for other, until in wanted}, tags=sorted(set(tags)))

    @rule(pick=PICK, looked=st.booleans(), reason=st.booleans())
    def approve(self, pick: int, looked: bool, reason: bool) -> None:
        job = self.job(pick)
        ok = job.state == "queued" or (job.state == "waiting_for_approval" and (job.passed or reason))
        ok = ok and not (looked and self.shop.running)
        word = "table_clear" if job.continues is None else "part_untouched"
        self.post(f"/jobs/{job.id}/approve", ok, {"override_reason": "seen worse" if reason else "", **({word: True} if looked else {})})
        if ok and job.state == "waiting_for_approval":
            self.shop.go(job, "queued")
        if ok and looked:
            self.shop.confirm(job, self.clock.now)
        self.settle()

    @rule(pick=PICK)
    def vouch_for_the_wrong_thing(self, pick: int) -> None:
        job = self.job(pick)
        self.post(f"/jobs/{job.id}/approve", False, {"override_reason": "so", "part_untouched" if job.continues is None else "table_clear": True})

    @rule(pick=PICK)
    def cancel(self, pick: int) -> None:
        job = self.job(pick)
        ok = job.state in (*BEFORE_CELL, "cancelled")
        self.post(f"/jobs/{job.id}/cancel", ok, {"because": "not needed"})
        if job.state in BEFORE_CELL:
            self.shop.go(job, "cancelled")
            job.confirmed_at = None
        self.settle()

    @rule(start=st.none() | PICK)
    def clear_table(self, start: int | None) -> None:
        job = self.job(start) if start is not None else None
        ok = not self.shop.running and (job is None or (job.state == "queued" and job.continues is None))
        self.post("/table/clear", ok, {"because": "looked", **({"start": job.id} if job else {})})
        if ok:
            self.shop.clear()
            if job is not None:
                self.shop.confirm(job, self.clock.now)
        self.settle()

    @rule(pick=PICK, looked=st.booleans())
    def start_by_hand(self, pick: int, looked: bool) -> None:
        job = self.job(pick)
        word = "table_clear" if job.continues is None else "part_untouched"
        may = job.state == "queued" and not (looked and self.shop.running) and (looked or job.confirmed_at is not None)
        if may and looked:
            self.shop.confirm(job, self.clock.now)
        ok = may and self.shop.cell == "IDLE" and not self.shop.hindrances(job, self.clock.now) and self.shop.try_start(job)
        self.post("/cell/start", ok, {"job": job.id, "because": "now", **({word: True} if looked else {})})
        self.settle()

    @rule(verb=st.sampled_from(["hold", "resume", "abort"]))
    def command(self, verb: str) -> None:
        self.post(f"/cell/{verb}", True, {"because": "a person"})
        state = {"hold": "HELD", "resume": "RUNNING"}.get(verb, "")
        if self.shop.running and verb == "abort":
            self.shop.end("aborted", self.clock.now)
        elif self.shop.running and self.shop.cell != state:
            self.shop.cell = state
            self.shop.go(self.shop.jobs[self.shop.running], {"HELD": "held", "RUNNING": "running"}[state])
        self.settle()

    @precondition(lambda self: len(self.shop.jobs) < JOBS_MAX)
    @rule(pick=PICK, how=st.sampled_from(["rerun", "clone", "retry", "retry"]))
    def once_more(self, pick: int, how: str) -> None:
        job = self.job(pick)
        ok = job.continues is None and (how != "retry" or (job.state == "failed" and not job.ran))
        told = self.post(f"/jobs/{job.id}/{how}", ok, {"recipe": {"tolerance_mm": 0.3}} if how == "clone" else {})
        if not ok:
            return
        fields: dict[str, Any] = {"priority": job.priority, "tags": job.tags}
        if how == "retry":
            fields |= {"after": job.after.copy(), "not_before": job.not_before}
            self.hand_over([job], told["id"])
        self.made(told, **fields)

    def hand_over(self, ended: list[Job], to: str) -> None:
        """Who waited for one of these waits for another."""
        gone = {job.id for job in ended}
        for other in self.shop.jobs.values():
            other.after = {(to if on in gone else on, until) for on, until in other.after}

    @precondition(lambda self: len(self.shop.jobs) < JOBS_MAX)
    @rule(pick=PICK)
    def go_on(self, pick: int) -> None:
        job = self.job(pick)
        why = self.shop.why_not_gone_on_with(job)
        assert self.ask("GET", f"/jobs/{job.id}/resumption-point")[1]["possible"] == (not why)
        told = self.post(f"/jobs/{job.id}/resume", not why)
        if not why:
            self.hand_over([job, *(one for one in self.shop.jobs.values() if one.continues == job.id)], told["id"])
            self.made(told, continues=job.id, priority=job.priority, tags=job.tags)

    @rule(pick=PICK, on=st.lists(st.tuples(PICK, UNTIL), max_size=2))
    def wait_for(self, pick: int, on: list[tuple[int, str]]) -> None:
        job, wanted = self.job(pick), [(self.job(other), until) for other, until in on]
        never_comes = any(until == "completed" and other.state in ENDED and other.state != "completed" for other, until in wanted)
        old, job.after = job.after, set()
        is_circle = any(self.shop.would_wait_for_itself(job, other.id) for other, _ in wanted)
        ok = job.state not in (*ENDED, *ON_CELL) and not never_comes and not is_circle
        status, _ = self.ask("PATCH", f"/jobs/{job.id}", {"after": [{"job": other.id, "until": until} for other, until in wanted]})
        assert status == (200 if ok else 409)
        job.after = {(other.id, until) for other, until in wanted} if ok else old
        self.settle()

    @rule(pick=PICK, priority=st.integers(1, 9), later_s=st.none() | st.sampled_from([-1.0, 600.0, 5000.0]), tags=TAGS)
    def edit(self, pick: int, priority: int, later_s: float | None, tags: list[str]) -> None:
        job, at = self.job(pick), None if later_s is None else self.clock.now + later_s
        ok = job.state not in (*ENDED, *ON_CELL)
        status, _ = self.ask("PATCH", f"/jobs/{job.id}", {"priority": priority, "not_before": at, "tags": tags})
        assert status == (200 if ok else 409)
        if ok:
            self.stands_elsewhere(job, job.priority != priority)
            job.priority, job.not_before, job.tags = priority, at, sorted(set(tags))
        self.settle()

    def stands_elsewhere(self, job: Job, is_moved: bool) -> None:
        """It leaves its place in its queue; where it stands then, the service says."""
        if is_moved:
            job.moved = True
            for lane in self.shop.lanes.values():
                lane[:] = [one for one in lane if one != job.id]

    @rule(pick=PICK, to=st.sampled_from(["first", "last", "up", "down"]))
    def move(self, pick: int, to: str) -> None:
        job, lane = self.job(pick), LANE_OF.get(self.job(pick).state, "cell")
        order = self.shop.lanes[lane]
        status, document = self.ask("POST", f"/queue/move?lane={lane}", {"job": job.id, "to": to})
        assert status == (200 if job.id in order else 409), document
        if job.id not in order:
            return
        here = order.index(job.id)
        there = {"first": 0, "last": len(order) - 1, "up": max(here - 1, 0), "down": min(here + 1, len(order) - 1)}[to]
        expected = [one for one in order if one != job.id]
        expected.insert(there, job.id)
        assert [one["id"] for one in document["items"]] == expected
        if there != here:
            around = [self.shop.jobs[one].priority for one in expected]
            low = around[there - 1] if there else 1
            high = around[there + 1] if there + 1 < len(around) else 9
            job.priority, job.moved = min(max(job.priority, low), high), True
            self.shop.lanes[lane] = expected

    @rule(pick=PICK, text=st.sampled_from(["looks good", "listen to the spindle"]))
    def note(self, pick: int, text: str) -> None:
        job = self.job(pick)
        self.post(f"/jobs/{job.id}/notes", True, {"text": text})
        job.notes.append(text)

    # What planner, cell and time do.

    @rule(outcome=st.sampled_from(["passes", "passes", "passes", *PLANNER]), whole=st.sampled_from([True, True, False]))
    def plan(self, outcome: str, whole: bool) -> None:
        """The planner goes on with what it works on, else takes the first of its queue."""
        if not self.work and self.shop.lanes["planning"]:
            first = self.shop.jobs[self.shop.lanes["planning"][0]]
            with self.served.service.store.read() as rows:
                assert [one.id for one in jobs.first_in(rows, JobState.SUBMITTED, 1)] == [first.id]
            self.work = {first.id: list((REST if first.continues else PLANNER)[outcome])}
            self.outcome[first.id] = outcome
        for job_id, steps in list(self.work.items()):
            while steps:
                if not self.planner_moves(self.shop.jobs[job_id], steps.pop(0)) or not whole:
                    break
            if not steps or self.shop.jobs[job_id].state == "cancelled":
                del self.work[job_id]
        self.settle()

    def planner_moves(self, job: Job, states: tuple[str, ...]) -> bool:
        """Whether it could: what was cancelled meanwhile it may not."""
        fields: dict[str, Any] = {}
        if states[-1] == "proving":
            fields = {"program_sha256": PROGRAM, "lines_total": len(self.wall.posted.lines)}
        elif states[-1] == "waiting_for_approval":
            fields = {"proof": {"passed": self.outcome[job.id] == "passes"}}
        elif states[-1] == "failed":
            fields = {"error": {"title": "t", "detail": "d", "hint": "h"}}
        try:
            with self.served.service.store.write() as rows:
                jobs.move(rows, job.id, *map(JobState, states), at=self.clock.now, **fields)
        except WrongJobStateError:
            assert job.state == "cancelled"
            return False
        job.passed = bool(fields.get("proof", {}).get("passed"))
        self.shop.go(job, *states)
        return True

    @rule()
    def service_restarts(self) -> None:
        """What was in work is begun again."""
        self.served.service.queue._resubmit()
        self.work = {}
        for job in self.shop.jobs.values():
            if job.state in ("planning", "posting", "proving"):
                self.shop.go(job, "submitted")

    @precondition(lambda self: self.shop.running)
    @rule(outcome=st.sampled_from(["completed", "completed", "failed"]))
    def run_ends(self, outcome: str) -> None:
        self.far.end(outcome)
        self.shop.end(outcome, self.clock.now)
        self.settle()

    @rule()
    def cell_restarts(self) -> None:
        self.far.restart()
        if self.shop.running:
            self.shop.end("interrupted", self.clock.now)
        self.shop.disturbed_at = self.clock.now
        self.settle()

    @rule()
    def door_is_opened(self) -> None:
        if not self.shop.running:
            self.far.disturb("the door was open")
            self.shop.disturbed_at = self.clock.now
        self.settle()

    @rule(passes_s=st.sampled_from([60.0, 600.0, 1000.0]))
    def time_passes(self, passes_s: float) -> None:
        self.clock.now += passes_s
        self.settle()

    # What holds at all times.

    @invariant()
    def told_as_the_model_has_it(self) -> None:
        told = {one["id"]: one for one in self.ask("GET", "/jobs?limit=100")[1]["items"]}
        assert told.keys() == self.shop.jobs.keys()
        for job in self.shop.jobs.values():
            one = told[job.id]
            assert (one["state"], one["priority"], one["tags"]) == (job.state, job.priority, job.tags), one
            assert {(link["job"], link["until"]) for link in one["after"]} == job.after
            assert (one["cleared_at"] is not None) == job.cleared and one["continues_job"] == job.continues
            if job.state == "queued":
                last = "table" if job.confirmed_at is None else "cell"
                assert one["table_clear"] == (job.confirmed_at is not None)
                assert [wait["kind"] for wait in one["waits_for"]] == [*self.shop.hindrances(job, self.clock.now), last] and one["why"]
        for lane in self.shop.lanes:
            standing = {one.id: one.priority for one in self.shop.jobs.values() if LANE_OF.get(one.state) == lane}
            if self.seen.get(lane) != standing:
                self.seen[lane] = standing
                self.shop.check_order(lane, [one["id"] for one in self.ask("GET", f"/queue?lane={lane}")[1]["items"]])

    @invariant()
    def nothing_else_was_started(self) -> None:
        assert [one for one, *_ in self.far.started] == self.shop.started
        if self.lay != self.shop.on_table:
            self.lay = self.shop.on_table
            assert self.ask("GET", "/table")[1]["job"] == (self.lay or None)


@pytest.fixture(scope="module")
def life(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> Iterator[type[Life]]:
    """The rules, with a store to begin with and a program that metal can have ended on."""
    Life.folder, Life.empty = tmp_path_factory.mktemp("lives"), empty_store
    Life.wall = wall_in(tmp_path_factory.mktemp("wall"), load_cell(find_facts("cells", "trunnion_tcp")))
    yield Life


def lived(life: type[Life], examples: int, steps: int) -> None:
    quiet = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    run_state_machine_as_test(life, settings=settings(max_examples=examples, stateful_step_count=steps, deadline=None, suppress_health_check=quiet))


def test_whatever_happens_to_jobs_they_are_told_and_started_as_the_table_says(life: type[Life]) -> None:
    lived(life, EXAMPLES, STEPS)


@pytest.mark.slow
def test_whatever_happens_to_jobs_for_long_they_are_told_and_started_as_the_table_says(life: type[Life]) -> None:
    lived(life, 50 * EXAMPLES, 2 * STEPS)
