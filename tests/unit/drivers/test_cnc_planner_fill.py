"""What is posted without complaint keeps the machine's planner filled over the real wire; a link too slow for a pass is found when posting."""

from __future__ import annotations

import numpy as np
import pytest

from config.cell import Cell, load_cell
from planner.post import post_with_report
from planner.program import LineKind, Program
from tests.bench.cnc_far_end import Answers, Counts, FarEnd
from tests.bench.streaming import Case
from tests.bench.streaming_in_memory import in_memory
from tests.unit.planner.hand_plan import cone_operation, oval_operation, plan_of

FINE_MM = 0.001  # chord tolerance: short blocks
SLOW_BAUD = 2400
PROMPT = Answers("prompt")


def cell_with(**cnc: object) -> Cell:
    cell = load_cell("trunnion_tcp")
    return cell.model_copy(update={"chord_tolerance_mm": FINE_MM, "cnc": cell.cnc.model_copy(update=cnc)})


def posted(cell: Cell) -> tuple[Program, list[str]]:
    program, report = post_with_report(plan_of([oval_operation(0), cone_operation(0)]), cell)
    return program, list(report.findings)


def streamed(program: Program, rx: int, baud: int) -> Counts:
    """The Program over a wire of `baud`: the machine moves on each line as long as its table says."""
    table = program.table
    is_pass = table["kind"] == LineKind.PROCESS
    goes_on = is_pass & np.roll(is_pass & (table["pass_"] >= 0), 1) & (table["pass_"] == np.roll(table["pass_"], 1))
    texts = [line.encode() for line in program.lines]
    times = table["time_end_s"] - table["time_start_s"]
    case = Case(rx, PROMPT, len(texts), baud)
    far = FarEnd(rx, case.byte_s, PROMPT, lambda k: texts[k], lambda k: float(times[k]), lambda k: bool(goes_on[k]))
    return in_memory(case, program.lines, far, hold_every_s=1e9).counts


@pytest.mark.parametrize("rx", [128, 254, 1024])
def test_program_posted_without_complaint_never_lets_the_planner_run_dry_on_a_pass(rx: int) -> None:
    cell = cell_with(takes_arcs=False)
    program, findings = posted(cell)
    assert not any("what the controller takes per second" in finding for finding in findings)
    counts = streamed(program, rx, cell.cnc.baud)
    assert counts.lines == len(program.lines) and counts.dry == 0 and counts.least_planned > 0


def test_pass_that_a_slow_link_does_not_carry_is_slowed_and_told_when_posting_and_then_never_runs_dry() -> None:
    cell = cell_with(takes_arcs=False, baud=SLOW_BAUD, max_blocks_per_s=1000.0)
    program, findings = posted(cell)
    assert any("what the controller takes per second" in finding for finding in findings), findings
    assert streamed(program, 1024, SLOW_BAUD).dry == 0
    fast, _ = posted(cell_with(takes_arcs=False))
    assert fast.table["time_end_s"][-1] < program.table["time_end_s"][-1]
    assert streamed(fast, 1024, SLOW_BAUD).dry > 0
