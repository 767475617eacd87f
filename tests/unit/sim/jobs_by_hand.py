"""Two sound Programs made by hand, a low block that is faced beside a tall wall and a wall of beads, which tests then break on purpose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import trimesh

from config import Cell, load_cell
from planner.mesh.mesh import Mesh
from planner.program import Channel, LineKind, Program
from sim.dryrun import prove
from sim.findings import Finding
from sim.proof import Proof
from tests.cell.jobs import Writer

CELL = load_cell("trunnion_tcp")
CELL_MM = 0.4
TOLERANCE_MM = 0.2
TOP_MM, RAW_MM = 4.0, 4.5  # of the block: what it shall become, and as it lies there
WALL_X, WALL_WIDE, WALL_HIGH = 20.0, 6.0, 40.0  # face, thickness and height of the wall, which is not worked on
HALF_Y = 8.0  # of block and wall
PASSES_X = (-14.0, -10.0, -6.0, -2.0)
PASS_Y = 16.0  # where passes begin and end
SAFE_MM, FAST_MM_S, CUT_MM_S = 60.0, 150.0, 15.0

Extra = Callable[[Writer], int]
"""Writes more lines behind the last pass, with the tip at (-2, -16, 60) and tool 2; returns the N-word of the line at fault."""


def boxes(*corners: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Mesh:
    """A mesh of boxes, each by two corners."""
    made = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(pair)) for pair in corners])
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def block_and_wall(top_mm: float) -> Mesh:
    """The block up to a height, and the wall beside it."""
    wall = ((WALL_X, -HALF_Y, 0.0), (WALL_X + WALL_WIDE, HALF_Y, WALL_HIGH))
    return boxes(((-16.0, -HALF_Y, 0.0), (0.0, HALF_Y, top_mm)), wall)


def faced(extra: Extra | None = None, *, deeper_mm: float = 0.0, spindle: bool = True, rapid: bool = False) -> tuple[Program, int]:
    """The block faced in four passes along y with the D8, and the N-word at fault: of the extra line, else of the third pass.

    deeper_mm : how much too deep the third pass is   spindle : whether it turns   rapid : whether the third pass is a rapid
    """
    w = Writer(CELL)
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.layer = w.operation = 0
    w.at(w.line("M6 T2", LineKind.TOOL), Channel.MODE, 2, barrier=True)
    w.tool = 2
    if spindle:
        w.line("M3 S6000", LineKind.SETUP)
    side, fault = -1.0, 0
    w.move(PASSES_X[0], side * PASS_Y, SAFE_MM, LineKind.LINK, FAST_MM_S)
    for k, x in enumerate(PASSES_X):
        z = TOP_MM - (deeper_mm if k == 2 else 0.0)
        w.move(x, side * PASS_Y, z, LineKind.LINK, FAST_MM_S)
        side = -side
        n = w.move(x, side * PASS_Y, z, LineKind.PROCESS, CUT_MM_S)
        if k == 2:
            fault = n
            if rapid:
                w.lines[n - 1] = w.lines[n - 1].replace("G1", "G0").split(" F")[0]
        w.move(x, side * PASS_Y, TOP_MM, LineKind.LINK, FAST_MM_S)
    w.move(PASSES_X[-1], -PASS_Y, SAFE_MM, LineKind.LINK, FAST_MM_S)
    w.operation = 1
    if extra is not None:
        fault = extra(w)
    w.line("M5", LineKind.SETUP)
    w.at(w.line("M2", LineKind.SETUP), Channel.MODE, 0, barrier=True)
    return replace(w.program("block and wall", [1]), process="mill", tolerance_mm=TOLERANCE_MM), fault


def prove_faced(program: Program, cell: Cell = CELL) -> Proof:
    """Proof of a facing against the block and the wall as they shall be."""
    return prove(program, cell, block_and_wall(TOP_MM), stock=block_and_wall(RAW_MM), cell_mm=CELL_MM)


LAYERS, LAYER_MM, LENGTH_MM, PIECES = 3, 0.66, 24.0, 6
POWER_W, POWDER_G_MIN, FEED_MM_S, LEAD_MM = 1200.0, 12.0, 12.0, 4.0


@cache
def beads() -> Program:
    """Three beads over one another along x, all to the right, each with its own powder and gate."""
    w = Writer(CELL)
    starts = []
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    for layer in range(LAYERS):
        w.layer = w.operation = layer
        starts.append(len(w.lines))
        z = layer * LAYER_MM
        n = w.move(-0.5 * LENGTH_MM - LEAD_MM, 0.0, z + 20.0, LineKind.LINK, FAST_MM_S)
        if layer == 0:
            w.at(n, Channel.MODE, 1, barrier=True)
            w.at(n, Channel.CARRIER_GAS_L_MIN, 5.0, barrier=True)
            w.at(n, Channel.SHIELD_GAS_L_MIN, 15.0, barrier=True)
        n = w.move(-0.5 * LENGTH_MM - LEAD_MM, 0.0, z, LineKind.LINK, 40.0)
        w.at(n, Channel.POWDER_G_MIN, POWDER_G_MIN, barrier=True)
        w.at(w.move(-0.5 * LENGTH_MM, 0.0, z, LineKind.PROCESS, FEED_MM_S), Channel.LASER_W, POWER_W)
        w.line("M62 P0", LineKind.PROCESS)
        for k in range(PIECES):
            if 2 * k == PIECES:
                w.line("G90", LineKind.PROCESS)  # does nothing: room for something wrong in the middle
            w.move((k + 1) * LENGTH_MM / PIECES - 0.5 * LENGTH_MM, 0.0, z, LineKind.PROCESS, FEED_MM_S)
        w.line("M63 P0", LineKind.PROCESS)
        w.move(0.5 * LENGTH_MM + LEAD_MM, 0.0, z, LineKind.LINK, FEED_MM_S)
        w.move(0.5 * LENGTH_MM + LEAD_MM, 0.0, z + 20.0, LineKind.LINK, FAST_MM_S)
    w.at(w.line("M2", LineKind.SETUP), Channel.MODE, 0, barrier=True)
    return replace(w.program("beads", starts), process="deposit", tolerance_mm=0.5)


@cache
def beads_part() -> Mesh:
    """A box that lies inside the beads."""
    return boxes(((-10.0, -0.7, 0.0), (11.0, 0.7, 1.5)))


def prove_beads(program: Program, cell: Cell = CELL) -> Proof:
    """Proof of the beads against a box that lies inside them."""
    return prove(program, cell, beads_part(), cell_mm=CELL_MM)


def edited(change: dict[int, str]) -> Program:
    """The beads' Program with some lines of its text, by N-word, written anew."""
    given = beads()
    assert all(0 < n <= len(given.lines) for n in change)
    return replace(given, lines=tuple(f"N{n} {change[n]}" if n in change else line for n, line in enumerate(given.lines, 1)))


def line_of(word: str, layer: int, program: Program | None = None) -> int:
    """N-word of the first line of a layer of the beads that ends so."""
    given = program or beads()
    return next(n for n, line in enumerate(given.lines, 1) if line.endswith(" " + word) and given.table["layer"][n - 1] == layer)


def the(proof: Proof, kind: str) -> Finding:
    """The only finding of a kind; that it says what would help is looked at on the way."""
    found = [each for each in proof.findings if each.kind == kind]
    assert len(found) == 1, [(each.kind, each.text, each.line) for each in proof.findings]
    assert found[0].help.endswith(".") and found[0].text
    return found[0]
