"""When a queued job starts by itself, for whom, how often it is tried again, and what takes a confirmation of the table away."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from cellctl.api.cell_link import CellLink
from cellctl.api.runs import RETRIED, Runs
from cellctl.domain.jobs import JobState
from cellctl.domain.messages import Reply
from cellctl.domain.snapshot import Control, Snapshot, Table
from cellctl.store import Store, jobs
from cellctl.store.fleet import Seat
from cellctl.store.jobs import JobRow
from config.by_hand import ByHand
from tests.unit.cellctl.test_store import job_in, part_in

NOT_READY = Reply("", False, "the laser does not answer", "look at its power", kind="readiness")
TABLE = Reply("", False, "the door was open after the table was found clear", "look again", kind="table")
CONTROL = Reply("", False, "start: ben has control", "take it over", kind="control")
UNFIT = Reply("", False, "the program was posted for another cell", "post the plan again")


@dataclass
class FarCell:
    """What the web sees of a cell: the snapshot that it shows, and its answers to starts, the last one for ever."""

    fresh: Snapshot
    answers: list[Reply]
    asked: list[dict[str, Any]] = field(default_factory=list)

    async def command(self, verb: str, who: str, because: str, args: dict[str, Any], **more: Any) -> Reply:
        self.asked.append({"verb": verb, "who": who, **args, **more})
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


def idle(control: Control | None = None, disturbed_at: float = 0.0, because: str = "") -> Snapshot:
    return Snapshot(1, 0.0, "c", "sim", "IDLE", "READY", control=control, table=Table(disturbed_at, because))


def runs_of(store: Store, far: FarCell, **facts: float) -> Runs:
    """As a web process that has just started has it."""
    return Runs(store, cast(CellLink, far), lambda job: None, ByHand.model_validate(facts), Seat("cell"))


@pytest.fixture
def job(store: Store) -> JobRow:
    """Queued, with a table that anna found clear at her tablet."""
    row = job_in(store, part_in(store), state=JobState.QUEUED)
    with store.write() as rows:
        jobs.change(rows, row.id, approved_by="eve", program_sha256="0" * 64)
        return jobs.confirm_table(rows, row.id, store.clock(), "anna", "anna/tablet")


def now(store: Store, job: JobRow) -> JobRow:
    with store.read() as rows:
        return jobs.get(rows, job.id)


async def test_a_start_acts_for_the_client_that_confirmed_the_table_also_after_the_web_process_was_restarted(store: Store, job: JobRow) -> None:
    far = FarCell(idle(Control("anna", "anna/tablet", 0.0)), [Reply("", True)])
    await runs_of(store, far)._start_next()
    assert [(asked["who"], asked["client"], asked["job"]) for asked in far.asked] == [("anna", "anna/tablet", job.id)]
    assert far.asked[0]["confirmed_at"] == job.timestamps["table_clear"]


async def test_a_job_waits_for_control_while_another_client_has_it_and_keeps_its_confirmation(store: Store, job: JobRow) -> None:
    far = FarCell(idle(Control("ben", "ben/desk", 0.0)), [Reply("", True)])
    runs = runs_of(store, far)
    await runs._start_next()
    waiting = now(store, job)
    assert far.asked == [] and waiting.table_clear
    assert waiting.why.startswith("waits for control: ben has it; anna may take it over")
    far.fresh = idle()
    await runs._start_next()
    assert len(far.asked) == 1


async def test_a_cell_that_is_not_ready_for_a_moment_is_asked_again_under_another_id(store: Store, job: JobRow) -> None:
    far = FarCell(idle(), [NOT_READY, NOT_READY, Reply("", True)])
    runs = runs_of(store, far, start_retry_s=30.0)
    for _ in range(3):
        await runs._start_next()
        assert now(store, job).table_clear
    assert now(store, job).why.startswith(RETRIED)
    assert len({asked["ident"] for asked in far.asked}) == 3
    assert {asked["confirmed_at"] for asked in far.asked} == {job.timestamps["table_clear"]}


async def test_a_cell_that_stays_unready_has_the_table_looked_at_again(store: Store, job: JobRow) -> None:
    far = FarCell(idle(), [NOT_READY])
    runs = runs_of(store, far, start_retry_s=0.0)
    for _ in range(3):
        await runs._start_next()
    withdrawn = now(store, job)
    assert not withdrawn.table_clear and "the laser does not answer" in withdrawn.why
    assert len(far.asked) == 1 and withdrawn.state is JobState.QUEUED


@pytest.mark.parametrize(("answer", "keeps"), [(TABLE, False), (UNFIT, False), (CONTROL, True)])
async def test_a_refusal_tells_why_and_takes_the_confirmation_away_unless_only_control_was_missing(
    store: Store, job: JobRow, answer: Reply, keeps: bool
) -> None:
    far = FarCell(idle(), [answer])
    runs = runs_of(store, far)
    await runs._start_next()
    after = now(store, job)
    assert after.table_clear is keeps and answer.error in after.why
    await runs._start_next()
    assert len(far.asked) == (2 if keeps else 1)


@pytest.mark.parametrize("what", ["disturbed", "old"])
async def test_a_table_that_was_disturbed_or_looked_at_long_ago_is_not_started_on(store: Store, job: JobRow, what: str) -> None:
    table = (job.timestamps["table_clear"] + 1.0, "the door was open") if what == "disturbed" else ()
    with store.write() as rows:
        if what == "old":
            jobs.confirm_table(rows, job.id, store.clock() - 1000.0, "anna", "anna/tablet")
    far = FarCell(idle(None, *table), [Reply("", True)])
    await runs_of(store, far, table_confirmed_s=900.0)._start_next()
    after = now(store, job)
    assert far.asked == [] and not after.table_clear
    assert ("the door was open" if what == "disturbed" else "15 min ago") in after.why


async def test_two_jobs_are_not_started_on_one_table(store: Store, job: JobRow) -> None:
    other = job_in(store, job.part_id, state=JobState.QUEUED)
    with store.write() as rows:
        jobs.change(rows, other.id, program_sha256="0" * 64)
        jobs.confirm_table(rows, other.id, store.clock(), "anna", "anna/tablet")
    far = FarCell(idle(), [Reply("", True)])
    await runs_of(store, far)._start_next()
    assert [asked["job"] for asked in far.asked] == [job.id]
