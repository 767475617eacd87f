"""A placement that is wrong by the plant's own geometry: measured, adopted, posted again; and what was posted before is refused."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from cellctl.domain.measured import Measured
from cellctl.domain.states import State
from cellctl.measuring.touch_off import Touched, centre_of_rotation
from config.cell import Cell
from planner.kinematics.chain import Chain
from sim.cnc.chain import Chain as PlantChain
from sim.real_machine import really
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall
from tests.unit.cellctl.test_touch_off import touching

REAL = {"C": (0.31, -0.24, -450.0)}


def shifted() -> Cell:
    cell = shipped_cell()
    return cell.model_copy(update={"simulation": cell.simulation.model_copy(update={"real_pivots_mm": REAL})})


def error_mm(cell: CellUnderTest) -> float:
    """How far the real machine's tip is from where joints that are found for the cell as it stands were to bring it."""
    facts, rng = cell.controller.cell, np.random.default_rng(1)
    joints = np.column_stack([rng.uniform(-30, 30, (40, 2)), rng.uniform(-120, -90, 40), rng.uniform(-40, 40, 40), rng.uniform(-180, 180, 40)])
    tip = np.array(facts.tools[0].tip_mm)
    wanted = Chain.from_cell(facts).forward(joints, tip)[0]
    real = PlantChain(really(cell.facts)).tip_in_table(joints, 1)
    return float(np.linalg.norm(real - wanted, axis=1).max())


async def measured(cell: CellUnderTest, because: str = "new trunnion bearing", **changes: object) -> object:
    document = msgspec.to_builtins(Measured(**changes), str_keys=True)  # type: ignore[arg-type]
    return await cell.command("measured", because=because, document=document, what="pivot of C")


async def test_a_wrong_pivot_is_measured_adopted_and_the_tips_error_falls(folder: Path) -> None:
    async with CellUnderTest(folder / "store.db", cell=shifted()) as cell:
        assert error_mm(cell) > 0.3
        before = one_wall(cell.controller.cell, layers=1, mill=False)
        points = []
        for angle in (0.0, 120.0, 240.0):
            goal = touching(cell.facts, np.array([50.0, 10.0, -440.0]), {"C": angle}, tool=1)
            for letter, at in goal.joints.items():
                now = cell.snapshot.cnc.machine[letter]
                if abs(at - now) > 1e-3:
                    feed = 5000.0
                    assert (await cell.command("jog", axis=letter, distance=at - now, feed=feed)).ok
                    await cell.forward(until=cell.is_state(State.IDLE), seconds=30)
            points.append(Touched(dict(cell.snapshot.cnc.machine), 1))
        found = centre_of_rotation(cell.controller.cell, "C", points)
        assert np.array(found.value[:2]) == pytest.approx(np.array(REAL["C"][:2]), abs=3e-3)
        assert (await measured(cell, pivots_mm={"C": found.value})).ok  # type: ignore[attr-defined]
        assert error_mm(cell) < 6e-3
        assert cell.has_event("measured", "pivot of C: adopted by tester, because new trunnion bearing")

        reply = await cell.start(before)
        assert not reply.ok and "measured anew" in reply.error and "post_again" in reply.hint
        stands = cell.controller.cell.sha256
        await cell.kill()
        await cell.power_up()
        assert cell.controller.cell.sha256 == stands
        assert (await cell.start(one_wall(cell.controller.cell, layers=1, mill=False), job="job-2")).ok


async def test_nothing_is_adopted_under_a_job_without_a_reason_or_out_of_bounds(cell: CellUnderTest) -> None:
    stood = cell.controller.cell.sha256
    for reply, words in (
        (await measured(cell, pivots_mm={"C": (9.0, 0.0, -450.0)}), "at most 5 mm"),
        (await measured(cell, because=" ", pivots_mm={"C": (0.1, 0.0, -450.0)}), "a reason"),
        (await cell.command("measured", document={"pivots_mm": {"C": "here"}}), "measured"),
    ):
        assert not reply.ok and words in reply.error  # type: ignore[attr-defined]
    await cell.deposit(layers=1, mill=False)
    reply = await measured(cell, pivots_mm={"C": (0.1, 0.0, -450.0)})
    assert not reply.ok and "RUNNING" in reply.error  # type: ignore[attr-defined]
    assert cell.controller.cell.sha256 == stood
