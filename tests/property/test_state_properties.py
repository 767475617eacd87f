"""Random commands, faults and waits: whatever comes, the tables and the plant keep the invariants."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellctl.domain.states import ACTIVE, IN_JOB, LATCHED, State, Trigger, WrongStateError, after
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

TABLE_SEQUENCES = 200
HEARD_S = 0.03  # a tick, a request and the ramp
STATUS_S = 0.15  # a status period, a tick, a request
DEAD_MAN_S = 0.55  # a laser that cannot be reached turns itself off after dead_man_s
PLANT_SEQUENCES = 4  # each is some ten seconds of a whole cell


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


FAULTS = [
    "door_open", "door_close", "fume_fail", "fume_ok", "gas_low", "gas_ok", "laser_fault", "feeder_clog", "feeder_clear", "feed_hold",
    "cycle_start", "alarm 1", "firmware_reset", "lost_ok", "doubled_ok", "serial_silent", "serial_ok", "estop_press", "estop_release",
    "modbus_silent laser", "modbus_ok laser", "modbus_silent feeder", "modbus_ok feeder", "modbus_silent io", "modbus_ok io",
    "modbus_exception laser", "serial_garble",
]  # fmt: skip
COMMANDS = ["hold", "resume", "abort", "stop", "reset", "home", "unlock"]
ACTIONS = st.one_of(
    st.tuples(st.just("fault"), st.sampled_from(FAULTS)),
    st.tuples(st.just("command"), st.sampled_from(COMMANDS)),
    st.tuples(st.just("wait"), st.sampled_from(["0.05", "0.3", "1.0"])),
    st.tuples(st.just("kill"), st.just("")),
)


async def live_through(actions: list[tuple[str, str]], folder: Path) -> State:
    """A job, and what happens to it; then quiet, and what has to hold then."""
    async with CellUnderTest(folder / "store.db") as cell:
        program = one_wall(cell.facts, layers=1, length_mm=60.0, pieces=15)
        await cell.start(program)
        await cell.hurry(cell.is_depositing)
        is_deaf = False
        assert cell.max_standstill_emission_w == 0.0
        for kind, what in actions:
            if kind == "fault":
                cell.sim.faults.add(what)
                await cell.forward(ticks=1)
            elif kind == "command":
                await cell.command(what)
            elif kind == "wait":
                await cell.forward(seconds=float(what))
            else:
                await cell.kill()
                await cell.forward(seconds=0.55)
                assert cell.is_dark, "dead-man"
                await cell.power_up(until_idle=False)
            is_deaf = is_deaf or what in ("modbus_silent laser", "modbus_exception laser")
            if cell.state in LATCHED:
                await cell.forward(seconds=DEAD_MAN_S if is_deaf else HEARD_S)
                assert cell.is_dark
        await cell.command("stop")
        await cell.forward(seconds=DEAD_MAN_S if is_deaf else HEARD_S)
        assert cell.is_dark and cell.state is State.STOPPED
        assert cell.standstill_s <= (DEAD_MAN_S if is_deaf else STATUS_S), "light at standstill"
        await cell.forward(seconds=2.0)
        assert cell.is_still or cell.sim.cnc.is_cut_off
        assert cell.snapshot.lines.executed <= len(program.lines)
        assert len(cell.journal.find().unfinished) <= (1 if cell.controller.run is not None else 0)
        return cell.state


@pytest.mark.slow
@settings(max_examples=20 * PLANT_SEQUENCES, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(ACTIONS, min_size=1, max_size=8))
def test_over_many_sequences_no_light_stays_at_standstill_or_behind_a_latched_fault(
    actions: list[tuple[str, str]],
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        assert asyncio.run(live_through(actions, Path(folder))) is State.STOPPED


@settings(max_examples=PLANT_SEQUENCES, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(ACTIONS, min_size=1, max_size=4))
def test_whatever_happens_to_a_job_no_light_stays_at_standstill_or_behind_a_latched_fault(
    actions: list[tuple[str, str]],
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        assert asyncio.run(live_through(actions, Path(folder))) is State.STOPPED
