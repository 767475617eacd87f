"""The proof's report over REST: who gets it, with which headers, and what is said when there is none."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest

from cellctl.domain.jobs import JobState
from cellctl.planning.jobwork import JobWork
from cellctl.store import jobs, parts
from cellctl.store.fleet import Seat
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.parts import Inspection, PartRow

PAGE = b"<!doctype html>\n<html><body>\xc2\xb1 0.2 mm</body></html>\n"
PROOF = "r" * 64


@pytest.fixture
def job_id(web: Any, block: Path) -> str:
    """A job with a proof, put there without a worker."""
    data = block.read_bytes()
    inspection = Inspection("0" * 64, [[-6, -4, -1], [6, 4, 1]], 12, 192.0, [])
    part = PartRow(new_id("part", 1.0), "block", ".stl", "mm", hashlib.sha256(data).hexdigest(), len(data), 1.0, "me", inspection)
    with web.service.store.write() as rows:
        parts.add(rows, part)
        row = JobRow(
            id=new_id("job", 2.0),
            name="block",
            part_id=part.id,
            cell=web.service.cell.name,
            recipe_toml="",
            material="316L",
            state=JobState.WAITING_FOR_APPROVAL,
            created_at=2.0,
            created_by="me",
        )
        jobs.add(rows, row)
        jobs.change(rows, row.id, proof_sha256=PROOF)
    return row.id


async def test_report_is_served_as_a_page_that_may_load_nothing_and_run_nothing(web: Any, job_id: str) -> None:
    web.service.store.blobs.report(PROOF).write_bytes(PAGE)
    answer = await web.viewer.get(f"/api/v1/jobs/{job_id}/proof/report")
    assert answer.status_code == 200 and answer.content == PAGE
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy and "img-src data:" in policy and "style-src 'unsafe-inline'" in policy
    assert "script" not in policy and "frame-ancestors 'none'" in policy
    assert answer.headers["x-content-type-options"] == "nosniff" and "content-disposition" not in answer.headers


async def test_proof_without_a_report_is_a_problem_and_nobody_reads_one_without_signing_in(web: Any, job_id: str) -> None:
    url = f"/api/v1/jobs/{job_id}/proof/report"
    answer = await web.viewer.get(url)
    assert answer.status_code == 404 and answer.headers["content-type"] == "application/problem+json"
    assert (await web.nobody.get(url)).status_code == 401


async def test_report_is_documented(web: Any) -> None:
    described = (await web.viewer.get("/openapi.json")).json()["paths"]["/api/v1/jobs/{job_id}/proof/report"]["get"]
    assert "text/html" in described["responses"]["200"]["content"]
    assert any("application/problem+json" in answer["content"] for answer in described["responses"].values())


async def test_what_a_proof_leaves_in_its_folder_is_kept_under_the_hash_of_its_figures(web: Any, tmp_path: Path) -> None:
    figures = b'{"passed": true, "findings": []}'
    (tmp_path / "proof.json").write_bytes(figures)
    (tmp_path / "proof.html").write_bytes(PAGE)
    work = JobWork(web.service.store, None, web.service.cell, tmp_path, Seat(web.service.cell.name))  # type: ignore[arg-type]
    kept = work._keep_proof(tmp_path, {"passed": True, "findings": []})
    assert kept.sha256 == hashlib.sha256(figures).hexdigest()
    assert web.service.store.blobs.report(kept.sha256).read_bytes() == PAGE and web.service.store.blobs.proof(kept.sha256).read_bytes() == figures
