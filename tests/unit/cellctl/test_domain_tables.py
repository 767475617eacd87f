"""The tables of states, jobs, reactions and permissives."""

from __future__ import annotations

import msgspec
import pytest

from cellctl.domain import diagrams, jobs, states
from cellctl.domain.interlocks import LEVEL_WORDS, NAMES, Levels, Signal, may_emit, permissives
from cellctl.domain.jobs import ENDED, JobState, WrongJobStateError
from cellctl.domain.reactions import INTERLOCK_CAUSE, REACTIONS, explain
from cellctl.domain.snapshot import Permissive
from cellctl.domain.states import EXECUTION, HINTS, REST_OF, TRANSITIONS, State, Trigger, WrongStateError, after
from config.reactions import DEFAULTS

COMMANDS = (
    Trigger.HOLD,
    Trigger.RESUME,
    Trigger.ABORT,
    Trigger.STOP,
    Trigger.RESET,
    Trigger.HOME,
    Trigger.UNLOCK,
    Trigger.JOG,
    Trigger.START,
)


@pytest.mark.parametrize("state", State)
def test_stop_leads_to_stopped_from_every_state(state: State) -> None:
    assert after(state, Trigger.STOP) is State.STOPPED


@pytest.mark.parametrize("state", State)
def test_a_fault_latches_from_every_state(state: State) -> None:
    assert after(state, Trigger.FAULTED) in states.LATCHED


@pytest.mark.parametrize("state", [State.FAULT, State.STOPPED])
def test_what_is_latched_leaves_by_reset_alone(state: State) -> None:
    leaving = {trigger for (source, trigger), target in TRANSITIONS.items() if source is state and target is not state}
    assert leaving <= {Trigger.RESET, Trigger.STOP}


def test_running_is_entered_only_from_verified_preparation_or_resumption() -> None:
    sources = {source for (source, _), target in TRANSITIONS.items() if target is State.RUNNING}
    assert sources == {State.PREPARING, State.RESUMING}


def test_every_state_can_be_reached_and_every_state_can_reach_idle() -> None:
    def reach(start: State) -> set[State]:
        found, todo = {start}, [start]
        while todo:
            here = todo.pop()
            for (source, _), target in TRANSITIONS.items():
                if source is here and target not in found:
                    found.add(target)
                    todo.append(target)
        return found

    assert reach(State.OFFLINE) == set(State)
    assert all(State.IDLE in reach(state) for state in State)


def test_what_is_not_in_the_table_raises_with_one_line() -> None:
    with pytest.raises(WrongStateError, match="resume is not possible while the cell is IDLE"):
        after(State.IDLE, Trigger.RESUME)


def test_every_state_has_a_word_of_mtconnect_and_every_command_a_hint_or_a_way_from_everywhere() -> None:
    assert set(EXECUTION) == set(State)
    assert set(EXECUTION.values()) <= {
        "READY",
        "ACTIVE",
        "INTERRUPTED",
        "FEED_HOLD",
        "STOPPED",
        "PROGRAM_COMPLETED",
        "WAIT",
    }
    assert all(command in HINTS for command in COMMANDS if command is not Trigger.STOP)
    assert set(REST_OF) <= set(COMMANDS)


def test_the_diagram_names_every_arrow_of_the_table() -> None:
    drawn = states.mermaid()
    for (source, trigger), target in TRANSITIONS.items():
        if trigger not in (Trigger.STOP, Trigger.FAULTED) and source is not target:
            assert any(
                line.strip().startswith(f"{source} --> {target}:") and trigger.value in line
                for line in drawn.splitlines()
            )


def test_a_job_that_has_ended_stays_ended() -> None:
    for state in ENDED:
        for target in JobState:
            with pytest.raises(WrongJobStateError):
                jobs.step(state, target)


def test_a_job_runs_only_after_it_was_approved() -> None:
    before_running = {a for a, b in jobs.STEPS if b is JobState.RUNNING}
    assert before_running == {JobState.QUEUED, JobState.HELD}
    assert {a for a, b in jobs.STEPS if b is JobState.QUEUED} == {JobState.WAITING_FOR_APPROVAL}


@pytest.mark.parametrize("code", REACTIONS)
def test_every_reaction_tells_cause_and_remedy_without_gaps(code: str) -> None:
    cause, remedy = explain(code)
    assert cause and remedy and "{" not in cause + remedy and "\n" not in cause + remedy


FRESH = Signal(1.0, 0.01, 0.25)
CLEAR = Signal(0.0, 0.01, 0.25)


def good_levels(**changes: object) -> Levels:
    fields: dict[str, object] = {
        "is_running": True, "is_depositing": True, "is_moving": True, "cnc_state": "Run", "cnc_age_s": 0.1, "laser_enabled": True,
        "interlocks": dict.fromkeys(INTERLOCK_CAUSE, FRESH), "laser_words": {"fault_word": CLEAR, "interlock_word": CLEAR},
        "feeder_words": {"fault_word": CLEAR}, "head": FRESH, "heartbeats": {"laser": FRESH, "feeder": FRESH, "io": FRESH},
    }  # fmt: skip
    return Levels(**{**fields, **changes})  # type: ignore[arg-type]


def test_emission_is_allowed_when_every_level_is_good() -> None:
    assert may_emit(permissives(good_levels()))


LOST: dict[str, dict[str, object]] = {
    "not running": {"is_running": False},
    "fault latched": {"is_faulted": True},
    "no depositing pass": {"is_depositing": False},
    "standstill": {"is_moving": False},
    "hold": {"cnc_state": "Hold"},
    "stale status": {"cnc_age_s": 0.5},
    "laser not enabled": {"laser_enabled": False},
    "laser fault": {"laser_words": {"fault_word": FRESH}},
    "laser never read": {"laser_words": {}},
    "stale feeder": {"feeder_words": {"fault_word": Signal(0.0, 0.25, 0.25)}},
    "head not deployed": {"head": CLEAR},
    "stale head": {"head": Signal(1.0, 0.5, 0.5)},
    "no heartbeat": {"heartbeats": {"laser": Signal(1.0, 1.0, 0.25)}},
    "no heartbeats known": {"heartbeats": {}},
    "age unknown": {"cnc_age_s": float("nan")},
    **{f"{name} open": {"interlocks": {**dict.fromkeys(INTERLOCK_CAUSE, FRESH), name: CLEAR}} for name in INTERLOCK_CAUSE},
    **{f"{name} stale": {"interlocks": {**dict.fromkeys(INTERLOCK_CAUSE, FRESH), name: Signal(1.0, 0.3, 0.25)}} for name in INTERLOCK_CAUSE},
    **{f"{name} missing": {"interlocks": {n: FRESH for n in INTERLOCK_CAUSE if n != name}} for name in INTERLOCK_CAUSE},
}  # fmt: skip


@pytest.mark.parametrize("change", LOST.values(), ids=LOST.keys())
def test_one_lost_level_takes_the_permit_away_and_says_why(change: dict[str, object]) -> None:
    conditions = permissives(good_levels(**change))
    assert not may_emit(conditions)
    assert all(condition.why for condition in conditions if not condition.ok)


@pytest.mark.parametrize("change", [{}, *LOST.values()], ids=["good", *LOST])
def test_every_permissive_tells_its_level_and_age_in_numbers_that_json_knows(change: dict[str, object]) -> None:
    conditions = permissives(good_levels(**change))
    assert tuple(condition.name for condition in conditions) == NAMES
    assert all(condition.level for condition in conditions)
    decoded = msgspec.json.decode(msgspec.json.encode(conditions), type=list[Permissive])
    assert decoded == conditions
    for condition in conditions:
        assert (condition.age_s < 0) == (condition.stale_s == 0), "either nothing is read, or age and limit are both told"
        assert not condition.ok or condition.age_s < max(condition.stale_s, 0.0) or condition.stale_s == 0


def test_every_interlock_is_a_permissive_of_its_own() -> None:
    assert set(INTERLOCK_CAUSE.values()) == set(LEVEL_WORDS) <= set(NAMES)


def test_there_are_words_for_every_reaction_and_a_reaction_for_all_words() -> None:
    assert set(DEFAULTS) == set(REACTIONS)


def test_no_conditions_at_all_are_no_permit() -> None:
    assert not may_emit([])


def test_the_document_shows_the_tables_as_they_are() -> None:
    assert diagrams.FILE.read_text(encoding="utf-8") == diagrams.document(), "run python -m cellctl.domain.diagrams"


def test_the_picture_of_the_jobs_has_an_arrow_for_every_row_of_the_table() -> None:
    drawn = jobs.mermaid().splitlines()
    for (state, event), target in jobs.TRANSITIONS.items():
        sources = (state.value, "before_the_cell")
        assert any(f"    {source} --> {target.value}: {event.value}" in drawn for source in sources)


def test_every_state_of_a_job_is_reached_and_none_is_left_by_what_the_table_has_not() -> None:
    assert {jobs.after(state, event) for state, event in jobs.TRANSITIONS} == set(JobState)
    with pytest.raises(KeyError):
        jobs.after(JobState.COMPLETED, jobs.JobEvent.RESUMED)
