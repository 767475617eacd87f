"""The paper's two examples, and the other shipped parts, as layers with ruled sides: how many, how far off, how fast."""

from __future__ import annotations

import time
from pathlib import Path

from planner.mesh import load
from planner.model import approximate
from tests.bench.table import Cell, Table

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"

EXAMPLES = (
    ("pipe", "standing", (0.0, 0.0, 1.0), 0.04),
    ("pipe", "lying", (1.0, 0.0, 0.0), 0.04),
    ("bearing", "standing", (0.0, 0.0, 1.0), 0.08),
    ("hinge", "standing", (0.0, 0.0, 1.0), 0.05),
    ("double_arc", "standing", (0.0, 0.0, 1.0), 0.05),
)
"""Part, how it stands, build direction, greatest cusp (mm): the paper's for pipe and bearing (Table 1), 0.05 elsewhere."""


def run() -> list[Table]:
    """Approximate every part and measure the closed model against the mesh, both ways."""
    rows: list[list[Cell]] = []
    approximate(load(PARTS / "pipe.stl"), (1.0, 0.0, 0.0), 0.04).deviation()  # compiles the kernels
    for name, stands, direction, cusp_mm in EXAMPLES:
        mesh = load(PARTS / f"{name}.stl")
        started = time.process_time()
        made = approximate(mesh, direction, cusp_mm)
        took = time.process_time() - started
        found, counts = made.deviation(), made.counts
        rows.append(
            [f"{name}, {stands}", cusp_mm, counts.layers, counts.contours, counts.branchings, counts.direct,
             counts.indirect, found.max_mm, found.p99_mm, 100.0 * found.volume_error,
             "yes" if found.max_mm <= cusp_mm and made.triangles().is_closed else "NO", took, counts.layers / took]
        )  # fmt: skip
    columns = [
        "part", "C_max mm", "layers", "contours", "branchings", "direct", "indirect", "max mm", "p99 mm",
        "volume %", "closed, below C_max", "CPU s", "layers/s",
    ]  # fmt: skip
    note = (
        "Deviation: exact distances between samples of the watertight model and of the mesh, both ways, the percentile "
        "by area. Matches: pairs of contours found by a common or adjacent facets (direct), by climbing (indirect). "
        "CPU time includes measuring the whole."
    )
    return [Table("Examples of the paper", columns, rows, note)]
