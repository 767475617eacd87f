"""What is proven is what the wires do: the same Program by our controller and drivers and in the dry run leaves the same metal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from config.material import load_material
from planner.mesh import Mesh
from sim.compare import difference
from sim.dryrun import DryRun
from sim.process.clamping import metal_for
from sim.process.stock import Stock
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall

CELL_MM = 0.25
LENGTH_MM, LAYERS = 24.0, 2


def wall() -> Mesh:
    """What one_wall is meant to become, about."""
    box = trimesh.creation.box(bounds=[[-0.5 * LENGTH_MM, -1.3, 0.0], [0.5 * LENGTH_MM, 1.3, LAYERS]])
    return Mesh(np.asarray(box.vertices, dtype=np.float64), np.asarray(box.faces, dtype=np.int64))


async def by_wire(store: Path, name: str) -> tuple[Stock, CellUnderTest]:
    """Run the Program through the controller, the drivers and the simulated devices; the metal that stands there then."""
    async with CellUnderTest(store, cell=shipped_cell(name)) as cell:
        program = one_wall(cell.facts, length_mm=LENGTH_MM, layers=LAYERS)
        material = load_material(program.material)
        build_from_table = np.linalg.inv(program.machine_from_build)
        metal = metal_for(cell.facts, np.array([[-12.0, -1.3, 0.0], [12.0, 1.3, LAYERS]]), CELL_MM, material, build_from_table)
        cell.sim.metal = metal
        reply = await cell.start(program)
        assert reply.ok, reply.error
        await cell.forward(until=lambda: bool(cell.outcome))
        assert cell.outcome == "completed", cell.latched
        metal.finish()
        return metal.stock, cell


@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu"])
async def test_metal_made_by_wire_and_metal_made_in_the_proof_differ_by_less_than_one_cell(tmp_path: Path, name: str) -> None:
    wired, cell = await by_wire(tmp_path / "store.db", name)
    program = one_wall(cell.facts, length_mm=LENGTH_MM, layers=LAYERS)
    run = DryRun(program, cell.facts, wall(), load_material(program.material), None, CELL_MM)
    run.execute()
    apart = difference(wired, run.stock)
    assert run.stock.volume_mm3(above_mm=0.2) > 40.0
    assert apart.max_mm < CELL_MM
