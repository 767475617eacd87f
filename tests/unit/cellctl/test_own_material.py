"""A version of a material of the shop's own is what estimates, plans, programs and proofs are made with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.unit.cellctl.test_api_jobs import ended, part_id

__all__ = ["part_id"]

pytestmark = pytest.mark.timeout(900)
OWN_LASER_MAX_W = 1777.0  # of the shipped material 2000 W
HEIGHT_MM = 2.0  # of the block
LAYER_MM = 0.5  # the thickest that the own powder fills; of the shipped material 1 mm
RECIPE = {"process": "deposit", "tolerance_mm": 0.5, "cusp_mm": 0.5}


async def made_thinner(web: Any) -> str:
    """A material `own`, its second version with thinner layers; the hash of that version."""
    path = "/api/v1/materials/own"
    first = await web.engineer.post("/api/v1/materials", json={"name": "own", "copy_of": "316L", "because": "a finer powder"})
    facts = first.json()["facts"]
    facts["deposition"]["layer_height_mm"] = {"min": 0.3, "usual": LAYER_MM, "max": LAYER_MM}
    facts["deposition"]["laser_w"]["max"] = OWN_LASER_MAX_W
    etag = (await web.viewer.get(path)).headers["etag"]
    answer = await web.engineer.put(path, json={"facts": facts, "because": "measured"}, headers={"If-Match": etag})
    assert answer.status_code == 200 and answer.json()["version"] == 2, answer.text
    return str(answer.json()["sha256"])


async def test_job_is_estimated_planned_and_proved_with_the_version_of_its_material(web: Any, part_id: str, block: Path) -> None:
    sha256 = await made_thinner(web)
    web.service.store.blobs.mesh("0" * 64).write_bytes(block.read_bytes())
    layers = {}
    for material in ("316L", "own"):
        told = await web.viewer.post(f"/api/v1/parts/{part_id}/estimate", json={"recipe": {**RECIPE, "material": material}}, timeout=120)
        assert told.status_code == 200, told.text
        layers[material] = told.json()["layers"]
    assert layers["316L"] < HEIGHT_MM / LAYER_MM <= layers["own"]

    submitted = await web.operator.post("/api/v1/jobs", json={"part_id": part_id, "recipe": {**RECIPE, "material": "own"}})
    assert submitted.status_code == 201 and submitted.json()["material_sha256"] == sha256
    job = await ended(web, submitted.json()["id"])
    assert job["state"] == "waiting_for_approval", job["error"]
    assert job["layers"] >= HEIGHT_MM / LAYER_MM and job["material_sha256"] == sha256
    proof = (await web.viewer.get(f"/api/v1/jobs/{job['id']}/proof")).json()
    assert proof["passed"] == job["proof"]["passed"]
    window = (await web.viewer.get(f"/api/v1/jobs/{job['id']}/program/program.json")).json()["window"]
    assert window["material_sha256"] == sha256 and window["laser_w"] == [600.0, OWN_LASER_MAX_W]
