"""What the console draws comes from REST: by layer, kept by its hash, made anew where an earlier version left something else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.planning.container import unpack
from cellctl.planning.track import track_beside
from cellctl.planning.view import WHOLE
from config import load_cell
from tests.unit.cellctl.interrupted import Posted, interrupted_job, wall_in

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Posted:
    return wall_in(tmp_path_factory.mktemp("wall"), load_cell("trunnion_tcp"))


async def test_drawings_are_tagged_kept_by_hash_and_not_sent_twice(web: Any, wall: Posted) -> None:
    job = interrupted_job(web.service.store, wall, 3)
    root = f"/api/v1/jobs/{job}"
    sha256 = (await web.viewer.get(root)).json()["plan_sha256"]
    answer = await web.viewer.get(f"{root}/plan/layers/1/geometry", params={"of": sha256})
    header, arrays = unpack(answer.content)
    assert header["place"]["index"] == 1 and len(arrays["position"]) > 0
    assert "immutable" in answer.headers["cache-control"]
    assert "immutable" not in (await web.viewer.get(f"{root}/plan/layers/1/geometry")).headers["cache-control"]
    again = await web.viewer.get(f"{root}/plan/layers/1/geometry", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304 and not again.content
    assert (await web.viewer.get(f"{root}/plan/layers/9/geometry")).status_code == 404
    assert (await web.viewer.get(f"{root}/plan/layers/-1/geometry")).status_code == 404
    missing = await web.viewer.get(f"{root}/proof/surface")
    assert missing.status_code == 404 and "has no proof" in missing.json()["detail"]
    assert (await web.nobody.get(f"{root}/plan/geometry")).status_code == 401


async def test_view_and_track_that_are_missing_are_made_when_they_are_asked_for(web: Any, wall: Posted) -> None:
    job = interrupted_job(web.service.store, wall, 3)
    root = f"/api/v1/jobs/{job}"
    told = (await web.viewer.get(root)).json()
    blobs = web.service.store.blobs
    view, track = blobs.view(told["plan_sha256"]), track_beside(blobs.program(told["program_sha256"]))
    (view / WHOLE).unlink()
    (view / "layer_00000.json").write_text("{}")
    assert not Path(track).exists()
    header, arrays = unpack((await web.viewer.get(f"{root}/plan/geometry")).content)
    assert header["kind"] == "whole" and len(arrays["layers"]) == wall.layers + 1
    assert not (view / "layer_00000.json").exists()
    index = (await web.viewer.get(f"{root}/program/track")).json()
    assert index["lines"] == len(wall.posted.lines) and index["axes"] == list(wall.posted.axis_letters)
    chunk = (await web.viewer.get(f"{root}/program/track/{len(index['chunks']) - 1}")).content
    _, lines = unpack(chunk)
    assert np.abs(lines["tip"][-1] - wall.posted.table["tip_end"][-1]).max() < 1e-4
