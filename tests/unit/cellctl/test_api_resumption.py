from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellctl.cell.ipc import IpcServer
from cellctl.domain.jobs import JobState
from cellctl.domain.messages import Command, Reply
from cellctl.store import jobs
from config import load_cell
from planner.files import read_program
from tests.unit.cellctl.interrupted import Posted, bead_of, interrupted_job, ran, wall_in
from tests.unit.cellctl.test_api_jobs import START_S, assert_problem, ended, set_job

pytestmark = pytest.mark.timeout(700)


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Posted:
    return wall_in(tmp_path_factory.mktemp("wall"), load_cell("trunnion_tcp"))


@pytest.fixture
def broken(web: Any, wall: Posted) -> str:
    """A job that was interrupted in the middle of its first bead."""
    return interrupted_job(web.service.store, wall, bead_of(wall.posted))


async def test_where_metal_ended_is_told_with_layer_operation_pass_and_arc(
    web: Any, wall: Posted, broken: str
) -> None:
    program = wall.posted
    line = bead_of(program)
    point = (await web.viewer.get(f"/api/v1/jobs/{broken}/resumption-point")).json()
    end, row = point["metal_end"], program.table[line]
    assert point["possible"] and not point["why_not"] and not point["notes"]
    assert (end["line"], end["fraction"]) == (line, 0.5)
    assert (end["layer"], end["operation"], end["pass"]) == (row["layer"], row["operation"], row["pass_"])
    assert end["arc_mm"] == pytest.approx((row["arc_start_mm"] + row["arc_end_mm"]) / 2, abs=1e-3)
    assert end["tip_mm"] == pytest.approx((program.table["tip_end"][line - 1] + row["tip_end"]) / 2, abs=1e-3)
    assert end["known_by"] == "tick" and "layer 1 of 2, deposit contour" in end["text"] and f"N{line + 1}" in end["text"]
    assert [choice["layer"] for choice in point["choices"]] == sorted({int(layer) for layer in program.table["layer"] if layer >= 0})


async def test_interrupted_job_is_gone_on_with_by_a_proven_program_that_waits_for_approval(
    web: Any, wall: Posted, broken: str
) -> None:
    url = f"/api/v1/jobs/{broken}/resume"
    body = {"because": "power came back", "overlap_mm": 1.5}
    answers = [await web.operator.post(url, json=body, headers={"Idempotency-Key": "once"}) for _ in range(2)]
    assert {answer.status_code for answer in answers} == {202} and len({answer.json()["id"] for answer in answers}) == 1
    assert "goes on with it already" in assert_problem(await web.operator.post(url, json=body), 409)["detail"]
    job = await ended(web, answers[0].json()["id"])
    assert job["state"] == "waiting_for_approval" and job["continues_job"] == broken, job["error"]
    assert "planning" not in job["timestamps"] and job["proof"]["findings"] == {}, job["proof"]
    figures, first = job["resumption"], wall.posted
    assert figures["overlap_mm"] == pytest.approx(1.5) and figures["lead_in_mm"] > 0.0 and figures["extra_s"] > 0.0
    head = (await web.viewer.get(f"/api/v1/jobs/{job['id']}/program/head")).json()
    assert head["head_lines"] == figures["head_lines"] and "(resumes " in head["lines"][0]
    rest = read_program(web.service.store.blobs.program(job["program_sha256"]))
    assert list(rest.lines[: len(head["lines"])]) == head["lines"]
    assert figures["remaining_lines"] == len(first.lines) - figures["resumed_line"] + 1
    assert (await web.viewer.get(f"/api/v1/jobs/{job['id']}/proof/report")).text.startswith("<!doctype html>")
    beads_mm = sum(float(first.table["arc_end_mm"][k] - first.table["arc_start_mm"][k]) for k in (bead_of(first), bead_of(first, 1)))
    section_mm2 = job["proof"]["deposited_mm3"] / (beads_mm + 1.5)  # what stood is counted, and the overlap once more
    assert 1.0 < section_mm2 < 3.0


async def test_it_is_the_part_that_a_person_vouches_for_and_motion_takes_that_back(web: Any, tmp_path: Path, broken: str) -> None:
    with web.service.store.write() as rows:
        first = jobs.get(rows, broken)
        fields = {"id": "job-rest", "state": JobState.WAITING_FOR_APPROVAL, "continues_job": broken, "proof": {"passed": True}}
        jobs.add(rows, replace(first, **fields))
    url, start = "/api/v1/jobs/job-rest/approve", {"job": "job-rest", "because": "now"}
    assert "must not be clear" in assert_problem(await web.operator.post(url, json={"table_clear": True}), 409)["detail"]
    approved = (await web.operator.post(url, json={"because": "looks good"})).json()
    assert approved["state"] == "queued" and "part stands untouched" in approved["why"]
    refused = assert_problem(await web.operator.post("/api/v1/cell/start", json=start), 409)
    assert "nobody confirmed that the part" in refused["detail"] and "part_untouched" in refused["hint"]
    asked: list[Command] = []

    async def refuse(command: Command) -> Reply:
        asked.append(command)
        return Reply(command.id, False, "the machine moved after the part was found untouched", "look again", kind="table")

    cell = IpcServer(refuse, "a cell whose machine has moved")
    await cell.start(tmp_path / "run" / "cell.sock")
    try:
        async with asyncio.timeout(START_S):
            while not web.service.link.is_connected:
                await asyncio.sleep(0.01)
        answer = await web.operator.post("/api/v1/cell/start", json={**start, "part_untouched": True})
        assert "machine moved" in assert_problem(answer, 409)["detail"]
        assert [command.args["continues"] for command in asked] == [broken]
        job = (await web.viewer.get("/api/v1/jobs/job-rest")).json()
        assert not job["table_clear"] and "confirms again that the part stands untouched" in job["why"]
        ran(web.service.store, "job-other", "f" * 64, "completed", 9, 0.0, 9, name="flange")
        answer = await web.operator.post("/api/v1/cell/start", json={**start, "part_untouched": True})
        assert "flange (job-other) was completed since" in assert_problem(answer, 409)["detail"] and len(asked) == 1
    finally:
        await cell.close()


async def test_chosen_layer_that_the_plan_has_not_is_refused_by_name(web: Any, broken: str) -> None:
    url = f"/api/v1/jobs/{broken}/resume"
    problem = assert_problem(await web.operator.post(url, json={"from": "layer", "layer": 99}), 422)
    assert "layer 99" in problem["detail"] and "there are 0 to 1" in problem["hint"]
    assert_problem(await web.operator.post(url, json={"from": "layer"}), 422)
    assert_problem(await web.operator.post(url, json={"layer": 0}), 422)
    assert_problem(await web.operator.post(url, json={"from": "metal_end", "overlap_mm": -1}), 422)
    assert (await web.viewer.post(url, json={})).status_code == 403


async def test_part_that_was_taken_off_for_another_job_is_not_gone_on_with(web: Any, broken: str) -> None:
    ran(web.service.store, "job-other", "f" * 64, "aborted", 3, 0.0, 9, name="bracket")
    point = (await web.viewer.get(f"/api/v1/jobs/{broken}/resumption-point")).json()
    assert point["possible"] and "bracket (job-other) was on the cell since (aborted)" in point["notes"][0]
    ran(web.service.store, "job-third", "f" * 64, "completed", 9, 0.0, 9, name="flange")
    problem = assert_problem(await web.operator.post(f"/api/v1/jobs/{broken}/resume", json={}), 409)
    assert "flange (job-third) was completed since" in problem["detail"]


async def test_job_that_never_ran_or_is_done_is_not_gone_on_with(web: Any, broken: str) -> None:
    for state, word in ((JobState.COMPLETED, "is completed"), (JobState.QUEUED, "is queued")):
        set_job(web, broken, state)
        assert word in assert_problem(await web.operator.post(f"/api/v1/jobs/{broken}/resume", json={}), 409)["detail"]
    assert_problem(await web.operator.post("/api/v1/jobs/job-none/resume", json={}), 404)
