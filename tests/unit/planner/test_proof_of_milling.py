"""Parts cut from a block or a given stock, proved in the twin: what the plan cuts from is what the proof clamps."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

import planner
from cellctl import cli
from cellctl.planning import stages
from cellctl.planning.task import Task
from config import load_cell, load_material
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.plan import Process
from planner.recipe import Recipe
from sim import prove
from sim.dryrun import DryRun
from tests.unit.planner.small_parts import box, frustum, points_of

CELL = load_cell("trunnion_tcp")
CELL_MM = 0.3
PART = box(12.0, 8.0, 1.6)


def test_block_thinner_than_one_cut_is_faced_to_its_height_and_passes_its_proof() -> None:
    made = planner.plan(PART, Recipe(process="mill"))
    faces = [
        points_of(step)[0, 2]
        for operation in made.operations
        if operation.process is Process.MILL_FACE
        for step in operation.passes
        if not step.is_link
    ]
    assert any(abs(z - 1.6) < 1e-9 for z in faces)
    proof = prove(planner.post(made, CELL), CELL, PART, cell_mm=CELL_MM)
    assert proof.passed, proof.reasons
    assert proof.deviation.max_excess_mm < 0.05


def test_changed_allowance_reaches_the_block_that_the_proof_clamps() -> None:
    program = planner.post(planner.plan(PART, Recipe(process="mill", stock_allowance_mm=2.5)), CELL)
    run = DryRun(program, CELL, PART, load_material("316L"), None, CELL_MM)
    # tops and sides of the block, in the build frame, where the part stands on z = 0
    surface = np.array([[0.0, 0.0, 4.1], [8.5, 0.0, 2.0], [0.0, -6.5, 2.0]])
    assert run.stock.distance(surface) == pytest.approx(0.0, abs=0.01)
    run.execute()
    proof = run.conclude()
    assert proof.passed, proof.reasons
    assert proof.deviation.max_excess_mm < 0.05


@pytest.fixture(scope="module")
def cylinder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A round stock, higher and wider than the default block, in the part's frame."""
    file = tmp_path_factory.mktemp("stock") / "round.stl"
    body = trimesh.creation.cylinder(9.0, 9.0)
    body.apply_translation([0.0, 0.0, 3.7])
    body.export(file)
    return file


def test_part_milled_from_a_given_stock_passes_with_it_and_not_without(cylinder: Path) -> None:
    program = planner.post(planner.plan(PART, Recipe(process="mill", stock=str(cylinder))), CELL)
    proof = prove(program, CELL, PART, stock=load(cylinder), cell_mm=CELL_MM)
    assert proof.passed, proof.reasons
    assert proof.deviation.max_excess_mm < 0.05
    without = prove(program, CELL, PART, cell_mm=CELL_MM)
    assert not without.passed and without.lines_executed == 0
    assert any("stock" in reason for reason in without.reasons)


def test_file_commands_and_workers_prove_with_the_stock(
    cylinder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    PART.to_trimesh().export("part.stl")
    Path("recipe.toml").write_text(f'process = "mill"\nstock = "{cylinder}"\n', encoding="utf-8")

    def run(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["cellctl", *words])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        return int(caught.value.code or 0)

    assert run("plan", "part.stl", "--recipe", "recipe.toml") == 0
    assert run("prove", "plan.h5", "--part", "part.stl", "--cell-mm", "0.3") == 0
    assert run("post", "plan.h5") == 0
    assert run("prove", "program", "--part", "part.stl", "--cell-mm", "0.3") == 1
    assert "given stock" in capsys.readouterr().out
    assert run("prove", "program", "--part", "part.stl", "--stock", str(cylinder), "--cell-mm", "0.3") == 0
    task = Task(
        "prove", str(tmp_path), 0, 0, mesh="part.stl", program="program", stock=str(cylinder), cell="trunnion_tcp"
    )
    assert stages.prove(task, lambda stage, share: None)["passed"] is True


def test_finished_top_of_a_small_block_has_no_pits_between_hatch_and_contour() -> None:
    body = box(12.0, 8.0, 3.0)
    program = planner.post(planner.plan(body, Recipe(tolerance_mm=0.15)), CELL)
    run = DryRun(program, CELL, body, load_material("316L"), None, CELL_MM)
    run.execute()
    proof = run.conclude()
    assert proof.passed, proof.reasons
    across, along = np.meshgrid(np.linspace(-5.5, 5.5, 45), np.linspace(-3.5, 3.5, 29))
    top = np.column_stack([across.ravel(), along.ravel(), np.full(across.size, 3.0)])
    assert run.stock.distance(top).max() < 0.15  # a pit of this depth stood at every end of a hatch line


def test_metal_that_ran_down_a_milled_leaning_wall_is_taken_off_with_the_next_band() -> None:
    cone = frustum(12.0, 10.0, 4.0, sections=180)
    program = planner.post(planner.plan(cone, Recipe(tolerance_mm=0.2, layer_height_mm=0.8)), CELL)
    proof = prove(program, CELL, cone)
    assert proof.passed, proof.reasons
    assert proof.deviation.p99_mm < 0.1 and proof.deviation.max_excess_mm < 0.1


def test_cutter_that_reaches_under_a_leaning_band_spares_the_ledge_below_it() -> None:
    ledge = trimesh.creation.cylinder(17.0, 0.8, sections=90)
    cone = frustum(12.0, 10.0, 4.0, sections=90).to_trimesh()
    ledge.apply_translation([0.0, 0.0, 0.4])
    cone.apply_translation([0.0, 0.0, 0.8])
    body = Mesh.from_trimesh(trimesh.boolean.union([ledge, cone]))
    program = planner.post(planner.plan(body, Recipe(tolerance_mm=0.2, layer_height_mm=0.8)), CELL)
    run = DryRun(program, CELL, body, load_material("316L"), None, None)
    run.execute()
    proof = run.conclude()
    assert proof.passed, proof.reasons
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    for radius in (12.6, 14.0, 16.0):
        on_ledge = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(90, 0.8)])
        assert run.stock.distance(on_ledge).max() < 0.15
