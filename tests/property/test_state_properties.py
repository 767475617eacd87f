"""Random commands, faults and waits: whatever comes, the tables and the plant keep the invariants."""

from __future__ import annotations

from ast import literal_eval

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.domain.states import ACTIVE, IN_JOB, LATCHED, State, Trigger, WrongStateError, after
from tests.cell.faults.walk import Violation, gate_of, shrunk, walk

TABLE_SEQUENCES = 200
WALKS, SEQUENCES = 20, 25  # 500 sequences of commands, faults, repairs, time and kills; `make bench` has 10,000


@settings(max_examples=TABLE_SEQUENCES)
@given(st.lists(st.sampled_from(list(Trigger)), max_size=60))
def test_no_sequence_of_triggers_leaves_a_latched_state_without_reset_or_runs_without_preparation(
    triggers: list[Trigger],
) -> None:
    state = State.OFFLINE
    prepared = False
    for trigger in triggers:
        before = state
        try:
            state = after(state, trigger)
        except WrongStateError:
            assert state is before
            continue
        if before in LATCHED and state not in LATCHED:
            assert trigger is Trigger.RESET
        if state is State.RUNNING and before is not State.RUNNING:
            assert prepared, "RUNNING comes only out of PREPARING or RESUMING"
        prepared = state in (State.PREPARING, State.RESUMING)
        if before not in IN_JOB and state in ACTIVE:
            assert trigger is Trigger.START


@pytest.mark.parametrize("seed", range(WALKS))
def test_over_a_random_walk_of_commands_faults_repairs_and_kills_the_plant_keeps_the_invariants(seed: int) -> None:
    found = Walked(seed)
    assert not found.text, found.text


class Walked:
    """A walk, and if it went wrong the fewest of its steps that do."""

    def __init__(self, seed: int) -> None:
        self.text = ""
        try:
            walk(seed, SEQUENCES)
        except Violation as violation:
            steps = literal_eval(str(violation).splitlines()[-1])
            gate = gate_of(seed)
            self.text = f"{str(violation).splitlines()[0]}\nthe fewest steps:\n{shrunk(seed, steps, gate)!r}"
