"""A long program is gone on with at a cost that grows as its lines do."""

from __future__ import annotations

import time

import planner
from config import load_cell
from planner.resume import ResumePoint
from planner.resume.rest import Modal, modal_before
from tests.bench.long_bead import long_bead

CELL = load_cell("trunnion_tcp")
LINES = 60_000
US_A_LINE = 40.0  # ten times what it takes


def test_rest_of_a_long_bead_is_its_second_half_and_costs_microseconds_a_line() -> None:
    program = long_bead(CELL, LINES)
    middle = len(program.lines) // 2
    planner.resume(long_bead(CELL, 100), CELL, ResumePoint.at(50, 0.5), program_sha256="0" * 64)  # what is loaded is loaded
    began = time.process_time()
    rest = planner.resume(program, CELL, ResumePoint.at(middle, 0.5), program_sha256="0" * 64)
    spent_s = time.process_time() - began
    note = rest.continues
    assert note is not None and note.resumed_line == middle + 1
    assert len(rest.lines) - note.head_lines == len(program.lines) - middle - 1
    assert rest.lines[-2].partition("N")[2].lstrip("0123456789") == program.lines[-2].partition("N")[2].lstrip("0123456789")
    assert 1e6 * spent_s / LINES < US_A_LINE


def test_modal_state_is_found_far_back_behind_lines_that_say_nothing_of_it() -> None:
    lines = ["N1G94G1X1F600", "N2 (G0 F1 in a comment)", *(f"N{k}X{k}.5Y2" for k in range(3, 5000))]
    assert modal_before(lines, len(lines)) == Modal(1, "94", "600")
