"""Light against what the Program asks for, where the gate stands in the stream and nobody reads it back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall


async def test_a_gate_that_stays_shut_in_a_pass_holds_the_job_with_its_cause(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with CellUnderTest(tmp_path / "s.db") as cell:
        await cell.deposit(layers=1, mill=False)
        monkeypatch.setattr(cell.sim, "_gates", lambda pieces: np.zeros(len(pieces)))
        await cell.forward(until=lambda: "dark_pass" in cell.latched, seconds=1.5)
        assert cell.state is State.FAULT


async def test_light_behind_a_gate_that_stays_open_is_found_though_the_permit_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with CellUnderTest(tmp_path / "s.db") as cell:
        reply = await cell.start(one_wall(cell.facts, layers=1, mill=False))
        assert reply.ok
        await cell.hurry(cell.is_depositing)
        monkeypatch.setattr(cell.sim, "_gates", lambda pieces: np.ones(len(pieces)))
        await cell.forward(until=lambda: "laser_emitting" in cell.latched, seconds=6.0)
        await cell.forward(ticks=5)
        assert cell.is_dark


@pytest.mark.parametrize("gate", [True, False], ids=["stream", "modbus"])
async def test_holds_resumes_and_overrides_amid_passes_are_no_fault_of_the_light(tmp_path: Path, gate: bool) -> None:
    facts = shipped_cell()
    if not gate:
        facts = facts.model_copy(update={"cnc": facts.cnc.model_copy(update={"laser_gate_output": None})})
    async with CellUnderTest(tmp_path / "s.db", cell=facts) as cell:
        await cell.deposit(layers=2, mill=False)
        for ticks, override in ((23, b"\x90" + 5 * b"\x92"), (31, b"\x90"), (7, b"\x90" + 5 * b"\x91"), (47, b"\x90")):
            assert (await cell.command("hold")).ok
            await cell.forward(until=cell.is_state(State.HELD), seconds=5.0)
            cell.sim.cnc.receive(override)
            assert (await cell.command("resume")).ok
            await cell.forward(until=cell.is_state(State.RUNNING), seconds=10.0)
            await cell.forward(ticks=ticks)
            assert not cell.latched
        await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
        assert cell.outcome == "completed" and not cell.latched
