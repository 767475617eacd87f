"""Layers can be looked at while the rest of the part is still being planned."""

from __future__ import annotations

import asyncio
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from cellctl.planning.view import layer_file
from cellctl.store import parts
from cellctl.store.ids import new_id
from cellctl.store.parts import Inspection, PartRow

pytestmark = pytest.mark.timeout(700)
PLANNED_S = 600.0  # a worker that gives way to whatever else the machine does


@pytest.fixture
def tall_part(web: Any, tmp_path: Path) -> str:
    """A leaning part of many layers in the store, put there without a worker."""
    body = trimesh.creation.cylinder(9.0, 40.0, sections=48)
    vertices = np.asarray(body.vertices).copy()
    vertices[:, :2] *= 1.0 - 0.005 * (vertices[:, 2:] + 20.0)
    trimesh.Trimesh(vertices, body.faces).export(tmp_path / "tall.stl")
    data = (tmp_path / "tall.stl").read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    web.service.store.blobs.part(sha256, ".stl").write_bytes(data)
    inspection = Inspection("0" * 64, [[-9, -9, -20], [9, 9, 20]], len(body.faces), 8000.0, [])
    row = PartRow(new_id("part", 1.0), "tall", ".stl", "mm", sha256, len(data), 1.0, "me", inspection)
    with web.service.store.write() as rows:
        parts.add(rows, row)
    return row.id


async def test_layers_are_served_while_their_plan_is_being_made_and_gone_when_it_is_cancelled(
    web: Any, tall_part: str
) -> None:
    recipe = {"process": "hybrid", "layer_height_mm": 0.5}
    answer = await web.operator.post("/api/v1/jobs", json={"part_id": tall_part, "recipe": recipe})
    root = f"/api/v1/jobs/{answer.json()['id']}"
    async with asyncio.timeout(PLANNED_S):
        while not (job := (await web.viewer.get(root)).json())["layers"]:
            assert job["state"] in ("submitted", "planning"), job["error"]
            await asyncio.sleep(0.02)
    assert job["state"] == "planning" and 0 < job["layers"] < 80
    layer = (await web.viewer.get(f"{root}/plan/layers/0")).json()
    assert layer["index"] == 0 and layer["z_top"] == pytest.approx(0.5) and layer["operations"][0]["passes"]
    later = await web.viewer.get(f"{root}/plan/layers/79")
    assert later.status_code == 404 and "not planned yet" in later.json()["detail"]
    assert (await web.viewer.get(f"{root}/plan")).status_code == 404
    folder = web.service.queue.drawing(job["id"])
    assert folder is not None and (folder / layer_file(0)).is_file()
    await web.operator.post(f"{root}/cancel", json={})
    async with asyncio.timeout(PLANNED_S):
        while web.service.queue.drawing(job["id"]) is not None:
            await asyncio.sleep(0.02)
    assert (await web.viewer.get(f"{root}/plan/layers/0")).status_code == 404
    assert not folder.exists()
