"""Error of the melt law against published single tracks, agreement of twin and planner, and what one bead costs."""

from __future__ import annotations

import time

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import load_material
from sim.process.melt import MeltLaw, bead_at, bead_section, melt_law
from tests.bench.table import Cell, Table
from tests.unit.sim.published import HEAD, errors_of, track_sets

MATERIALS = ("316L", "inconel718", "ti6al4v")
CALLS = 1_000_000
AMBIENT_K = 293.0


def run() -> list[Table]:
    """The tables that `make bench` prints."""
    return [_published(), _usual(), _cost()]


def _percent(signed: NDArray[np.float64]) -> list[Cell]:
    if not signed.size:
        return ["", ""]
    return [f"{100.0 * np.abs(signed).mean():.1f}", f"{100.0 * np.quantile(np.abs(signed), 0.9):.1f}"]


def _published() -> Table:
    rows: list[list[Cell]] = []
    for tracks in track_sets():
        found = errors_of(tracks)
        spot: Cell = "as stated" if "spot_mm" in tracks.measured else f"{found.spot_mm:.1f}"
        jet: Cell = f"{found.jet_diameter_mm:.2f}" if found.height.size else ""
        constants: list[Cell] = [f"{found.absorptivity:.2f}", spot, jet]
        held = _percent(found.held_out(found.width)) + _percent(found.held_out(found.height))
        rows.append([tracks.name, int(found.width.size), *constants, *_percent(found.width), *held])
    columns = ["set", "tracks", "absorptivity", "spot mm", "jet mm", "width all: mean %", "p90 %"]
    columns += ["width held out: mean %", "p90 %", "height held out: mean %", "p90 %"]
    note = "Absolute relative errors. Constants are fitted on one half of the tracks. Sources and what is not known: tests/unit/sim/published.toml."
    return Table("melt law against published single tracks", columns, rows, note)


def _usual() -> Table:
    rows: list[list[Cell]] = []
    for name in MATERIALS:
        material = load_material(name)
        window = material.deposition
        power, powder, speed = window.laser_w.usual, window.powder_g_min.usual, window.speed_mm_s.usual
        law, planned = melt_law(material, HEAD), bead_section(material, power, powder, speed)
        cold = bead_at(law, power, powder, speed, 0.0, 1.0, AMBIENT_K)
        warm = bead_at(law, power, powder, speed, 0.0, 1.0, AMBIENT_K + 150.0)
        far = bead_at(law, power, powder, speed, 3.0, 1.0, AMBIENT_K)
        rows.append([name, planned.width_mm, planned.height_mm, *cold, warm[0], far[2]])
    columns = ["material", "planned width mm", "planned height mm", "width mm", "height mm", "area mm2", "depth mm"]
    return Table("usual beads of planner and twin", [*columns, "width, 150 K warmer", "area, 3 mm off focus"], rows)


@njit(cache=True)
def _many(law: MeltLaw, count: int) -> float:
    total = 0.0
    for i in range(count):
        total += bead_at(law, 1000.0 + i % 500, 12.0, 12.0, 0.001 * (i % 1000), 0.99, 300.0 + i % 100)[0]
    return total


def _cost() -> Table:
    law = melt_law(load_material("316L"), HEAD)
    _many(law, 10)
    started = time.process_time()
    _many(law, CALLS)
    return Table("cost of one bead", ["calls", "us per call"], [[CALLS, 1e6 * (time.process_time() - started) / CALLS]])
