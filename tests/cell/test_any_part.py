"""A part of several pieces through the whole cell: by wire as it was proven, and over REST from upload to what stands in the plant."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from manifold3d import CrossSection

import planner
from cellctl.client import Client
from cellctl.demo import ENDED, Demo, ask_sim
from config.material import load_material
from planner.files.model_file import stl_bytes
from planner.mesh import Mesh
from planner.recipe import Recipe
from sim.compare import difference
from sim.dryrun import DryRun
from sim.process.clamping import metal_for
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.parts.solids import mesh_from

CELL_MM = 0.25
TIME_SCALE = 60.0
LEAN = np.radians(15.0)
WIDTH_MM, FOOT_MM, ARM_MM = 5.0, 0.8, 1.6
JOINT = (0.0, 0.0, float(FOOT_MM + 0.5 * WIDTH_MM * np.tan(LEAN)))
NORMAL = (float(np.sin(LEAN)), 0.0, float(np.cos(LEAN)))
BENT_BAR: dict[str, Any] = {
    "process": "deposit",
    "tolerance_mm": 0.6,
    "cusp_mm": 0.4,
    "layer_height_mm": 0.8,
    "interpass_s": 0.1,
    "build_direction": [0.0, 0.0, 1.0],
    "cuts": [{"point_mm": JOINT, "normal": NORMAL, "direction": NORMAL, "order": 2}],
    "support": "never",
}
"""Recipe: the foot is built upright, what is beyond the joint along the joint's normal."""


def bent_bar() -> Mesh:
    """A bar of 6 mm square: a foot cut off at 15 degrees and on it a piece that leans by as much."""
    low, high = FOOT_MM, FOOT_MM + WIDTH_MM * np.tan(LEAN)
    x, z = ARM_MM * np.sin(LEAN), ARM_MM * np.cos(LEAN)
    half = 0.5 * WIDTH_MM
    outline = [(-half, 0.0), (half, 0.0), (half, low), (half + x, low + z), (x - half, high + z), (-half, high)]
    upright = CrossSection([outline]).extrude(WIDTH_MM)
    return mesh_from(upright.transform(np.array([[1.0, 0, 0, 0], [0, 0, -1.0, half], [0, 1.0, 0, 0]])))


class Built(Demo):
    """One part through service, wires and simulated plant. `job`, `plan`, `proof` : their documents; `measured` : at the plant"""

    def __init__(self, mesh: Path, recipe: dict[str, Any], out: Path) -> None:
        super().__init__("trunnion_tcp", TIME_SCALE, out, keep=False, as_json=True)
        self.mesh, self.recipe = mesh, recipe

    def _build(self, client: Client) -> dict[str, Any]:
        job = client.submit(client.upload(self.mesh)["id"], recipe=self.recipe, name="bent bar")
        job = self._until(client, job["id"], ("waiting_for_approval", *ENDED))
        assert job["state"] == "waiting_for_approval", job["error"] or job["why"]
        self.plan, self.proof = (client.get(f"jobs/{job['id']}/{what}") for what in ("plan", "proof"))
        self._clamp(client, job, job["proof"])
        why = {"override_reason": f"edges stay round: {'; '.join(self.proof['reasons'])}"} if self.proof["reasons"] else {}
        with engineer(client, self._out / "store") as entitled:
            entitled.approve(job["id"], because="test", table_clear=True, **why)
        self.job = self._until(client, job["id"], ENDED)
        command = {"do": "as_built", "dir": str(self._out / "result"), "name": "bent bar", "tolerance_mm": self.recipe["tolerance_mm"]}
        self.measured = ask_sim(self._run_dir / "sim.sock", command)["deviation"]
        return {**self.job, "passed": True}

    def _tell(self, result: dict[str, Any]) -> None:
        """Nothing: the test asks."""


def engineer(client: Client, store: Path) -> Client:
    """A client whose role may override a proof."""
    words = [sys.executable, "-m", "cellctl", "token", "create", "engineer", "--role", "engineer", "--store", str(store)]
    return Client(client.url, subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip())


@pytest.fixture
def built(tmp_path: Path) -> Iterator[Built]:
    mesh = tmp_path / "bent_bar.stl"
    mesh.write_bytes(stl_bytes(bent_bar()))
    made = Built(mesh, BENT_BAR, tmp_path / "out")
    ended_by = signal.getsignal(signal.SIGTERM)
    try:
        made.run()
        yield made
    finally:
        signal.signal(signal.SIGTERM, ended_by)


async def test_part_of_two_pieces_is_built_by_wire_as_it_was_proven(tmp_path: Path) -> None:
    mesh = bent_bar()
    async with CellUnderTest(tmp_path / "store.db", cell=shipped_cell()) as cell:
        plan = planner.plan(mesh, Recipe(**BENT_BAR))
        program = planner.post(plan, cell.facts)
        assert len(plan.setups) == 2
        material = load_material(program.material)
        metal = metal_for(cell.facts, plan.bounds, CELL_MM, material, np.linalg.inv(program.machine_from_build))
        cell.sim.metal = metal
        reply = await cell.start(program)
        assert reply.ok, reply.error
        await cell.forward(until=lambda: bool(cell.outcome))
        assert cell.outcome == "completed", cell.latched
        metal.finish()
    run = DryRun(program, cell.facts, mesh, material, None, CELL_MM)
    run.execute()
    assert run.stock.volume_mm3(above_mm=0.2) > 0.7 * mesh.volume
    apart = difference(metal.stock, run.stock)
    assert apart.max_mm < 2.0 * CELL_MM
    assert apart.volume_mm3 < 0.02 * mesh.volume


@pytest.mark.slow
def test_part_of_two_pieces_goes_from_upload_to_metal_over_rest(built: Built) -> None:
    wired, proven = built.measured, built.proof["deviation"]
    assert built.job["state"] == "completed"
    assert len(built.plan["subcomponents"]) == 2
    assert wired["missing_mm3"] == pytest.approx(proven["missing_mm3"], abs=0.02 * proven["part_mm3"])
    assert wired["p99_mm"] == pytest.approx(proven["p99_mm"], abs=proven["cell_mm"])
