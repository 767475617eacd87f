"""A rotary pivot that lies elsewhere than the Program was posted for: what is done tilted is displaced, what is done upright is not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from config import Cell, load_cell, load_material
from planner.mesh.mesh import Mesh
from planner.program import Channel, LineKind, Program
from sim.dryrun import DryRun
from tests.cell.jobs import Writer

Array = NDArray[np.float64]

CELL = load_cell("trunnion_tcp")
CELL_MM = 0.4
TILT_DEG = 20.0
PIVOT = np.array([0.0, 0.0, -450.0])  # of A, as in the cell file
MOVED = np.array([0.0, 1.1, 2.2])  # by so much the real pivot lies elsewhere
ORIGIN = np.array(CELL.placement.part_origin_mm)


def turned(deg: float) -> Array:
    """(3, 3) float   Table to machine at this angle of A, which turns about -X (right hand)."""
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


def displaced(deg: float) -> Array:
    """(3,) float, mm   Where the tip goes on the table, less where it should: (1 - R^T) d, of length 2 sin(a/2) |d|."""
    apart: Array = (np.eye(3) - turned(deg).T) @ MOVED
    assert np.linalg.norm(apart) == pytest.approx(2.0 * np.sin(np.radians(deg) / 2.0) * np.linalg.norm(MOVED))
    return apart


@cache
def cell_with_moved_pivot() -> Cell:
    pivots = {"A": tuple((PIVOT + MOVED).tolist())}
    return CELL.model_copy(update={"placement": CELL.placement.model_copy(update={"pivots_mm": pivots})})


@dataclass
class Tilted(Writer):
    """A Writer with the table at an angle of A; its joints follow from the pivot by hand."""

    tilt_deg: float = 0.0

    def joints(self) -> Array:
        """(5,) joints of tip and tilt."""
        offset = np.array(next(tool.tip_mm for tool in self.cell.tools if tool.number == self.tool))
        return np.concatenate(
            [turned(self.tilt_deg) @ (self.tip + ORIGIN - PIVOT) + PIVOT - offset, [self.tilt_deg, 0.0]]
        )

    def move(self, x: float, y: float, z: float, kind: LineKind, feed_mm_s: float) -> int:
        """Straight line of the tip in the build frame, and to the angle that is set."""
        seconds = max(float(np.linalg.norm(np.array([x, y, z]) - self.tip)) / feed_mm_s, 0.01)
        self.tip = np.array([x, y, z])
        words = self.joints() - [self.cell.placement.work_offset[letter] for letter in "XYZAC"]
        text = " ".join(f"{letter}{value:.4f}" for letter, value in zip("XYZAC", words, strict=True))
        return self.line(f"G1 {text} F{60.0 / seconds:.4f}", kind, seconds)

    def go(self, tip: Array, kind: LineKind, feed_mm_s: float) -> int:
        """The same to a point, (3,) mm."""
        x, y, z = tip.tolist()
        return self.move(x, y, z, kind, feed_mm_s)


def axis_at(deg: float) -> Array:
    """(3,) float   Tool axis in the build frame."""
    axis: Array = turned(deg).T @ np.array([0.0, 0.0, 1.0])
    return axis


def pass_of(w: Tilted, start: Array, end: Array, deg: float, feed_mm_s: float, operation: int) -> int:
    """Over the start, tilt, down the axis, along, up again. N-word of the approach."""
    w.layer, w.operation = 0, operation
    away = 25.0 * axis_at(deg)
    w.tilt_deg = deg
    w.go(start + 2.0 * away, LineKind.LINK, 20.0)
    w.go(start + away, LineKind.LINK, 40.0)
    down = w.go(start, LineKind.LINK, 20.0)
    if w.tool == 1:
        w.line("M62 P0", LineKind.PROCESS)
    w.go(end, LineKind.PROCESS, feed_mm_s)
    if w.tool == 1:
        w.line("M63 P0", LineKind.PROCESS)
    w.go(end + away, LineKind.LINK, 20.0)
    w.go(end + 2.0 * away, LineKind.LINK, 40.0)
    return down


def box(low: list[float], high: list[float]) -> Mesh:
    solid = trimesh.creation.box(bounds=[low, high])
    return Mesh(np.asarray(solid.vertices), np.asarray(solid.faces))


@cache
def tracks() -> Program:
    """Two beads on the plate along X: at y = 6 with the table flat, at y = -6 with A tilted."""
    w = Tilted(CELL)
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    for operation, (y, deg) in enumerate(((6.0, 0.0), (-6.0, TILT_DEG))):
        first = len(w.lines) + 1
        down = pass_of(w, np.array([-8.0, y, 0.0]), np.array([8.0, y, 0.0]), deg, 12.0, operation)
        if operation == 0:
            w.at(first, Channel.MODE, 1, barrier=True)
            w.at(first, Channel.CARRIER_GAS_L_MIN, 5.0, barrier=True)
            w.at(first, Channel.SHIELD_GAS_L_MIN, 15.0, barrier=True)
        w.at(down, Channel.POWDER_G_MIN, 12.0, barrier=True)
        w.at(down, Channel.LASER_W, 1200.0)
    w.at(w.line("M2", LineKind.SETUP), Channel.MODE, 0, barrier=True)
    return replace(w.program("tracks", [0]), process="deposit")


STOCK_TOP_MM, CHAMFER_AT = 6.0, np.array([0.0, -6.0, 4.4])
FACE_MM = 5.0


@cache
def cuts() -> Program:
    """A block is faced at z = 5 with the table flat on y > 0, and gets a chamfer with A tilted on y < 0."""
    w = Tilted(CELL, tool=2)
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    n = w.line("M6 T2", LineKind.TOOL)
    w.at(n, Channel.MODE, 2, barrier=True)
    w.line("M3 S6000", LineKind.SETUP)
    pass_of(w, np.array([-16.0, 6.0, FACE_MM]), np.array([16.0, 6.0, FACE_MM]), 0.0, 15.0, 0)
    reach = np.array([16.0, 0.0, 0.0])
    pass_of(w, CHAMFER_AT - reach, CHAMFER_AT + reach, TILT_DEG, 15.0, 1)
    w.line("M5", LineKind.SETUP)
    w.at(w.line("M2", LineKind.SETUP), Channel.MODE, 0, barrier=True)
    return replace(w.program("cuts", [0]), process="mill", tolerance_mm=0.2)


def ran(program: Program, cell: Cell, part: Mesh, stock: Mesh | None) -> DryRun:
    run = DryRun(program, cell, part, load_material("316L"), stock, CELL_MM)
    run.execute()
    return run


def beads() -> Mesh:
    """Two bars that lie inside the two beads."""
    bars = [trimesh.creation.box(bounds=[[-4.0, y - 0.4, 0.0], [6.0, y + 0.4, 0.6]]) for y in (6.0, -6.0)]
    vertices = np.vstack([bar.vertices for bar in bars])
    return Mesh(vertices, np.vstack([bars[0].faces, bars[1].faces + len(bars[0].vertices)]))


def bevelled() -> Mesh:
    """The block as the two cuts should leave it: a profile in y and z, drawn out along x."""
    slope, lean = np.tan(np.radians(TILT_DEG)), axis_at(TILT_DEG)
    edge = CHAMFER_AT[1:] + 4.0 * np.array([lean[2], -lean[1]])  # of the cutter's end face, on the ridge's side
    ridge = edge + (STOCK_TOP_MM - edge[1]) / lean[2] * lean[1:]  # its flank leaves the stock's top here
    low = CHAMFER_AT[2] + slope * (-9.0 - CHAMFER_AT[1])
    corners = [[-9.0, 0.0], [9.0, 0.0], [9.0, FACE_MM], [2.0, FACE_MM], [2.0, STOCK_TOP_MM], ridge, edge, [-9.0, low]]
    profile = np.array(corners, dtype=np.float64)
    count = len(profile)
    cap = [[0, 1, 2], [0, 2, 3], [3, 4, 5], [3, 5, 6], [0, 3, 6], [0, 6, 7]]
    sides = [[k, count + k, count + (k + 1) % count] for k in range(count)] + [
        [k, count + (k + 1) % count, (k + 1) % count] for k in range(count)
    ]
    facets = (
        [[c, b, a] for a, b, c in cap]
        + [[a + count, b + count, c + count] for a, b, c in cap]
        + [[a, c, b] for a, b, c in sides]
    )
    vertices = np.vstack([np.column_stack([np.full(count, x), profile]) for x in (-10.0, 10.0)])
    solid = trimesh.Trimesh(vertices, facets, process=False)
    assert solid.is_watertight and solid.volume > 0.0
    return Mesh(vertices, np.array(facets))


def raw_block() -> Mesh:
    return box([-10.0, -9.0, 0.0], [10.0, 9.0, STOCK_TOP_MM])


@pytest.fixture(scope="module")
def laid() -> tuple[DryRun, DryRun]:
    """The beads with the pivot where it should be, and elsewhere."""
    return ran(tracks(), CELL, beads(), None), ran(tracks(), cell_with_moved_pivot(), beads(), None)


@pytest.fixture(scope="module")
def milled() -> tuple[DryRun, DryRun]:
    """The cuts with the pivot where it should be, and elsewhere."""
    return ran(cuts(), CELL, bevelled(), raw_block()), ran(cuts(), cell_with_moved_pivot(), bevelled(), raw_block())


def middle_of_bead(run: DryRun, side: float) -> float:
    """Where across y the bead on one side of the plate has its middle, mm."""
    field = run.stock.field
    filled = np.clip(0.5 - field.dense((0, 0, 0), field.shape) / field.cell_mm, 0.0, 1.0)
    _, y, z = run.stock.points()
    bead = filled[:, side * y > 0.0][:, :, z > 0.3].sum(axis=(0, 2))
    return float(bead @ y[side * y > 0.0] / bead.sum())


def heights(run: DryRun, y: list[float]) -> Array:
    """Height of the metal over points of the middle section, mm."""
    z = np.arange(STOCK_TOP_MM + 1.0, 0.0, -0.005)
    columns = [run.stock.distance(np.column_stack([0.0 * z, 0.0 * z + at, z])) < 0.0 for at in y]
    return np.array([z[np.argmax(inside)] for inside in columns])


def test_bead_laid_tilted_is_displaced_by_what_the_chain_says_and_the_upright_one_is_not(
    laid: tuple[DryRun, DryRun],
) -> None:
    sound, moved = laid
    assert middle_of_bead(moved, 1.0) == pytest.approx(middle_of_bead(sound, 1.0), abs=1e-6)
    shift, axis = displaced(TILT_DEG), axis_at(TILT_DEG)
    on_plate = shift - shift[2] / axis[2] * axis  # the beam goes on along its axis until it meets the plate
    assert middle_of_bead(moved, -1.0) - middle_of_bead(sound, -1.0) == pytest.approx(on_plate[1], abs=0.03)
    assert sound.conclude().passed, sound.conclude().reasons
    proof = moved.conclude()
    assert not proof.passed and any(reason.startswith("missing metal") for reason in proof.reasons)


def test_chamfer_cut_tilted_is_displaced_by_what_the_chain_says_and_the_upright_face_is_not(
    milled: tuple[DryRun, DryRun],
) -> None:
    sound, moved = milled
    face, chamfer = [3.0, 5.0, 8.0], [-8.0, -6.0, -4.0]
    assert heights(sound, face) == pytest.approx(np.full(3, FACE_MM), abs=0.01)
    assert heights(moved, face) == pytest.approx(heights(sound, face), abs=1e-6)
    axis = axis_at(TILT_DEG)
    lower = float(axis @ displaced(TILT_DEG)) / axis[2]  # of the plane across the axis, along z
    assert lower < -0.3
    assert heights(moved, chamfer) - heights(sound, chamfer) == pytest.approx(np.full(3, lower), abs=0.02)


def test_proof_names_the_gouge_of_a_wrong_pivot_and_finds_none_with_the_right_one(
    milled: tuple[DryRun, DryRun],
) -> None:
    sound, moved = (run.conclude() for run in milled)
    assert sound.passed, sound.reasons
    assert sound.findings == ()
    gouges = [finding for finding in moved.findings if finding.kind == "gouge"]
    assert not moved.passed and [finding.operation for finding in gouges] == [1]  # the tilted pass
    depth = -float(axis_at(TILT_DEG) @ displaced(TILT_DEG))
    assert gouges[0].depth_mm == pytest.approx(depth, abs=0.1)
    assert gouges[0].at_mm is not None and gouges[0].at_mm[1] < 0.0
    assert any(reason.startswith("gouge") for reason in moved.reasons)
