"""Any part without supports: the paper's four and the parts of tests/parts, planned, posted and proven, with pictures.

`make bench ARGS="any_part hinge table"` runs the parts named only; `growth` and `heads` choose the tables beside the first.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from typing import Any

from tests.bench.part_run import CELL, GRID_MM, LIMIT_CPU_S, ROOT, UPRIGHT, names
from tests.bench.table import RESULTS, Cell, Table
from tests.parts.catalogue import SEGMENTS

LIMIT_S = 4.0 * LIMIT_CPU_S
"""Wall clock for one part from mesh to proof, on a machine that others use too; a part that takes longer is a row that says so."""
LATE = 1000  # instead of an exit code
LEANING = ("leaning_wall", "bent_pipe", "dome", "funnel", "spherical_shell")
GROWN = ("bent_pipe", "tee")
FACETS = (32, 64, 128, 256)  # segments to a full circle
LAYERS_MM = (0.9, 0.6, 0.4)
EVEN = {"cusp_mm": 2.0}  # layers are as high as the recipe asks, whatever the facets
COLUMNS = (
    "part", "process", "facets", "pieces", "set-ups", "layers", "layer mm", "overhang mm2", "left mm2", "support mm3",
    "unsupported mm", "plan s", "plan CPU s", "first piece s", "build min", "proof s", "p99 mm", "missing %", "verdict", "why",
)  # fmt: skip


def measured(name: str, stages: str = "proof", segments: int = SEGMENTS, **changes: Any) -> dict[str, Any]:
    """Figures of a part, in a process of its own; `failed` says in one line what went wrong. changes : fields of the recipe"""
    words = [sys.executable, "-m", "tests.bench.part_run", name, str(RESULTS), str(segments), json.dumps(changes), stages]
    try:
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=LIMIT_S)
        said, code = done.stdout, done.returncode
    except subprocess.TimeoutExpired as late:
        said, code = (late.stdout or b"").decode() if isinstance(late.stdout, bytes) else late.stdout or "", LATE
    lines = [line for line in said.splitlines() if line.startswith("{")]
    figures: dict[str, Any] = json.loads(lines[-1]) if lines else {"stage": "plan"}
    if figures["stage"] != "done" and "failed" not in figures:
        ends = {LATE: f"not done after {LIMIT_S:.0f} s", -signal.SIGXCPU: f"not done after {LIMIT_CPU_S} s of CPU"}
        figures["failed"] = f"after {figures['stage']}: {ends.get(code, f'process ended with {code}')}"
    (RESULTS / f"{name}{changes.get('_name', '')}_figures.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")
    return figures


def cell_of(figures: dict[str, Any], key: str, scale: float = 1.0) -> Cell:
    """A figure, or a dash where that stage was not reached."""
    value = figures.get(key, "-")
    if isinstance(value, (int, float)) and scale != 1.0:
        value *= scale
    return "-" if isinstance(value, float) and math.isnan(value) else value


def verdict(figures: dict[str, Any]) -> tuple[str, str]:
    """Verdict and its reasons in a few words."""
    if "failed" in figures:
        return "FAILED", str(figures["failed"]).replace("|", "/")
    reasons, found = figures["reasons"], figures["findings"]
    return ("passed" if figures["passed"] else "REFUSED"), "; ".join([*reasons, *([] if reasons else found)]).replace("|", "/")


def row(name: str, figures: dict[str, Any]) -> tuple[Cell, ...]:
    """One line of the first table."""
    heights = f"{figures['thinnest_mm']:.2f} - {figures['thickest_mm']:.2f}" if "thinnest_mm" in figures else "-"
    keys = ("overhang_mm2", "left_mm2", "support_mm3", "unsupported_mm", "plan_s", "plan_cpu_s", "first_s", "build_min", "proof_s", "p99_mm")
    return (
        name, *(cell_of(figures, key) for key in ("process", "facets", "subcomponents", "setups", "layers")), heights,
        *(cell_of(figures, key) for key in keys), cell_of(figures, "missing_share", 100.0), *verdict(figures),
    )  # fmt: skip


def parts_table(chosen: list[str]) -> Table:
    """Every part, its plan and its proof."""
    rows = []
    for name in chosen:
        rows.append(row(name, measured(name)))
        print(f"  {' | '.join(str(cell) for cell in rows[-1])}", file=sys.stderr, flush=True)
    note = (
        f"{CELL}, grid {GRID_MM:g} mm, one process per part, kernels compiled; overhang: paper Eq. 1, all layers; left: beyond what a "
        f"tilted bead holds; unsupported: along the side surface; first piece: until its last layer is handed out; {_machine()}"
    )
    return Table("Any part", COLUMNS, rows, note)


def heads_table(chosen: list[str]) -> Table:
    """The same leaning parts with the head along the side surface and with a fixed vertical head."""
    rows: list[list[Cell]] = []
    for name in chosen:
        for head, changes in (("tilted", {}), ("upright", {**UPRIGHT, "_name": "_upright"})):
            seen = measured(name, **changes)
            keys = ("overhang_mm2", "unsupported_mm", "p99_mm", "excess_mm3", "lost_powder_mm3")
            rows.append([name, head, *(cell_of(seen, key) for key in keys), cell_of(seen, "missing_share", 100.0), *verdict(seen)])
    columns = ["part", "head", "overhang mm2", "unsupported mm", "p99 mm", "excess mm3", "lost powder mm3", "missing %", "verdict", "why"]
    return Table("Leaning walls with a tilted and an upright head", columns, rows, f"deposited only, no support; {_machine()}")


def growth_table() -> Table:
    """Planning time against facets and against layers, with the power of the growth from row to row."""
    rows: list[list[Cell]] = []
    for name in GROWN:
        runs = [("facets", measured(name, "plan", segments, _name="_growth", **EVEN)) for segments in FACETS]
        runs += [("layers", measured(name, "plan", _name="_growth", layer_height_mm=height, **EVEN)) for height in LAYERS_MM]
        before: dict[str, dict[str, Any]] = {}
        for against, seen in runs:
            power = _power(before.get(against), seen, against)
            before[against] = seen
            figures = [cell_of(seen, key) for key in ("facets", "layers", "plan_cpu_s", "plan_s", "first_s")]
            rows.append([name, against, *figures, power, str(seen.get("failed", ""))])
    columns = ["part", "against", "facets", "layers", "plan CPU s", "plan s", "first piece s", "power", "why"]
    note = f"power p of CPU time ~ (n log n)^p for facets, n^p for layers, against the row before; 1 is what is promised; {_machine()}"
    return Table("Growth of planning any part", columns, rows, note)


def _power(before: dict[str, Any] | None, now: dict[str, Any], against: str) -> Cell:
    """Exponent of the growth between two runs."""
    if before is None or "plan_cpu_s" not in before or "plan_cpu_s" not in now or before[against] == now[against]:
        return "-"
    size = [float(figures[against]) for figures in (before, now)]
    if against == "facets":
        size = [n * math.log(n) for n in size]
    return math.log(now["plan_cpu_s"] / before["plan_cpu_s"]) / math.log(size[1] / size[0])


def _machine() -> str:
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"


def run() -> list[Table]:
    """The tables asked for; all if neither parts nor tables are named."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    words = sys.argv[1:]
    chosen = [name for name in names() if name in words]
    is_all = not chosen and not {"growth", "heads"} & set(words)
    tables = [parts_table(chosen or names())] if is_all or (chosen and "heads" not in words) else []
    if is_all or "heads" in words:
        tables.append(heads_table([name for name in LEANING if name in chosen] or list(LEANING)))
    if is_all or "growth" in words:
        tables.append(growth_table())
    return tables
