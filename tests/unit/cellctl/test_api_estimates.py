"""What the engineer sees before a plan is made: figures that move with the recipe, told errors, small pictures, the recipe's schema."""

from __future__ import annotations

import asyncio
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from config import load_material
from planner.recipe import Recipe
from tests.unit.cellctl.test_api_parts import assert_problem, upload

SIZE = (12.0, 8.0, 2.0)


@pytest.fixture
def part(uploaded: dict[str, Any]) -> str:
    """A block of 12 x 8 x 2 mm."""
    return str(uploaded["id"])


async def estimate(web: Any, part: str, **recipe: Any) -> Any:
    return await web.viewer.post(f"/api/v1/parts/{part}/estimate", json={"recipe": recipe}, timeout=60)


async def test_estimate_of_a_block_keeps_to_its_volume_and_moves_with_the_recipe(web: Any, part: str) -> None:
    coarse = (await estimate(web, part, layer_height_mm=1.0)).json()
    fine = (await estimate(web, part, layer_height_mm=0.5)).json()
    assert coarse["layers"] == 2 and fine["layers"] == 4
    assert fine["build_time_s"] > coarse["build_time_s"] == pytest.approx(sum(coarse["times_s"].values()))
    density = load_material("316L").density_g_mm3
    assert coarse["mass_g"] == pytest.approx(np.prod(SIZE) * density, rel=1e-6)
    assert coarse["powder_g"] > coarse["deposited_mm3"] * density > coarse["mass_g"]  # powder that misses the pool, metal that is milled
    low, high = coarse["time_range_s"]
    assert low < coarse["build_time_s"] < high and coarse["uncertainty"] > 0.0

    deposited = (await estimate(web, part, layer_height_mm=1.0, process="deposit")).json()
    assert deposited["times_s"]["mill"] == deposited["times_s"]["changes"] == deposited["milled_mm3"] == 0.0


async def test_cost_is_not_invented_where_no_rate_is_stated(web: Any, part: str) -> None:
    told = (await estimate(web, part)).json()
    assert told["cost"] is None
    fields = {(missing["file"], missing["field"]) for missing in told["missing"]}
    assert fields == {("cell", "rates.machine_per_h"), ("cell", "rates.gas_per_m3"), ("material", "price.per_kg")}


async def test_recipe_out_of_bounds_is_refused_with_field_value_bound_and_unit(web: Any, part: str) -> None:
    detail = assert_problem(await estimate(web, part, tolerance_mm=7.0), 422)["detail"]
    assert "tolerance_mm" in detail and "7" in detail and "5" in detail
    detail = assert_problem(await estimate(web, part, layer_height_mm=3.0), 422)["detail"]
    assert all(word in detail for word in ("layer_height_mm", "3", "0.3", "1", "mm"))
    assert_problem(await estimate(web, part, colour="red"), 422)
    assert_problem(await estimate(web, part, material="../316L"), 422)
    assert_problem(await estimate(web, "part-none"), 404)
    assert_problem(await web.nobody.post(f"/api/v1/parts/{part}/estimate", json={}), 401)


async def test_of_estimates_that_wait_only_the_newest_is_answered(web: Any, part: str) -> None:
    answers = await asyncio.gather(*(estimate(web, part, tolerance_mm=0.1 + 0.01 * k) for k in range(5)))
    codes = [answer.status_code for answer in answers]
    assert codes[-1] == 200 and set(codes[:-1]) <= {200, 409} and codes.count(409) >= 3


async def test_process_behind_previews_that_dies_is_started_anew(web: Any, part: str) -> None:
    assert (await estimate(web, part)).status_code == 200
    process = web.service.previews._process
    process.kill()
    await process.wait()
    assert (await estimate(web, part)).status_code == 200
    assert web.service.previews._process.pid != process.pid


async def test_small_picture_shows_the_part_and_is_made_once(web: Any, part: str) -> None:
    answer = await web.viewer.get(f"/api/v1/parts/{part}/thumbnail", timeout=60)
    assert answer.status_code == 200 and answer.headers["content-type"] == "image/png"
    picture = np.asarray(Image.open(io.BytesIO(answer.content)))
    assert picture.shape == (180, 240, 4)
    alpha = picture[..., 3]
    assert alpha[90, 120] == 255 and alpha[0].max() == alpha[-1].max() == 0  # the part in the middle, clear ground round it
    assert 0.2 < (alpha > 0).mean() < 0.8
    held = next(Path(web.service.settings.store, "blobs", "parts").glob("*.png"))
    made_at = held.stat().st_mtime_ns
    assert (await web.viewer.get(f"/api/v1/parts/{part}/thumbnail")).content == answer.content
    assert held.stat().st_mtime_ns == made_at


async def test_recipe_schema_is_that_of_the_planner(web: Any) -> None:
    schema = (await web.viewer.get("/api/v1/recipe/schema")).json()
    assert set(schema["properties"]) == set(Recipe.model_fields)
    assert schema["properties"]["tolerance_mm"]["maximum"] == 5.0


async def test_part_milled_from_a_block_is_not_estimated(web: Any) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
    part = (await upload(web.operator, bytes(sphere.export(file_type="stl")))).json()["id"]
    answer = await estimate(web, part, process="mill")
    assert "process = mill" in assert_problem(answer, 422)["detail"]
