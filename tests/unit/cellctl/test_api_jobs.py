from __future__ import annotations

import asyncio
import hashlib
import io
import os
import signal
import zipfile
from pathlib import Path
from typing import Any

import httpx
import pytest
import tomli_w
from sqlalchemy import update

from cellctl.domain.jobs import JobState
from cellctl.planning import keys
from cellctl.store import audit, jobs, made, parts
from cellctl.store.ids import new_id
from cellctl.store.made import Made
from cellctl.store.parts import Inspection, PartRow
from cellctl.store.schema import jobs as job_table
from planner.recipe import Recipe

pytestmark = pytest.mark.timeout(700)
PLANNED_S = 600.0  # plan, post and proof by workers that give way to whatever else the machine does
START_S = 120.0  # until a worker is there, or gone
RECIPE = {"process": "deposit", "tolerance_mm": 0.5, "cusp_mm": 0.2}


def assert_problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert problem["title"] and problem["detail"] and "\n" not in problem["detail"]
    return problem


@pytest.fixture
def part_id(web: Any, block: Path) -> str:
    """A part in the store, put there without a worker."""
    data = block.read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    inspection = Inspection("0" * 64, [[-6, -4, -1], [6, 4, 1]], 12, 192.0, [])
    web.service.store.blobs.part(sha256, ".stl").write_bytes(data)
    row = PartRow(new_id("part", 1.0), "block", ".stl", "mm", sha256, len(data), 1.0, "me", inspection)
    with web.service.store.write() as rows:
        parts.add(rows, row)
    return row.id


async def ended(web: Any, job_id: str) -> dict[str, Any]:
    """The job once nobody works on it any more."""
    async with asyncio.timeout(PLANNED_S):
        while True:
            job: dict[str, Any] = (await web.viewer.get(f"/api/v1/jobs/{job_id}")).json()
            if job["state"] not in ("submitted", "planning", "planned", "posting", "proving", "proven"):
                return job
            await asyncio.sleep(0.05)


def set_job(web: Any, job_id: str, state: JobState, **columns: Any) -> None:
    with web.service.store.write() as rows:
        rows.execute(update(job_table).where(job_table.c.id == job_id).values(state=state.value))
        if columns:
            jobs.change(rows, job_id, **columns)


async def test_job_is_planned_posted_and_proved_and_shows_its_results(web: Any, part_id: str) -> None:
    answer = await web.operator.post("/api/v1/jobs", json={"part_id": part_id, "recipe": RECIPE, "name": "a block"})
    assert answer.status_code == 201 and answer.json()["state"] == "submitted"
    job = await ended(web, answer.json()["id"])
    assert job["state"] == "waiting_for_approval", job["error"]
    order = ["submitted", "planning", "planned", "posting", "proving", "proven", "waiting_for_approval"]
    assert sorted(job["timestamps"], key=lambda name: (job["timestamps"][name], order.index(name))) == order
    root = f"/api/v1/jobs/{job['id']}"
    plan = (await web.viewer.get(f"{root}/plan")).json()
    assert len(plan["layers"]) == job["layers"] > 0
    layer = (await web.viewer.get(f"{root}/plan/layers/0")).json()
    points = [value for operation in layer["operations"] for pass_ in operation["passes"] for value in pass_["points"]]
    assert layer["index"] == 0 and len(points) % 3 == 0 and max(map(abs, points)) < 60.0
    assert_problem(await web.viewer.get(f"{root}/plan/layers/{job['layers']}"), 404)
    program = (await web.viewer.get(f"{root}/program")).json()
    assert program["lines"] == job["lines_total"] and "program.json" in [file["name"] for file in program["files"]]
    archive = zipfile.ZipFile(io.BytesIO((await web.viewer.get(f"{root}/program?format=zip")).content))
    text = (await web.viewer.get(f"{root}/program/layer_0001.ngc")).text
    assert archive.read("layer_0001.ngc").decode() == text and text.splitlines()[0].startswith("N")
    assert_problem(await web.viewer.get(f"{root}/program/..%2f..%2fstore.db"), 404)
    assert (await web.viewer.get(f"{root}/proof")).json()["passed"] == job["proof"]["passed"]
    assert (await web.viewer.get(f"{root}/proof/picture")).content.startswith(b"\x89PNG")
    report = await web.viewer.get(f"{root}/proof/report")
    assert report.text.startswith("<!doctype html>") and job["proof"]["program_sha256"] in report.text
    record = (await web.viewer.get(f"{root}/record")).json()
    assert record["sha256"]["program"] == program["sha256"] and record["deeds"][0]["verb"] == "submit"
    page = await web.viewer.get(f"{root}/record?format=html")
    assert page.text.startswith("<!doctype html>") and "<script" not in page.text


async def test_what_was_made_before_is_not_made_again(web: Any, part_id: str) -> None:
    store, cell = web.service.store, web.service.cell
    with store.read() as rows:
        part = parts.get(rows, part_id)
    recipe_toml = tomli_w.dumps(Recipe(**RECIPE).model_dump(mode="json", exclude_none=True))
    keyed = {
        "plan": keys.plan_key(part.sha256, part.units, part.name, recipe_toml, ""),
        "program": keys.program_key("p" * 64, cell),
        "proof": keys.proof_key("q" * 64, part.sha256, part.units, cell),
    }
    summaries = {"plan": {"layers": 3}, "program": {"lines": 9, "duration_s": 1.0}, "proof": {"passed": True}}
    store.blobs.plan("p" * 64).write_bytes(b"plan")
    store.blobs.program("q" * 64).mkdir()
    store.blobs.proof("r" * 64).write_bytes(b"{}")
    with store.write() as rows:
        for kind, sha256 in (("plan", "p" * 64), ("program", "q" * 64), ("proof", "r" * 64)):
            made.add(rows, kind, keyed[kind], Made(sha256, summaries[kind]), 0.0)
    answer = await web.operator.post("/api/v1/jobs", json={"part_id": part_id, "recipe": RECIPE})
    job = await ended(web, answer.json()["id"])
    assert job["state"] == "waiting_for_approval" and job["proof"] == {"passed": True}
    assert (job["layers"], job["lines_total"], job["proof_sha256"]) == (3, 9, "r" * 64)


async def test_jobs_in_work_when_the_service_died_are_worked_on_again(web: Any, part_id: str) -> None:
    job_id = await cancelled_job(web, part_id)
    for state in (JobState.PLANNING, JobState.POSTING, JobState.PROVING):
        set_job(web, job_id, state)
        web.service.queue._resubmit()
        with web.service.store.read() as rows:
            assert jobs.get(rows, job_id).state is JobState.SUBMITTED
    web.service.queue.wake()
    await web.operator.post(f"/api/v1/jobs/{job_id}/cancel", json={})


async def test_worker_that_is_killed_fails_its_job_with_the_reason_and_no_other(web: Any, part_id: str) -> None:
    first, second = [
        (
            await web.operator.post("/api/v1/jobs", json={"part_id": part_id, "recipe": {**RECIPE, "cusp_mm": cusp}})
        ).json()["id"]
        for cusp in (0.2, 0.3)
    ]
    async with asyncio.timeout(START_S):
        while not (worker := children_of(os.getpid())):
            await asyncio.sleep(0.01)
    os.kill(worker[0], signal.SIGKILL)
    job = await ended(web, first)
    assert job["state"] == "failed" and "killed by signal SIGKILL" in job["error"]["detail"]
    assert (await web.operator.post(f"/api/v1/jobs/{second}/cancel", json={})).json()["state"] == "cancelled"


def children_of(pid: int) -> list[int]:
    """Worker processes of a process."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
            command = (stat.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if int(fields[1]) == pid and b"cellctl.planning.worker" in command:
            found.append(int(stat.parent.name))
    return found


async def test_cancelled_job_ends_its_worker(web: Any, part_id: str) -> None:
    job_id = (await web.operator.post("/api/v1/jobs", json={"part_id": part_id, "recipe": RECIPE})).json()["id"]
    async with asyncio.timeout(START_S):
        while not children_of(os.getpid()):
            await asyncio.sleep(0.01)
    for _ in range(2):
        answer = await web.operator.post(f"/api/v1/jobs/{job_id}/cancel", json={"because": "wrong part"})
        assert answer.json()["state"] == "cancelled" and answer.json()["why"] == "wrong part"
    async with asyncio.timeout(START_S):
        while children_of(os.getpid()):
            await asyncio.sleep(0.01)


BAD_RECIPES: list[tuple[dict[str, Any], str]] = [
    ({"recipe": {"tolerance": 0.1}}, "tolerance: unknown key"),
    ({"recipe": {"tolerance_mm": 0}}, "tolerance_mm"),
    ({"recipe": {"tolerance_mm": "NaN"}}, "tolerance_mm"),
    ({"recipe": {"process": "print"}}, "process"),
    ({"recipe": {"material": "unobtainium"}}, "unobtainium"),
    ({"recipe": {"material": "/etc/passwd"}}, "is not a name"),
    ({"recipe": {"material": "../cells/trunnion_tcp.toml"}}, "is not a name"),
    ({"recipe": {"stock": "/etc/passwd", "process": "mill"}}, "/etc/passwd"),
    ({"recipe_toml": "tolerance_mm = "}, "not TOML"),
    ({"recipe_toml": "x = 1", "recipe": {}}, "both given"),
    ({"cell": "another"}, "another"),
]


@pytest.mark.parametrize(("body", "word"), BAD_RECIPES)
async def test_recipe_that_cannot_be_used_is_refused_by_field(
    web: Any, part_id: str, body: dict[str, Any], word: str
) -> None:
    answer = await web.operator.post("/api/v1/jobs", json={"part_id": part_id, **body})
    problem = assert_problem(answer, 404 if word == "/etc/passwd" else 422)
    assert word in problem["detail"]
    assert (await web.viewer.get("/api/v1/jobs")).json()["items"] == []


async def test_key_submits_once(web: Any, part_id: str) -> None:
    body = {"part_id": part_id, "recipe": RECIPE}
    headers = {"Idempotency-Key": "once"}
    answers = await asyncio.gather(*(web.operator.post("/api/v1/jobs", json=body, headers=headers) for _ in range(3)))
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert_problem(await web.operator.post("/api/v1/jobs", json={**body, "name": "other"}, headers=headers), 422)
    await web.operator.post(f"/api/v1/jobs/{answers[0].json()['id']}/cancel", json={})


async def cancelled_job(web: Any, part_id: str) -> str:
    job_id = str((await web.operator.post("/api/v1/jobs", json={"part_id": part_id, "recipe": RECIPE})).json()["id"])
    await web.operator.post(f"/api/v1/jobs/{job_id}/cancel", json={})
    return job_id


async def test_job_is_approved_only_in_its_state_and_with_a_proof_that_passed(web: Any, part_id: str) -> None:
    job_id = await cancelled_job(web, part_id)
    url = f"/api/v1/jobs/{job_id}/approve"
    assert_problem(await web.operator.post(url, json={}), 409)
    set_job(web, job_id, JobState.WAITING_FOR_APPROVAL, proof={"passed": False})
    assert "did not pass" in assert_problem(await web.operator.post(url, json={}), 409)["detail"]
    assert_problem(await web.operator.post(url, json={"override_reason": "I want it"}), 403)
    assert_problem(await web.engineer.post(url, json={"override_reason": "  "}), 409)
    approved = (await web.engineer.post(url, json={"override_reason": "trial piece"})).json()
    assert approved["state"] == "queued" and approved["override_reason"] == "trial piece" and "table" in approved["why"]
    confirmed = (await web.operator.post(url, json={"table_clear": True})).json()
    assert confirmed["table_clear"] and confirmed["approved_by"] == "the engineer"
    record = (await web.viewer.get(f"/api/v1/jobs/{job_id}/record")).json()
    assert [(deed["who"], deed["because"]) for deed in record["deeds"] if deed["verb"] == "approve"] == [
        ("the engineer", "trial piece"),
        ("the operator", ""),
    ]


async def test_job_on_the_cell_is_not_cancelled_but_aborted(web: Any, part_id: str) -> None:
    job_id = await cancelled_job(web, part_id)
    set_job(web, job_id, JobState.RUNNING)
    assert "abort" in assert_problem(await web.operator.post(f"/api/v1/jobs/{job_id}/cancel", json={}), 409)["hint"]


async def test_results_that_are_not_there_are_problems(web: Any, part_id: str) -> None:
    job_id = await cancelled_job(web, part_id)
    for name in ("plan", "plan/layers/0", "plan/file", "program", "program/layer_0001.ngc", "proof", "proof/picture", "proof/report"):
        assert_problem(await web.viewer.get(f"/api/v1/jobs/{job_id}/{name}"), 404)
        assert_problem(await web.viewer.get(f"/api/v1/jobs/job-none/{name}"), 404)
    assert_problem(await web.viewer.get("/api/v1/jobs/job-none/record"), 404)


async def test_commands_without_a_cell_process_say_so_and_are_written_down(web: Any) -> None:
    for verb in ("hold", "resume", "abort", "reset", "home", "stop"):
        assert (
            "restarted by itself"
            in assert_problem(await web.operator.post(f"/api/v1/cell/{verb}", json={"because": "test"}), 503)["hint"]
        )
    assert_problem(await web.operator.post("/api/v1/cell/jog", json={"axis": "X"}), 422)
    assert_problem(await web.operator.post("/api/v1/cell/hold", json={"axis": "X"}), 422)
    assert_problem(await web.operator.post("/api/v1/cell/start", json={}), 422)
    assert_problem(await web.operator.post("/api/v1/cell/dance", json={}), 422)
    assert_problem(await web.viewer.get("/api/v1/cell"), 503)
    with web.service.store.read() as rows:
        deeds = audit.of_target(rows, "trunnion-tcp")
    assert [deed["verb"] for deed in deeds][:6] == ["hold", "resume", "abort", "reset", "home", "stop"]
    assert all(deed["outcome"].startswith(("no answer", "refused")) for deed in deeds)
