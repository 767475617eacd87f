"""Which cell takes a job for any, what a dead cell gives back, and what is told of a job that stays."""

from __future__ import annotations

import itertools

import msgspec
import pytest

from cellctl.domain.dispatch import (
    GIVEN_BACK,
    Candidate,
    Holding,
    Pending,
    Work,
    choose,
    is_given_back,
    why_it_stays,
    work_before,
)
from cellctl.domain.fitting import CellFacts, JobNeeds, ToolFacts
from cellctl.domain.fleet import ANY, DEAD_S, HEARTBEAT_S, LEASE_S, is_dead, is_living
from cellctl.domain.jobs import ENDED, ON_CELL, STEPS, JobState

J = JobState
UP = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
SMALL = JobNeeds("deposit", "316L", (10.0, 10.0, 10.0), (UP,))
LARGE = msgspec.structs.replace(SMALL, size_mm=(10.0, 10.0, 90.0))


def cell(name: str, height: float = 50.0, jobs: int = 0, s: float = 0.0, answers: bool = True) -> Candidate:
    facts = CellFacts(name, (-50.0, -50.0, 0.0), (50.0, 50.0, height), (0.0, 0.0, 0.0), 0.0, (ToolFacts(1, "deposition", 2.0, 1.0),))
    return Candidate(facts, Work(jobs, s), answers)


def test_a_cell_is_given_work_while_it_is_heard_and_loses_it_long_after() -> None:
    assert 3 * HEARTBEAT_S < LEASE_S < DEAD_S
    assert is_living(LEASE_S - 0.1) and not is_living(LEASE_S)
    assert not is_dead(DEAD_S - 0.1) and is_dead(DEAD_S)


@pytest.mark.parametrize(
    ("needs", "cells", "chosen"),
    [
        (SMALL, [cell("a"), cell("b")], "a"),
        (SMALL, [cell("a", jobs=1, s=60.0), cell("b")], "b"),
        (SMALL, [cell("a", jobs=1, s=600.0), cell("b", jobs=3, s=90.0)], "b"),
        (SMALL, [cell("a", jobs=2, s=90.0), cell("b", jobs=1, s=90.0)], "b"),
        (SMALL, [cell("a", answers=False), cell("b", jobs=9, s=9e9)], "b"),
        (SMALL, [cell("a", answers=False)], "a"),
        (LARGE, [cell("a"), cell("b", height=100.0, jobs=9, s=9e9)], "b"),
        (LARGE, [cell("a")], ""),
        (SMALL, [], ""),
    ],
)
def test_the_fitting_cell_with_the_least_work_takes_a_job(needs: JobNeeds, cells: list[Candidate], chosen: str) -> None:
    for order in itertools.permutations(cells):  # every host decides the same, in whatever order it reads them
        assert choose(needs, order).cell == chosen


def test_a_job_that_fits_none_says_why_of_each() -> None:
    because = choose(LARGE, [cell("b"), cell("a", height=60.0)]).because
    assert because == (
        "waits for a cell that it fits: size: the part is 90.0 mm in Z on the table, the build volume of a 60.0 mm; "
        "size: the part is 90.0 mm in Z on the table, the build volume of b 50.0 mm"
    )
    assert choose(SMALL, []).because == "waits for a cell: none is heard"
    assert choose(LARGE, [cell(f"c{k}") for k in range(6)]).because.endswith("; and 2 more")
    busy = [cell("a", jobs=1, s=1.0), cell("b", jobs=1, s=2.0)]
    assert choose(SMALL, busy).because == "given to a: 1 job before it, the least of those that it fits"


def test_work_is_told_by_time_and_where_no_time_is_known_by_count() -> None:
    assert work_before([Pending("a", 0.0), Pending("a", 0.0), Pending("b", 0.0)]) == {"a": Work(2, 2.0), "b": Work(1, 1.0)}
    known = [Pending("a", 100.0, 0.25), Pending("a", 0.0), Pending("b", 300.0, 1.0)]
    assert work_before(known) == {"a": Work(2, 75.0 + 200.0), "b": Work(1, 0.0)}


def test_only_an_unstarted_unclaimed_job_for_any_that_has_no_part_on_the_table_is_given_back() -> None:
    for state, wanted, claimed, continues in itertools.product(JobState, (ANY, "a"), (False, True), (False, True)):
        free = wanted == ANY and not claimed and not continues and state in GIVEN_BACK
        assert is_given_back(Holding(state, wanted, claimed, continues)) == free
    assert not GIVEN_BACK & (ENDED | ON_CELL)
    assert all(state is J.SUBMITTED or (state, J.SUBMITTED) in STEPS for state in GIVEN_BACK)


@pytest.mark.parametrize(
    ("job", "told"),
    [
        (Holding(J.RUNNING, ANY, False, False), "a has not been heard since noon: its part lies on that table"),
        (Holding(J.INTERRUPTED, "a", False, False), "a has not been heard since noon: its part lies on that table"),
        (Holding(J.QUEUED, ANY, True, False), "a has not been heard since noon: it was about to be started there"),
        (Holding(J.QUEUED, "a", False, True), "a has not been heard since noon: the part that it goes on with lies on that table"),
        (Holding(J.PROVING, "a", False, False), "a has not been heard since noon: it was meant for that cell"),
        (Holding(J.PROVING, ANY, False, False), "a has not been heard since noon"),
        (Holding(J.COMPLETED, ANY, False, False), ""),
    ],
)
def test_a_job_of_a_silent_cell_says_why_it_stays(job: Holding, told: str) -> None:
    assert why_it_stays(job, "a", "noon") == told
