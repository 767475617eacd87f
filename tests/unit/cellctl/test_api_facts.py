from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import httpx
import pytest
import tomli_w

from cellctl.api.app import build_service
from cellctl.planning.stages import recipe_of
from cellctl.planning.task import Task
from cellctl.planning.worker import use_material
from cellctl.store import jobs, parts, versions
from cellctl.store.parts import Inspection, PartRow
from config import base, find_facts, load_material
from planner.process import Settings

STEEL = "/api/v1/materials/316L"


def assert_problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    return problem


async def changed(web: Any, **deposition: Any) -> httpx.Response:
    """The next version of 316L, by an engineer who read the newest."""
    seen = await web.engineer.get(STEEL)
    facts = seen.json()["facts"]
    facts["deposition"] |= deposition
    body = {"facts": facts, "because": "single tracks of 12 May"}
    answer: httpx.Response = await web.engineer.put(STEEL, json=body, headers={"If-Match": seen.headers["etag"]})
    return answer


async def test_shipped_materials_are_the_first_versions_and_changes_are_added_to_them(web: Any) -> None:
    listed = (await web.viewer.get("/api/v1/materials")).json()["items"]
    assert [(item["name"], item["version"], item["shipped"]) for item in listed] == [(n, 1, True) for n in ("316L", "inconel718", "ti6al4v")]
    assert listed[0]["sha256"] == load_material("316L").sha256
    answer = await changed(web, overbuild=0.11)
    assert answer.status_code == 200
    second = answer.json()
    assert (second["version"], second["created_by"], second["because"]) == (2, "the engineer", "single tracks of 12 May")
    assert second["facts"]["deposition"]["overbuild"] == 0.11 and not second["shipped"]
    newest = await web.viewer.get(STEEL)
    assert newest.json() == second and newest.headers["etag"] == answer.headers["etag"]
    first = (await web.viewer.get(f"{STEEL}/versions/1")).json()
    assert first == listed[0], "a version never changes"
    page = (await web.viewer.get(f"{STEEL}/versions?limit=1")).json()
    rest = (await web.viewer.get(f"{STEEL}/versions", params={"cursor": page["next"]})).json()
    assert [item["version"] for item in page["items"] + rest["items"]] == [2, 1] and rest["next"] is None
    assert (await changed(web)).json()["version"] == 2, "the same facts are the same version"


async def test_who_changes_what_another_changed_meanwhile_is_told(web: Any) -> None:
    seen = await web.engineer.get(STEEL)
    body = {"facts": {**seen.json()["facts"], "density_g_mm3": 0.0078}, "because": "weighed"}
    assert "If-Match" in assert_problem(await web.engineer.put(STEEL, json=body), 428)["hint"]
    assert (await changed(web, overbuild=0.2)).status_code == 200
    assert "version 2" in assert_problem(await web.engineer.put(STEEL, json=body, headers={"If-Match": seen.headers["etag"]}), 412)["detail"]
    assert_problem(await web.operator.put(STEEL, json=body, headers={"If-Match": "*"}), 403)
    assert_problem(await web.engineer.put("/api/v1/materials/none", json=body, headers={"If-Match": "*"}), 404)


@pytest.mark.parametrize(
    ("place", "value", "error"),
    [
        (("deposition", "laser_w", "max"), -5.0, "deposition.laser_w.max: -5.0 W is out of bounds, it must be > 0 W"),
        (("deposition", "max_tilt_deg"), 95.0, "deposition.max_tilt_deg: 95.0 deg is out of bounds, it must be < 90 deg"),
        (("milling", "cutting_speed_m_min"), "fast", "milling.cutting_speed_m_min: Input should be a valid number"),
        (("deposition", "powder_g_min", "min"), 50.0, "deposition.powder_g_min: needs min <= usual <= max (has 50.0, 12.0, 20.0)"),
        (("thermal", "solidus_c"), 1400.0, "thermal.solidus_c: unknown key"),
    ],
)
async def test_fault_names_the_field_the_value_the_bound_and_the_unit(web: Any, place: tuple[str, ...], value: Any, error: str) -> None:
    facts = (await web.engineer.get(STEEL)).json()["facts"]
    inner = facts
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    answers = [
        await web.engineer.put(STEEL, json={"because": "x", **given}, headers={"If-Match": "*"})
        for given in ({"facts": facts}, {"toml": tomli_w.dumps(facts)})
    ]
    for answer in answers:
        problem = assert_problem(answer, 422)
        assert problem["detail"].startswith(error) and problem["errors"][0]["field"] in error
    assert (await web.viewer.get(STEEL)).json()["version"] == 1


async def test_own_material_is_made_once_from_its_facts_or_from_another(web: Any) -> None:
    body = {"name": "316L-fine", "copy_of": "316L", "because": "powder of 20 to 45 um"}
    first, second = [await web.engineer.post("/api/v1/materials", json=body, headers={"Idempotency-Key": "m"}) for _ in range(2)]
    assert first.status_code == second.status_code == 201 and first.json() == second.json()
    assert first.json()["facts"] == (await web.viewer.get(STEEL)).json()["facts"]
    assert_problem(await web.engineer.post("/api/v1/materials", json=body), 409)
    assert_problem(await web.engineer.post("/api/v1/materials", json={**body, "name": "../up"}), 422)
    assert_problem(await web.engineer.post("/api/v1/materials", json={**body, "name": "new", "copy_of": "none"}), 404)
    assert_problem(await web.engineer.post("/api/v1/materials", json={"name": "new", "because": "x"}), 422)
    assert_problem(await web.engineer.post("/api/v1/materials", json={**body, "name": "new", "toml": "a = ["}), 422)
    assert_problem(await web.operator.post("/api/v1/materials", json=body), 403)


async def test_job_is_made_with_the_version_that_was_newest_when_it_was_submitted(web: Any, tmp_path: Path) -> None:
    seen = Inspection("m" * 64, [[0.0] * 3, [1.0] * 3], 12, 1.0, [])
    with web.service.store.write() as rows:
        parts.add(rows, PartRow("part-1", "block", ".stl", "mm", "f" * 64, 1, 1.0, "me", seen))
    before = (await web.operator.post("/api/v1/jobs", json={"part_id": "part-1"})).json()
    second = (await changed(web, overbuild=0.11)).json()
    after = (await web.operator.post("/api/v1/jobs", json={"part_id": "part-1"})).json()
    assert before["material_sha256"] == load_material("316L").sha256 and after["material_sha256"] == second["sha256"]
    assert before["cell_sha256"] == after["cell_sha256"] == web.service.cell.sha256
    work = web.service.queue._work
    with web.service.store.read() as rows:
        old, new = jobs.get(rows, before["id"]), jobs.get(rows, after["id"])
    assert work._material(old) == {} and tomllib.loads(work._material(new)["material_toml"]) == second["facts"]
    assert work._pin(old) == "" and work._pin(new) == second["sha256"]
    assert "316L" in assert_problem(await web.operator.post("/api/v1/jobs", json={"part_id": "part-1", "recipe": {"material": "lead"}}), 422)["hint"]


def test_worker_plans_with_the_version_that_it_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(base, "PREFERRED", {})
    own = tomllib.loads(find_facts("materials", "316L").read_text(encoding="utf-8"))
    own["deposition"]["overbuild"] = 0.11
    task = Task("plan", str(tmp_path), 0, 0, recipe_toml='material = "316L"', material="316L", material_toml=tomli_w.dumps(own))
    use_material(task)
    assert Settings.from_recipe(recipe_of(task)).material.deposition.overbuild == 0.11


async def test_new_shipped_figures_follow_shipped_ones_but_never_the_shops_own(web: Any) -> None:
    store = web.service.store
    with store.write() as rows:
        versions.see_shipped(rows, "316L", "0" * 64, "x = 1", 2.0, "came with version 2")
        assert versions.material(rows, "316L").version == 2
        versions.add_material(rows, "316L", "1" * 64, "x = 2", "own", "me", 3.0)
        versions.see_shipped(rows, "316L", "2" * 64, "x = 3", 4.0, "came with version 3")
        assert versions.material(rows, "316L").version == 3


async def test_cell_is_shown_with_its_versions_and_changed_only_by_its_file(web: Any) -> None:
    name = web.service.cell.name
    cell = (await web.viewer.get(f"/api/v1/cells/{name}")).json()
    assert cell["running"] and cell["version"] == 1 and cell["sha256"] == web.service.cell.sha256
    assert (await web.viewer.get("/api/v1/cells")).json()["items"] == [cell]
    text = find_facts("cells", "trunnion_tcp").read_text(encoding="utf-8")
    refused = assert_problem(await web.engineer.put(f"/api/v1/cells/{name}", json={"toml": text}), 409)
    assert "running machine" in refused["detail"] and cell["file"] in refused["detail"]
    same = (await web.viewer.post(f"/api/v1/cells/{name}/check", json={"toml": text})).json()
    assert same["differences"] == [] and same["sha256"] == cell["sha256"]
    facts = tomllib.loads(text)
    other, wrong = (tomli_w.dumps({**facts, "limits": {**facts.get("limits", {}), "tick_s": tick_s}}) for tick_s in (0.02, -1.0))
    differences = (await web.viewer.post(f"/api/v1/cells/{name}/check", json={"toml": other})).json()["differences"]
    assert differences == [{"field": "limits.tick_s", "unit": "s", "running": 0.01, "given": 0.02}]
    answer = await web.viewer.post(f"/api/v1/cells/{name}/check", json={"toml": wrong})
    assert "limits.tick_s: -1.0 s is out of bounds" in assert_problem(answer, 422)["detail"]
    service = build_service(web.service.settings)
    service.store.close()
    again = (await web.viewer.get(f"/api/v1/cells/{name}")).json()
    assert (again["version"], again["starts"]) == (1, cell["starts"] + 1)
    with web.service.store.write() as rows:
        versions.see_cell(rows, name, "0" * 64, {"a": 1}, "cell.toml", 5.0)
    history = (await web.viewer.get(f"/api/v1/cells/{name}/versions")).json()["items"]
    assert [(item["version"], item["running"]) for item in history] == [(2, False), (1, True)]
    assert_problem(await web.viewer.get("/api/v1/cells/none"), 404)
