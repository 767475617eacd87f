"""From where a person chooses, over the service and its workers: the begin of a layer or of an operation, and a cut that was broken off."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from config import load_cell
from planner.files import read_program
from planner.post.reread import read
from planner.program import LineKind, Program
from tests.unit.cellctl.interrupted import Posted, bead_of, box_in, interrupted_job, wall_in
from tests.unit.cellctl.test_api_jobs import ended

pytestmark = pytest.mark.timeout(700)


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Posted:
    return wall_in(tmp_path_factory.mktemp("wall"), load_cell("trunnion_tcp"))


@pytest.fixture(scope="module")
def milled(tmp_path_factory: pytest.TempPathFactory) -> Posted:
    recipe = {"process": "hybrid", "tolerance_mm": 0.5}
    return box_in(tmp_path_factory.mktemp("milled"), load_cell("trunnion_tcp"), (8.0, 4.0, 0.8), recipe)


async def gone_on(web: Any, job: str, **asked: Any) -> tuple[dict[str, Any], Program]:
    """The job that goes on with another one, when it waits for a person, and its program."""
    answer = await web.operator.post(f"/api/v1/jobs/{job}/resume", json={"because": "chosen", **asked})
    assert answer.status_code == 202, answer.text
    found = await ended(web, answer.json()["id"])
    assert found["state"] == "waiting_for_approval", found["error"]
    return found, read_program(web.service.store.blobs.program(found["program_sha256"]))


@pytest.mark.parametrize("choice", ["layer", "operation"])
async def test_chosen_layer_or_operation_is_made_anew_from_its_begin_and_proven(web: Any, wall: Posted, choice: str) -> None:
    program = wall.posted
    table = program.table
    broken = interrupted_job(web.service.store, wall, bead_of(program, 1))
    number = int(table[choice][bead_of(program, 1)])
    job, rest = await gone_on(web, broken, **{"from": choice, choice: number})
    figures, note = job["resumption"], rest.continues
    assert note is not None and note.overlap_mm == 0.0 and figures[choice] == number and figures["layer"] == 1
    passes = rest.table[note.head_lines :]
    first = passes[(passes["kind"] == LineKind.PROCESS) & (passes["pass_"] >= 0)][0]
    assert first[choice] == number and first["arc_start_mm"] == 0.0
    whole = table[(table["kind"] == LineKind.PROCESS) & (table[choice] == number)]
    again = passes[(passes["kind"] == LineKind.PROCESS) & (passes[choice] == number)]
    assert np.allclose(again["tip_end"], whole["tip_end"], atol=1e-6)
    assert job["proof"]["findings"] == {}, job["proof"]


async def test_cut_that_was_broken_off_goes_on_with_its_tool_and_its_proof_passes_on_the_stock_as_it_stands(web: Any, milled: Posted) -> None:
    program = milled.posted
    reading = read(program)
    cuts = np.flatnonzero((program.table["kind"] == LineKind.PROCESS) & reading.is_motion & (reading.tool == 2))
    line = int(cuts[len(cuts) // 2])
    broken = interrupted_job(web.service.store, milled, line)
    job, rest = await gone_on(web, broken)
    note, after = rest.continues, read(rest)
    assert note is not None and note.operation == program.table["operation"][line]
    moves = np.flatnonzero((rest.table["kind"] == LineKind.PROCESS) & after.is_motion)
    assert (after.tool[moves] != 1).all() and not after.gate.any()
    assert (after.spindle_rpm[moves] > 0.0).all()
    assert job["proof"]["passed"] and job["proof"]["findings"] == {}, job["proof"]
