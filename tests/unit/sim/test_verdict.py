"""The verdict: each threshold alone decides, and warnings do not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from config import load_cell, load_material
from sim.deviation import Deviation
from sim.findings import Finding
from sim.job import Job
from sim.proof import thresholds_of, verdict
from tests.unit.sim.test_findings import Text

GOOD = Deviation(
    mean_mm=0.0, p50_mm=0.01, p95_mm=0.03, p99_mm=0.09, max_excess_mm=0.2, max_missing_mm=0.2, missing_mm3=4.0, excess_mm3=5.0,
    part_mm3=1000.0, samples=5000, cell_mm=0.25,
)  # fmt: skip
CELL, METAL = load_cell("trunnion_tcp"), load_material("316L")
LIMITS = thresholds_of(Text(process="hybrid"), CELL, METAL)


def test_part_within_all_thresholds_passes_even_with_a_warning() -> None:
    warning = Finding("clearance", "near", 3, 0, 0, severity="warning")
    assert verdict(GOOD, GOOD, (warning,), LIMITS) == (True, ())


@pytest.mark.parametrize(
    ("whole", "milled", "words"),
    [
        (replace(GOOD, p99_mm=0.11), None, "surface: 99 % lies within 0.110 mm"),
        (GOOD, replace(GOOD, p99_mm=0.12), "milled surface"),
        (replace(GOOD, missing_mm3=6.0), None, "missing metal: 6.0 mm3 (0.60 % of the part)"),
    ],
)
def test_each_threshold_alone_fails_the_proof(whole: Deviation, milled: Deviation | None, words: str) -> None:
    passed, reasons = verdict(whole, milled, (), LIMITS)
    assert not passed
    assert len(reasons) == 1 and reasons[0].startswith(words)


def test_an_error_fails_with_its_line_and_layer() -> None:
    passed, reasons = verdict(GOOD, None, (Finding("gouge", "deep", 7, 2, 1),), LIMITS)
    assert (passed, reasons) == (False, ("gouge: deep (line N7, layer 2)",))


def test_thresholds_come_from_the_cell_and_the_job() -> None:
    limits = CELL.proof.model_copy(update={"missing_share": 0.01, "gouge_mm": 0.05})
    cell = CELL.model_copy(update={"proof": limits})
    job: Job = Text(process="hybrid", tolerance_mm=0.3)
    thresholds = thresholds_of(job, cell, METAL)
    assert (thresholds["missing_share"], thresholds["gouge_mm"], thresholds["allowed_mm"]) == (0.01, 0.05, 0.3)
    assert thresholds_of(job, CELL, METAL)["gouge_mm"] == 0.3
    assert verdict(replace(GOOD, missing_mm3=6.0), None, (), thresholds)[0]


def test_part_that_is_only_deposited_may_stand_out_by_a_bead() -> None:
    assert thresholds_of(Text(process="deposit"), CELL, METAL)["allowed_mm"] > 0.1 + 0.3
