"""Whatever makes something makes it once for each Idempotency-Key; whatever changes a job does not undo what its sender did not see."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cellctl.store import users
from cellctl.store.schema import idempotency
from tests.unit.cellctl.idle_planner import plan_at_once
from tests.unit.cellctl.test_store import part_in

KEY = {"Idempotency-Key": "the same"}
PASSWORD = "correct horse battery staple"


def of_material(name: str) -> dict[str, Any]:
    return {"name": name, "copy_of": "316L", "because": "a finer powder"}


@pytest.mark.parametrize(
    ("path", "body", "listed"),
    [
        ("cell/consumables", {"kind": "powder", "lot": "L1", "material": "316L"}, ("cell/consumables", "history")),
        ("users", {"name": "anna", "role": "viewer", "password": PASSWORD}, ("users", "items")),
        ("materials", of_material("own"), ("materials/own/versions", "items")),
    ],
)
async def test_same_key_makes_one_and_answers_the_same(web: Any, path: str, body: dict[str, Any], listed: tuple[str, str]) -> None:
    answers = [await web.admin.post(f"/api/v1/{path}", json=body, headers=KEY) for _ in range(2)]
    assert [answer.status_code for answer in answers] == [201, 201], answers[1].text
    assert answers[0].json() == answers[1].json()
    assert len((await web.admin.get(f"/api/v1/{listed[0]}")).json()[listed[1]]) == 1
    other = {**body, "name": "another"} if "name" in body else {**body, "lot": "L2"}
    assert (await web.admin.post(f"/api/v1/{path}", json=other, headers=KEY)).status_code == 422


@pytest.mark.parametrize(
    ("path", "body"),
    [("tokens", {"name": "a robot", "role": "viewer"}), ("webhooks", {"url": "https://shop.example/hook", "topics": ["job.completed"]})],
)
async def test_secret_is_told_once_and_kept_in_no_memory_of_answers(web: Any, path: str, body: dict[str, Any]) -> None:
    before = len((await web.admin.get(f"/api/v1/{path}")).json()["items"])
    first, second = [await web.admin.post(f"/api/v1/{path}", json=body, headers=KEY) for _ in range(2)]
    assert (first.status_code, second.status_code) == (201, 409)
    assert first.json()["id"] in second.json()["detail"] and first.json()["secret"] not in second.text
    assert len((await web.admin.get(f"/api/v1/{path}")).json()["items"]) == before + 1
    with web.service.store.read() as rows:
        kept = json.dumps([list(map(str, row)) for row in rows.execute(idempotency.select())])
    assert first.json()["id"] in kept and first.json()["secret"] not in kept


async def test_password_of_a_new_user_leaves_no_hash_in_the_memory_of_answers(web: Any) -> None:
    for password in (PASSWORD, PASSWORD + "!"):  # the digest of the request does not tell one password from another
        answer = await web.admin.post("/api/v1/users", json={"name": "anna", "role": "viewer", "password": password}, headers=KEY)
        assert answer.status_code == 201
    with web.service.store.read() as rows:
        assert [row.name for row in users.every(rows)] == ["anna"]


async def test_lot_of_a_material_of_the_shops_own_is_loaded_and_an_unknown_one_refused(web: Any) -> None:
    await web.admin.post("/api/v1/materials", json=of_material("own"))
    lot = {"kind": "powder", "lot": "L1", "material": "own"}
    assert (await web.operator.post("/api/v1/cell/consumables", json=lot)).status_code == 201
    refused = await web.operator.post("/api/v1/cell/consumables", json={**lot, "material": "../own"})
    assert refused.status_code == 422 and "own" in refused.json()["hint"]


async def test_change_of_a_job_that_somebody_else_changed_meanwhile_is_refused(web: Any) -> None:
    plan_at_once(web.service, 0)
    part_id = part_in(web.service.store)
    path = f"/api/v1/jobs/{(await web.operator.post('/api/v1/jobs', json={'part_id': part_id})).json()['id']}"
    seen = {"If-Match": (await web.viewer.get(path)).headers["etag"]}
    assert (await web.operator.patch(path, json={"name": "first"}, headers=seen)).status_code == 200
    for answer in (
        await web.engineer.patch(path, json={"name": "second"}, headers=seen),
        await web.engineer.post(f"{path}/cancel", json={}, headers=seen),
        await web.engineer.post(f"{path}/approve", json={"override_reason": "a trial"}, headers=seen),
    ):
        assert answer.status_code == 412 and answer.json()["title"] == "Changed meanwhile", answer.text
        newest = answer.headers["etag"]
    assert (await web.viewer.get(path)).json()["name"] == "first"
    assert newest == (await web.viewer.get(path)).headers["etag"]
    assert (await web.engineer.post(f"{path}/cancel", json={}, headers={"If-Match": newest})).status_code == 200
