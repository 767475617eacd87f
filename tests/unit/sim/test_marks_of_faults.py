"""Starts and stops that are wrong on purpose, in a wall of single beads: each leaves its true mark in the metal, and the proof names it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from config import Cell, load_cell, load_material
from planner.mesh.mesh import Mesh
from planner.program import Channel, LineKind, Program
from sim.dryrun import DryRun
from sim.proof import Proof
from tests.cell.jobs import Writer

Array = NDArray[np.float64]

CELL = load_cell("trunnion_tcp")
MATERIAL = load_material("316L")
CELL_MM = 0.4
LAYERS, LENGTH_MM, STEP_MM, PIECES = 4, 24.0, 0.66, 10
PIECE_MM = LENGTH_MM / PIECES
LEAD_MM, CLEARANCE_MM = PIECE_MM, 20.0
POWER_W, POWDER_G_MIN, FEED_MM_S = 1200.0, 12.0, 12.0
DWELL_S = 0.8
POWDER_MM3_S = POWDER_G_MIN / 60.0 / MATERIAL.density_g_mm3
TOP = LAYERS - 1


@cache
def wall() -> Program:
    """Beads over one another along X, each to the right, laser and powder set anew for each; in the middle of each a line that does nothing."""
    w = Writer(CELL)
    starts = []
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    for layer in range(LAYERS):
        w.layer = w.operation = layer
        starts.append(len(w.lines))
        z = layer * STEP_MM
        n = w.move(-0.5 * LENGTH_MM - LEAD_MM, 0.0, z + CLEARANCE_MM, LineKind.LINK, 100.0)
        if layer == 0:
            w.at(n, Channel.MODE, 1, barrier=True)
            w.at(n, Channel.CARRIER_GAS_L_MIN, 5.0, barrier=True)
            w.at(n, Channel.SHIELD_GAS_L_MIN, 15.0, barrier=True)
        n = w.move(-0.5 * LENGTH_MM - LEAD_MM, 0.0, z, LineKind.LINK, 40.0)
        w.at(n, Channel.POWDER_G_MIN, POWDER_G_MIN, barrier=True)
        n = w.move(-0.5 * LENGTH_MM, 0.0, z, LineKind.PROCESS, FEED_MM_S)
        w.at(n, Channel.LASER_W, POWER_W)
        w.line("M62 P0", LineKind.PROCESS)
        for k in range(PIECES):
            if 2 * k == PIECES:
                w.line("G90", LineKind.PROCESS)
            w.move((k + 1) * PIECE_MM - 0.5 * LENGTH_MM, 0.0, z, LineKind.PROCESS, FEED_MM_S)
        w.line("M63 P0", LineKind.PROCESS)
        w.move(0.5 * LENGTH_MM + LEAD_MM, 0.0, z, LineKind.PROCESS, FEED_MM_S)
        w.move(0.5 * LENGTH_MM + LEAD_MM, 0.0, z + CLEARANCE_MM, LineKind.LINK, 40.0)
    w.at(w.line("M2", LineKind.SETUP), Channel.MODE, 0, barrier=True)
    return replace(w.program("wall", starts), process="deposit")


@cache
def part() -> Mesh:
    """A box that lies inside the wall as it is built."""
    box = trimesh.creation.box(bounds=[[-10.0, -0.7, 0.0], [12.0, 0.7, 2.1]])
    return Mesh(np.asarray(box.vertices), np.asarray(box.faces))


def run_of(program: Program, cell: Cell = CELL) -> tuple[DryRun, Proof]:
    run = DryRun(program, cell, part(), MATERIAL, None, CELL_MM)
    run.execute()
    return run, run.conclude()


@pytest.fixture(scope="module")
def sound() -> tuple[DryRun, Proof]:
    """The wall as it should be."""
    return run_of(wall())


def edited(change: dict[int, str]) -> Program:
    """The wall's Program with some lines of its text, by N-word, written anew."""
    given = wall()
    assert all(0 < n <= len(given.lines) for n in change)
    return replace(
        given, lines=tuple(f"N{n} {change[n]}" if n in change else line for n, line in enumerate(given.lines, 1))
    )


def line_of(word: str, layer: int) -> int:
    """N-word of the line of a layer that is this word."""
    given = wall()
    return next(
        n for n, line in enumerate(given.lines, 1) if line.endswith(" " + word) and given.table["layer"][n - 1] == layer
    )


def with_setpoint(channel: Channel, layer: int, value: float) -> Program:
    """The wall's Program with another value of a channel in one layer."""
    schedule = wall().schedule.copy()
    here = (schedule["channel"] == channel) & (wall().table["layer"][schedule["n"] - 1] == layer)
    assert np.count_nonzero(here) == 1
    schedule["value"][here] = value
    return replace(wall(), schedule=schedule)


def heights(run: DryRun, x: Array) -> Array:
    """Height of the metal over points of the wall's middle, mm, by walking down the field."""
    z = np.arange(7.0, -0.3, -0.02)
    points = np.stack(np.broadcast_arrays(x[:, None], 0.0, z[None, :]), axis=-1).reshape(-1, 3)
    inside = (run.stock.distance(points) < 0.0).reshape(len(x), len(z))
    return np.asarray(z[np.argmax(inside, axis=1)])


def along() -> Array:
    return np.arange(-0.5 * LENGTH_MM - 4.0, 0.5 * LENGTH_MM + 4.0, 0.1)


def middle(run: DryRun) -> float:
    """Height of the wall where nothing begins or ends."""
    return float(heights(run, np.linspace(-3.0, 3.0, 13)).mean())


def top_marks(run: DryRun) -> set[int]:
    """Layers, counted from 1, that made the top of the wall's middle."""
    x = np.linspace(-3.0, 3.0, 13)
    return set(run.stock.marks(np.column_stack([x, 0.0 * x, heights(run, x)])).tolist())


def kinds(proof: Proof) -> set[str]:
    return {finding.kind for finding in proof.findings}


def added(run: DryRun, low_x: float = -30.0, high_x: float = 30.0) -> float:
    """Metal above the plate between two places along the wall, mm3, counted cell by cell apart from the stock's own books."""
    field = run.stock.field
    x, _, z = run.stock.points()
    filled = np.clip(0.5 - field.dense((0, 0, 0), field.shape) / field.cell_mm, 0.0, 1.0)
    plate = np.clip(0.5 - z / field.cell_mm, 0.0, 1.0)
    on = (x > low_x) & (x < high_x)
    return float((filled - plate[None, None, :]).clip(0.0)[on].sum()) * field.cell_mm**3


def with_gates_shifted(word: str, lines: int) -> Program:
    """The wall's Program with each of these words so many lines later."""
    given = wall()
    change: dict[int, str] = {}
    table = given.table.copy()
    for layer in range(LAYERS):
        n = line_of(word, layer)
        shown = [given.lines[n + k - 1].split(" ", 1)[1] for k in range(lines + 1)]
        change |= {n + k: text for k, text in enumerate([*shown[1:], shown[0]])}
        table["kind"][n - 1 : n + lines] = np.roll(table["kind"][n - 1 : n + lines], -1)
    return replace(edited(change), table=table)


def without_layer(layer: int) -> Program:
    """The wall's Program with all lines of a layer made idle; every line names its whole target, so the others go as they went."""
    table = wall().table
    return edited({n: "G90" for n in range(1, len(table) + 1) if table["layer"][n - 1] == layer})


def end_of(run: DryRun, side: int, level_mm: float = 1.0) -> float:
    """Where along x the wall ends at a height, mm. side : -1 or 1"""
    x = along()
    high = heights(run, x) > level_mm
    return float(side * (side * x[high]).max())


def gap_of(proof: Proof, layer: int) -> float:
    """Mean height of the focus over the surface in a layer, mm, as the timeline tells."""
    line = proof.timeline
    here = (np.asarray(line.layer) == layer) & np.isfinite(np.asarray(line.gap_mm))
    return float(np.asarray(line.gap_mm)[here].mean())


def test_sound_wall_passes_without_a_finding_and_its_books_agree_with_its_metal(sound: tuple[DryRun, Proof]) -> None:
    run, proof = sound
    assert proof.passed, proof.reasons
    assert proof.findings == ()
    lit_s = LAYERS * LENGTH_MM / FEED_MM_S
    assert added(run) == pytest.approx(proof.deposited_mm3, rel=5e-3)
    assert added(run) == pytest.approx(MATERIAL.head.sticking * POWDER_MM3_S * lit_s, rel=0.01)
    assert end_of(run, -1) == pytest.approx(-end_of(run, 1), abs=1.5)
    assert np.ptp(heights(run, np.linspace(-3.0, 3.0, 13))) < 0.1


def test_light_on_at_standstill_leaves_a_blob_of_what_the_powder_brings_in_that_time(
    sound: tuple[DryRun, Proof],
) -> None:
    run, proof = run_of(edited({line_of("G90", TOP): f"G4 P{DWELL_S}"}))
    caught = MATERIAL.head.sticking * POWDER_MM3_S * DWELL_S
    assert added(run) - added(sound[0]) == pytest.approx(caught, rel=0.05)
    assert added(run, -4.0, 4.0) - added(sound[0], -4.0, 4.0) == pytest.approx(
        caught, rel=0.05
    )  # all of it where the tip stood
    x = along()
    bump = heights(run, x) - heights(sound[0], x)
    assert 0.4 < bump.max() < 1.5 and abs(x[np.argmax(bump)]) < 1.0
    assert np.abs(bump[np.abs(x) > 4.0]).max() < 0.05
    assert top_marks(run) == {LAYERS}
    found = next(finding for finding in proof.findings if finding.kind == "standstill")
    assert not proof.passed and any("standstill" in reason for reason in proof.reasons)
    assert (found.layer, found.operation) == (TOP, TOP) and found.at_mm == pytest.approx(
        (0.0, 0.0, TOP * STEP_MM), abs=0.01
    )


def test_gate_that_opens_late_leaves_a_wall_that_begins_late_by_as_much(sound: tuple[DryRun, Proof]) -> None:
    run, proof = run_of(with_gates_shifted("M62 P0", 1))
    assert end_of(run, -1) - end_of(sound[0], -1) == pytest.approx(PIECE_MM, abs=CELL_MM)
    assert end_of(run, 1) == pytest.approx(end_of(sound[0], 1), abs=0.11)
    assert added(run) / added(sound[0]) == pytest.approx(1.0 - 1.0 / PIECES, abs=0.005)
    assert not proof.passed and any(reason.startswith("missing metal") for reason in proof.reasons)


def test_gate_that_shuts_late_leaves_a_wall_that_goes_on_to_where_the_tip_turned_away(
    sound: tuple[DryRun, Proof],
) -> None:
    run, proof = run_of(with_gates_shifted("M63 P0", 2))  # shuts after the way up
    assert end_of(run, 1) - end_of(sound[0], 1) == pytest.approx(LEAD_MM, abs=CELL_MM)
    assert end_of(run, -1) == pytest.approx(end_of(sound[0], -1), abs=0.11)
    assert middle(run) == pytest.approx(middle(sound[0]), abs=0.05)
    assert proof.deviation.max_excess_mm == pytest.approx(end_of(run, 1) - 12.0, abs=CELL_MM)  # beyond the part's end
    found = next(finding for finding in proof.findings if finding.kind == "stray light")
    assert not proof.passed and found.at_mm is not None
    assert found.count == LAYERS or len([f for f in proof.findings if f.kind == "stray light"]) == LAYERS


def test_powder_without_light_is_lost_and_the_surface_stays_as_it_was(sound: tuple[DryRun, Proof]) -> None:
    run, proof = run_of(with_setpoint(Channel.LASER_W, TOP, 0.0))
    assert run.metal.powder_g == pytest.approx(sound[0].metal.powder_g, rel=1e-3)  # it flowed all the same
    assert added(run) / added(sound[0]) == pytest.approx(1.0 - 1.0 / LAYERS, abs=0.005)
    assert middle(sound[0]) - middle(run) == pytest.approx(STEP_MM, abs=0.1)
    assert top_marks(run) == {TOP}
    assert "waste" in kinds(proof)
    assert not proof.passed and any(reason.startswith("missing metal") for reason in proof.reasons)


def test_light_without_powder_remelts_the_surface_and_raises_nothing(sound: tuple[DryRun, Proof]) -> None:
    run, proof = run_of(with_setpoint(Channel.POWDER_G_MIN, TOP, 0.0))
    assert run.metal.powder_g < sound[0].metal.powder_g - POWDER_G_MIN / 60.0 * LENGTH_MM / FEED_MM_S
    assert added(run) / added(sound[0]) == pytest.approx(1.0 - 1.0 / LAYERS, abs=0.005)
    assert middle(sound[0]) - middle(run) == pytest.approx(STEP_MM, abs=0.1)
    assert top_marks(run) == {LAYERS}  # made by the dark-fed layer, though no higher
    assert not proof.passed and any(reason.startswith("starved") for reason in proof.reasons)


def test_layer_that_is_left_out_lowers_the_wall_and_takes_the_next_one_out_of_focus(
    sound: tuple[DryRun, Proof],
) -> None:
    run, proof = run_of(without_layer(1))
    x = np.linspace(-9.0, 9.0, 37)
    assert heights(sound[0], x) - heights(run, x) == pytest.approx(np.full(37, STEP_MM), abs=0.15)  # everywhere
    assert added(run) / added(sound[0]) == pytest.approx(1.0 - 1.0 / LAYERS, abs=0.01)
    assert gap_of(proof, 2) - gap_of(sound[1], 2) == pytest.approx(STEP_MM, abs=0.1)
    assert 1 not in {layer.layer for layer in proof.layers} and 1 in {layer.layer for layer in sound[1].layers}
    assert not proof.passed and any(reason.startswith("missing metal") for reason in proof.reasons)


def test_wrong_offset_shifts_all_of_the_metal_by_as_much(sound: tuple[DryRun, Proof]) -> None:
    offset = {**CELL.placement.work_offset, "X": 0.8}
    run, proof = run_of(
        wall(), CELL.model_copy(update={"placement": CELL.placement.model_copy(update={"work_offset": offset})})
    )
    assert centroid(run) - centroid(sound[0]) == pytest.approx(np.array([0.8, 0.0, 0.0]), abs=0.03)
    assert added(run) == pytest.approx(added(sound[0]), rel=2e-3)
    assert not proof.passed and any("X is 0.800 off" in reason for reason in proof.reasons)


def centroid(run: DryRun) -> Array:
    """Of the metal above the plate, mm, build frame."""
    field = run.stock.field
    filled = np.clip(0.5 - field.dense((0, 0, 0), field.shape) / field.cell_mm, 0.0, 1.0)
    x, y, z = run.stock.points()
    filled[:, :, z < field.cell_mm] = 0.0
    return np.array(
        [(filled.sum(axis=others) @ axis) / filled.sum() for axis, others in ((x, (1, 2)), (y, (0, 2)), (z, (0, 1)))]
    )
