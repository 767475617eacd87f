"""The whole cell on the paper's four parts: plan, post and prove, then the same job by wire through REST, measured at the plant."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import planner
from cellctl.client import Client, ServiceError
from cellctl.demo import ENDED, Demo, DemoError, ask_sim
from config import load_cell
from planner.errors import PlannerError
from planner.mesh import load
from planner.recipe import load_recipe
from sim import prove
from tests.bench.table import RESULTS, Cell, Table

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"
CELL = "trunnion_tcp"
CUSP_MM = {"pipe": 0.04, "bearing": 0.08, "hinge": 0.08, "double_arc": 0.08}
"""Greatest cusp height: the paper's of Table 1 for pipe and bearing, the recipe's for the parts of Figs. 17 and 18."""
CELL_MM = 0.25
MISSING_SHARE = 0.005  # of the part's volume: the stated bound
TIME_SCALE = 20.0
COLUMNS = (
    "part", "how", "lines", "build min", "took s", "grid mm", "p99 mm", "milled p99 mm", "bound mm", "missing %", "excess mm3",
    "findings", "within",
)  # fmt: skip


class WireRun(Demo):
    """One part through the service: uploaded, planned, posted, proven, approved, run by wire, measured in the simulated plant."""

    def __init__(self, part: str, out: Path) -> None:
        super().__init__(CELL, TIME_SCALE, out, keep=False, as_json=True)
        self.part = part
        self.measured: dict[str, Any] = {}

    def _build(self, client: Client) -> dict[str, Any]:
        uploaded = client.upload(PARTS / f"{self.part}.stl")
        recipe = (PARTS / f"{self.part}.toml").read_text(encoding="utf-8")
        job = client.submit(uploaded["id"], recipe_toml=recipe, name=self.part)
        job = self._until(client, job["id"], ("waiting_for_approval", *ENDED))
        if job["state"] != "waiting_for_approval":
            raise DemoError(f"{self.part}: the job {job['state']}: {job['why']}")
        reasons = client.get(f"jobs/{job['id']}/proof")["reasons"]
        self._clamp(client, job, {**job["proof"], "cell_mm": CELL_MM})
        why = {"override_reason": f"bench: {'; '.join(reasons)}"} if reasons else {}
        with engineer(client, self._out / "store") as entitled:
            entitled.approve(job["id"], because="bench", table_clear=True, **why)
        started = time.perf_counter()
        job = self._until(client, job["id"], ENDED)
        command = {"do": "as_built", "dir": str(self._out / "result"), "name": self.part, "tolerance_mm": bound_mm(self.part)}
        self.measured = ask_sim(self._run_dir / "sim.sock", command)["deviation"]
        return {**job, "passed": job["state"] == "completed", "took_s": time.perf_counter() - started, "reasons": reasons}

    def _tell(self, result: dict[str, Any]) -> None:
        self.result = result


def engineer(client: Client, store: Path) -> Client:
    """A client whose role may override a proof."""
    words = [sys.executable, "-m", "cellctl", "token", "create", "bench", "--role", "engineer", "--store", str(store)]
    return Client(client.url, subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip())


def bound_mm(part: str) -> float:
    """The paper's cusp height and half a cell, mm."""
    return CUSP_MM[part] + 0.5 * CELL_MM


def proven(part: str) -> tuple[Cell, ...]:
    """Plan, post and prove; the picture goes to the results."""
    cell, mesh = load_cell(CELL), load(PARTS / f"{part}.stl", "mm")
    plan = planner.plan(mesh, load_recipe(PARTS / f"{part}.toml"), part_name=part)
    program = planner.post(plan, cell)
    started = time.perf_counter()
    proof = prove(program, cell, mesh, cell_mm=CELL_MM)
    took = time.perf_counter() - started
    (RESULTS / f"{part}_proven.png").write_bytes(proof.picture)
    seen, milled = proof.deviation, proof.milled.p99_mm if proof.milled is not None else proof.deviation.p99_mm
    findings = "; ".join(f"{found.kind} x{found.count}" for found in proof.findings) or "none"
    missing = seen.missing_mm3 / seen.part_mm3
    is_within = milled <= bound_mm(part) and missing <= MISSING_SHARE and not proof.findings
    return (
        part, "proof", proof.lines, proof.duration_s / 60.0, took, CELL_MM, seen.p99_mm, milled, bound_mm(part), 100.0 * missing,
        seen.excess_mm3, findings, "yes" if is_within else "no",
    )  # fmt: skip


def by_wire(part: str) -> tuple[Cell, ...]:
    """The same part by serial line and Modbus; the plant's picture goes to the results."""
    with tempfile.TemporaryDirectory(prefix="bench-cell-") as place:
        run = WireRun(part, Path(place) / "run")
        run.run()
        shutil.copyfile(Path(place) / "run" / "result" / "as_built.png", RESULTS / f"{part}_by_wire.png")
    seen, job = run.measured, run.result
    findings = "; ".join([*job["reasons"], *([] if job["passed"] else [job["why"]])]) or "none"
    missing = seen["missing_mm3"] / seen["part_mm3"]
    is_within = findings == "none" and seen["p99_mm"] <= bound_mm(part) and missing <= MISSING_SHARE
    return (
        part, "by wire", job["lines_total"], job["duration_s"] / 60.0, job["took_s"], seen["cell_mm"], seen["p99_mm"], "-",
        bound_mm(part), 100.0 * missing, seen["excess_mm3"], findings, "yes" if is_within else "no",
    )  # fmt: skip


def row(part: str, how: str, build: Callable[[str], tuple[Cell, ...]]) -> tuple[Cell, ...]:
    """A part's line; one that is refused has its reason among the findings."""
    try:
        return build(part)
    except (PlannerError, DemoError, ServiceError) as error:
        return (part, how, *["-"] * (len(COLUMNS) - 4), " ".join(str(error).split()), "no")


def run() -> list[Table]:
    """The four parts, or those of them named on the command line: proven, then built by wire."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    chosen = [part for part in CUSP_MM if part in sys.argv[1:]] or list(CUSP_MM)
    rows = [row(part, "proof", proven) for part in chosen] + [row(part, "by wire", by_wire) for part in chosen]
    note = (
        f"hybrid, {CELL}; bound: C_max and half a cell; missing at most {100 * MISSING_SHARE:g} %; "
        f"by wire {TIME_SCALE:g} times as fast as a real cell, all of the surface measured at the plant; pictures beside this table"
    )
    return [Table("The paper's four through the whole cell", COLUMNS, rows, note)]
