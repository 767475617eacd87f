"""The proof of a small block, and what it finds when the Program, the cell or the process is broken on purpose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

import planner
from config import Cell, load_cell, load_material
from planner.mesh.mesh import Mesh
from planner.program import Channel, LineKind, Program
from planner.recipe import Recipe
from sim import prove
from sim.dryrun import DryRun, usual_cell_mm
from sim.process.stock import Stock
from sim.process.target import Target

CELL_MM = 0.3
CELL = load_cell("trunnion_tcp")


@cache
def part() -> Mesh:
    box = trimesh.creation.box((12.0, 8.0, 1.6))
    return Mesh(np.asarray(box.vertices), np.asarray(box.faces))


@cache
def program(process: str = "hybrid") -> Program:
    recipe = Recipe.model_validate(
        {"process": process, "tolerance_mm": 0.2, "layer_height_mm": 0.8, "overbuild": 0.45, "interpass_s": 0.0}
    )
    return planner.post(planner.plan(part(), recipe, part_name="block"), CELL)


def with_lines(change: Callable[[int, str], str]) -> Program:
    """The block's Program with every line sent through `change(index, line)`."""
    given = program()
    return replace(given, lines=tuple(change(i, line) for i, line in enumerate(given.lines)))


def bare(index: int) -> str:
    """A line that does nothing."""
    return f"N{index + 1} G90"


def ran(given: Program, cell: Cell = CELL) -> DryRun:
    run = DryRun(given, cell, part(), load_material("316L"), None, CELL_MM)
    run.execute()
    return run


def kinds(run: DryRun) -> set[str]:
    return {finding.kind for finding in run.found}


def test_block_passes_and_the_same_program_gives_the_same_proof_byte_for_byte() -> None:
    said: list[float] = []
    proof = prove(program(), CELL, part(), cell_mm=CELL_MM, progress=lambda share, word: said.append(share))
    assert proof.passed, proof.reasons
    assert proof.findings == ()
    assert proof.lines_executed == len(program().lines)
    assert said == sorted(said) and said[-1] == 1.0
    again = prove(program(), CELL, part(), cell_mm=CELL_MM)
    assert again.to_json() == proof.to_json()
    assert again.picture == proof.picture
    assert proof.picture.startswith(b"\x89PNG")


def test_wrong_work_offset_is_found_and_leaves_its_mark_in_the_metal() -> None:
    offset = {**CELL.placement.work_offset, "X": 1.0}
    moved = CELL.model_copy(update={"placement": CELL.placement.model_copy(update={"work_offset": offset})})
    proof = prove(program(), moved, part(), cell_mm=CELL_MM)
    assert not proof.passed
    assert proof.findings[0].kind == "work offset"
    assert proof.deviation.max_missing_mm > 0.6


def test_without_powder_there_is_no_part() -> None:
    schedule = program().schedule.copy()
    schedule["value"][schedule["channel"] == Channel.POWDER_G_MIN] = 0.0
    proof = prove(replace(program(), schedule=schedule), CELL, part(), cell_mm=CELL_MM)
    assert not proof.passed
    assert any(reason.startswith("missing metal") for reason in proof.reasons)
    assert proof.deviation.missing_mm3 > 0.8 * proof.deviation.part_mm3  # the lowest cells are the joint with the plate


def test_without_its_gate_the_laser_is_never_on() -> None:
    run = ran(with_lines(lambda i, line: bare(i) if "M62" in line else line))
    assert "no emission" in kinds(run)
    assert run.stock.deposited_mm3 == 0.0


def test_laser_that_stays_on_during_travel_is_found() -> None:
    assert "stray light" in kinds(ran(with_lines(lambda i, line: bare(i) if "M63" in line else line)))


def test_cutting_with_a_standing_spindle_is_found_with_its_line() -> None:
    run = ran(with_lines(lambda i, line: bare(i) if "M3" in line.split("N")[-1].replace("M3P", "") and "S" in line else line))
    found = next(finding for finding in run.found if finding.kind == "spindle off")
    assert program().table["kind"][found.line - 1] in (LineKind.PROCESS, LineKind.LINK)
    assert found.operation >= 0


def test_milling_at_rapid_speed_is_found() -> None:
    first_cut = next(i for i, line in enumerate(program().lines) if "M3" in line and "S" in line)
    run = ran(with_lines(lambda i, line: line.replace("G1", "G0") if i > first_cut else line))
    assert "rapid in metal" in kinds(run)


def test_layer_that_is_left_out_is_missing_metal() -> None:
    table = program().table
    last = int(table["layer"].max())
    lit = {i for i, line in enumerate(program().lines) if "M62" in line and table["layer"][i] == last}
    proof = prove(with_lines(lambda i, line: bare(i) if i in lit else line), CELL, part(), cell_mm=CELL_MM)
    assert not proof.passed
    left = 0.8 * (1.0 + 0.45) / 1.6  # of the part: the first layer with its overbuild
    assert proof.deviation.missing_mm3 == pytest.approx((1.0 - left) * proof.deviation.part_mm3, rel=0.1)


def test_line_that_the_firmware_refuses_ends_the_run_with_its_text() -> None:
    run = ran(with_lines(lambda i, line: f"N{i + 1} G1 X1 X2" if i == 20 else line))
    found = next(finding for finding in run.found if finding.kind == "firmware")
    assert found.line == 21
    assert "X1 X2" in found.text


def test_line_longer_than_the_firmware_takes_is_found() -> None:
    run = ran(with_lines(lambda i, line: line + "(" + "x" * 300 + ")" if i == 5 else line))
    assert any(finding.kind == "line length" and finding.line == 6 for finding in run.found)


def test_milling_starts_from_the_box_that_the_planner_assumes() -> None:
    run = DryRun(program("mill"), CELL, part(), load_material("316L"), None, 0.25)
    assert run.stock.volume_mm3(0.0) == pytest.approx(14.0 * 10.0 * (2.6 - 0.125), rel=0.06)
    top = run.stock.distance(np.array([[0.0, 0.0, 2.6], [3.0, 2.0, 2.5], [3.0, 2.0, 2.7]]))
    assert top == pytest.approx([0.0, -0.1, 0.1], abs=0.03)


def test_block_milled_from_a_stock_that_is_given_as_a_mesh_passes() -> None:
    box = trimesh.creation.box((14.0, 10.0, 1.6))
    proof = prove(program("mill"), CELL, part(), stock=Mesh(np.asarray(box.vertices), np.asarray(box.faces)), cell_mm=CELL_MM)
    assert proof.passed, proof.reasons
    assert proof.deposited_mm3 == 0.0


def test_metal_is_the_same_whatever_the_step_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = ran(program())
    monkeypatch.setattr("sim.dryrun.STEP_S", 0.03)
    fine = ran(program())
    one, other = (run.stock.field.dense((0, 0, 0), run.stock.field.shape) for run in (coarse, fine))
    change = np.abs(one - other)
    near = np.minimum(np.abs(one), np.abs(other)) < 1.5 * CELL_MM  # of a surface
    assert change[near].max() < 0.35 * CELL_MM
    assert np.count_nonzero(change > 0.05 * CELL_MM) < 1e-4 * change.size
    assert coarse.stock.volume_mm3() == pytest.approx(fine.stock.volume_mm3(), rel=1e-3)




@pytest.mark.parametrize(
    ("size_mm", "tolerance_mm", "cell_mm"),
    [((40.0, 30.0, 20.0), 0.15, 0.3), ((40.0, 30.0, 20.0), 0.02, 0.2), ((40.0, 30.0, 1.2), 0.15, 0.2), ((40.0, 30.0, 0.3), 0.15, 0.1)],
)
def test_grid_follows_tolerance_and_thickness(size_mm: tuple[float, ...], tolerance_mm: float, cell_mm: float) -> None:
    box = trimesh.creation.box(size_mm)
    target = Target(np.asarray(box.vertices), np.asarray(box.faces), 5.0)
    assert usual_cell_mm(target, tolerance_mm) == pytest.approx(cell_mm)


def test_grid_of_a_large_part_keeps_its_stock_within_two_gigabytes() -> None:
    small, large = (trimesh.creation.box((side, side, side)) for side in (20.0, 400.0))
    cell_mm = usual_cell_mm(Target(np.asarray(large.vertices), np.asarray(large.faces), 50.0), 0.05)
    assert cell_mm > 0.3
    target = Target(np.asarray(small.vertices), np.asarray(small.faces), 1.0)
    stock = Stock(target.bounds + np.array([[-1.0], [1.0]]), 0.2, load_material("316L"))
    stock.unite(target.signed_distance, target.bounds)
    stock.guard(target)
    bytes_per_cell = stock.memory_bytes / (target.areas.sum() / stock.cell_mm**2)
    assert bytes_per_cell * large.area / cell_mm**2 < 2e9
