"""A part interrupted by kills of the cell process and gone on with each time is, at the plant, the part made in one go but for one bead's overlap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import planner
from cellctl.cell.program_form import program_timeline
from cellctl.domain.resumption import MetalEnd, metal_end_of
from cellctl.domain.states import State
from config.material import load_material
from planner.mesh import Mesh
from planner.program import Program
from planner.recipe import Recipe
from planner.resume import ResumePoint
from sim.compare import difference
from sim.dryrun import DryRun
from sim.process.clamping import metal_for
from tests.cell.harness import CellUnderTest, shipped_cell

CELL_MM = 0.3
CREST_MM = 1.1  # of one bead
LENGTH_MM = 16.0


def wall() -> Mesh:
    """Two beads on each other."""
    box = trimesh.creation.box((LENGTH_MM, 2.4, 1.6))
    return Mesh(np.asarray(box.vertices, dtype=np.float64), np.asarray(box.faces, dtype=np.int64))


def lies_on(program: Program, layer: int, cell: CellUnderTest, share: float) -> bool:
    """Whether the plant emits and is so far along the bead of a layer."""
    line = cell.sim.cnc.machine.motion.line - 1
    row = program.table[max(line, 0)]
    x = float(cell.sim.tip_position[0] - program.machine_from_build[0, 3])
    return bool(cell.sim.laser.is_emitting) and int(row["layer"]) == layer and abs(x) < (0.5 - share) * LENGTH_MM


async def killed_on(cell: CellUnderTest, job: str, program: Program, layer: int, share: float) -> MetalEnd:
    """Where the next process says that metal ended when this one was killed."""
    await cell.forward(until=lambda: lies_on(program, layer, cell, share))
    await cell.forward(ticks=20)
    await cell.kill()
    await cell.forward(seconds=3.0)
    assert cell.is_dark
    await cell.power_up()
    cell.journal.commit()
    told = next(event for event in cell.events if event.kind == "job" and event.job == job and event.data.get("outcome") == "interrupted")
    timeline = program_timeline(program, cell.facts)
    end = metal_end_of(told.data, timeline.arc_mm, timeline.is_emitting)
    assert end is not None and end.known_by == "tick"
    assert timeline.is_emitting[end.line] and int(program.table["layer"][end.line]) == layer
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=30)
    assert cell.controller.drivers is not None
    await cell.forward(seconds=1.0)  # what the devices have latched meanwhile is read
    if cell.controller.drivers.laser.faults:
        assert (await cell.command("reset")).ok
        await cell.forward(until=lambda: cell.state is State.IDLE and not cell.latched, seconds=30)
    return end


async def go_on(cell: CellUnderTest, job: str, program: Program, of: str) -> None:
    """Start the rest of a part that a person found untouched."""
    cell.programs[job] = program
    args = {"job": job, "name": "wall", "program": job, "continues": of}
    before = await cell.command("start", **args, confirmed_at=cell.unix() - 60.0)
    assert not before.ok and "after the part was found untouched" in before.error
    await cell.forward(ticks=2)
    reply = await cell.command("start", **args, confirmed_at=cell.unix())
    assert reply.ok, reply.error


@pytest.mark.timeout(300)
async def test_part_killed_in_both_of_its_beads_equals_the_uninterrupted_one_within_one_bead_overlap(folder: Path) -> None:
    async with CellUnderTest(folder / "store.db", cell=shipped_cell()) as cell:
        mesh = wall()
        program = planner.post(planner.plan(mesh, Recipe(process="deposit")), cell.facts)
        whole = DryRun(program, cell.facts, mesh, load_material("316L"), None, CELL_MM)
        whole.execute()
        metal = metal_for(cell.facts, whole.bounds, CELL_MM, load_material("316L"), np.linalg.inv(program.machine_from_build))
        cell.sim.metal = metal
        assert (await cell.start(program, job="first")).ok
        rest, overlap_mm = program, []
        for layer, (job, following) in enumerate((("first", "second"), ("second", "third"))):
            end = await killed_on(cell, job, rest, layer, 0.4)
            rest = planner.resume(rest, cell.facts, ResumePoint.at(end.line, end.fraction))
            assert rest.continues is not None and rest.continues.layer == layer
            overlap_mm.append(rest.continues.overlap_mm)
            await go_on(cell, following, rest, job)
        await cell.forward(until=lambda: bool(cell.outcome) and cell.controller.run is None and cell.state is State.IDLE)
        assert cell.outcome == "completed", cell.latched
        metal.finish()
    apart = difference(metal.stock, whole.stock)
    more_mm3 = metal.stock.volume_mm3(above_mm=0.2) - whole.stock.volume_mm3(above_mm=0.2)
    assert apart.max_mm < CREST_MM
    assert 0.0 < more_mm3 < sum(overlap_mm) * 2.4 * CREST_MM
