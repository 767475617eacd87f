"""Faults by script on the simulated cell: one incident with its first cause, what followed, who saw and who reset it; samples against the plant."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest

from cellctl.domain.channels import INTERLOCK_BITS
from cellctl.domain.states import State
from cellctl.store import Store, alarms, open_store, upgrade
from cellctl.store.alarms import Incident
from cellctl.store.engine import DATABASE
from cellctl.store.history import samples_of
from cellctl.store.trends import trend
from tests.cell.harness import UNIX_START, CellUnderTest
from tests.cell.jobs import FEED_MM_S


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "store"
    upgrade(folder)
    return folder


@pytest.fixture
async def served(made: Path, folder: Path) -> AsyncIterator[tuple[CellUnderTest, Store]]:
    """A cell on a whole store, and the web's view of it."""
    shutil.copytree(made, folder / "store")
    store = open_store(folder / "store")
    async with CellUnderTest(folder / "store" / DATABASE) as cell:
        yield cell, store
    store.close()


def history(cell: CellUnderTest, store: Store) -> list[Incident]:
    cell._commit()
    with store.read_cell() as rows:
        return alarms.incidents(rows, None, 100)


async def reset(cell: CellUnderTest, because: str) -> None:
    await cell.forward(until=lambda: not cell.controller.quiesce_pending, seconds=10.0)
    reply = await cell.command("reset", because=because)
    assert reply.ok, reply.error
    await cell.forward(until=lambda: cell.state is not State.RESETTING, seconds=8.0)


async def test_a_door_and_then_the_estop_are_one_incident_whose_first_cause_is_the_door(served: tuple[CellUnderTest, Store]) -> None:
    cell, store = served
    await cell.deposit(length_mm=60.0)
    cell.sim.open_door()
    opened_at = cell.unix()
    await cell.forward(until=lambda: "door" in cell.latched, seconds=2.0)
    await cell.forward(seconds=0.5)
    cell.sim.press_estop()
    await cell.forward(until=lambda: "estop" in cell.latched, seconds=2.0)
    (one,) = history(cell, store)
    assert one.first.code == "door" and [told.code for told in one.followed] == ["estop"]
    assert 0.0 <= one.at - opened_at < 0.3 and one.ended_at is None and one.job == "job-1"
    assert one.first.line is not None and one.first.layer == 0 and "close the door" in one.first.remedy
    await cell.forward(seconds=3.0)
    cell.sim.release_estop()
    cell.sim.close_door()
    await cell.forward(seconds=2.0)
    await reset(cell, "door closed again, E-stop released")
    ended = history(cell, store)[0]
    assert ended.id == one.id and ended.ended_at is not None and ended.ended_at > one.at + 3.0
    assert (ended.reset_by, ended.because) == ("tester", "door closed again, E-stop released")


async def test_a_silent_feeder_is_a_cause_of_its_own_and_the_next_incident_begins_behind_the_reset(served: tuple[CellUnderTest, Store]) -> None:
    cell, store = served
    await cell.deposit(length_mm=60.0)
    cell.sim.faults.add("modbus_silent feeder")
    await cell.forward(until=lambda: "feeder_silent" in cell.latched, seconds=5.0)
    await cell.forward(seconds=1.0)
    cell.sim.faults.add("modbus_ok feeder")
    await cell.forward(seconds=2.0)
    await reset(cell, "cable")
    cell.sim.press_estop()
    await cell.forward(until=lambda: "estop" in cell.latched, seconds=2.0)
    newer, older = history(cell, store)
    assert (older.first.code, older.followed, older.because, newer.first.code, newer.ended_at) == ("feeder_silent", (), "cable", "estop", None)
    with store.read_cell() as rows:
        assert [one.id for one in alarms.incidents(rows, newer.id, 9)] == [older.id]
        assert [one.id for one in alarms.incidents(rows, None, 9, code="feeder_silent")] == [older.id]
        assert alarms.incident(rows, newer.first.seq) == newer and alarms.active(rows) == newer


async def test_acknowledging_shows_everywhere_changes_nothing_at_the_machine_and_is_harmless_twice(served: tuple[CellUnderTest, Store]) -> None:
    cell, store = served
    await cell.deposit(length_mm=60.0)
    cell.sim.open_door()
    await cell.forward(until=lambda: "door" in cell.latched, seconds=2.0)
    for name in ("first", "second"):
        reply = await cell.command("acknowledge", f"{name}-{cell.unix()}", codes=["door", "chiller"], client=f"console of {name}")
        assert reply.ok, reply.error
        assert reply.data["acknowledged"] == (["door"] if name == "first" else [])
        assert cell.state is State.FAULT and cell.latched == ["door"]
    assert [alarm.acknowledged_by for alarm in cell.snapshot.alarms] == ["tester"]
    (one,) = history(cell, store)
    assert one.first.acknowledged_by == "tester" and one.first.acknowledged_at is not None and one.ended_at is None
    assert sum(event.kind == "acknowledge" for event in cell.events) == 1
    await cell.kill()
    await cell.power_up(until_idle=False)
    await cell.forward(ticks=5)
    assert {alarm.code: alarm.acknowledged_by for alarm in cell.snapshot.alarms}["door"] == "tester"
    (again,) = history(cell, store)
    assert again.id == one.id and again.first.acknowledged_by == "tester" and again.first.code == "door"


@pytest.mark.parametrize("codes", [None, [], [3], "door"])
async def test_an_acknowledgement_that_names_no_alarm_is_refused(served: tuple[CellUnderTest, Store], codes: object) -> None:
    cell, _ = served
    reply = await cell.command("acknowledge", codes=codes)
    assert not reply.ok and "codes" in reply.error


async def test_samples_of_a_run_are_what_the_plant_itself_did(served: tuple[CellUnderTest, Store]) -> None:
    cell, store = served
    plant: list[tuple[float, float, float]] = []
    await cell.deposit(length_mm=60.0)
    for _ in range(400):
        await cell.forward(ticks=1)
        plant.append((cell.unix(), cell.sim.laser_emission_w, cell.sim.tip_speed_mm_s))
    cell._commit()
    at, watts, speed = np.array(plant).T
    with store.read_cell() as rows:
        found = trend(rows, at[0], at[-1], 5000, ("laser_readback_w", "tip_speed_mm_s", "planner_fill_percent", "powder_readback_g_min"))
        last = samples_of(rows, "job-1")[-1]
    assert found.made_of == 0 and len(found.at) > 20
    laser, tip = found.mean[:, 0], found.mean[:, 1]
    assert np.abs(laser - np.interp(found.at, at, watts)).max() < 0.1 * watts.max()
    is_steady = np.array([np.abs(speed[(at > t - 0.3) & (at <= t)] - FEED_MM_S).max(initial=0.0) < 0.3 for t in found.at])
    assert is_steady.sum() > 8
    np.testing.assert_allclose(tip[is_steady], FEED_MM_S, rtol=0.08)
    assert (found.greatest[:, 2] > 0.0).any() and (found.least[:, 3] > 0.0).all()
    assert last["interlocks"] == 2 ** len(INTERLOCK_BITS) - 1 and last["feed_override_percent"] == 100.0 and last["laser_override_percent"] == 100.0


async def test_without_a_job_a_step_is_there_at_once_and_stillness_every_ten_seconds(served: tuple[CellUnderTest, Store]) -> None:
    cell, store = served
    await cell.forward(until=cell.is_state(State.IDLE), seconds=10.0)
    began = cell.unix()
    await cell.forward(seconds=21.5)
    cell.sim.open_door()
    opened_at = cell.unix()
    await cell.forward(seconds=3.0)
    cell._commit()
    with store.read_cell() as rows:
        rows_ = [row for row in samples_of(rows, "") if row["at"] > began]
    still = [row["at"] for row in rows_ if row["at"] < opened_at - 1.5]
    assert 2 <= len(still) <= 4 and (np.diff(still) <= 10.5).all()
    is_closed = [(row["at"], bool(row["interlocks"] & 2)) for row in rows_]
    last_closed = max(at for at, closed in is_closed if closed)
    first_open = min(at for at, closed in is_closed if not closed)
    assert opened_at - 1.1 <= last_closed <= opened_at <= first_open < opened_at + 1.5
    assert began > UNIX_START
