"""Hostile requests, all refused: traversal, forged headers, replay, brute force, oversize, secrets that must not show."""

from __future__ import annotations

import asyncio
import time
from typing import Any

import argon2
import pytest

from cellctl import passwords
from cellctl.store.tokens import Role
from tests.unit.cellctl.hostile import PASSWORD, session_of, stand_still, user_in
from tests.unit.cellctl.hostile import cheap_hashes as cheap_hashes
from tests.unit.cellctl.test_api_sign_in import assert_problem

HOSTILE = [
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "'; DROP TABLE jobs; --",
    "{{7*7}}",
    "\u202egnp.exe",
    "a\x00b",
    "javascript:alert(1)",
]


@pytest.mark.parametrize(
    "path",
    [
        "/api/v1/parts/..%2f..%2fstore.db/mesh", "/api/v1/parts/%2e%2e%2f%2e%2e/mesh", "/api/v1/jobs/../../../etc/passwd",
        "/api/v1/jobs/..%5c..%5cstore.db/record", "/..%2f..%2f..%2fetc%2fpasswd", "/assets/%2e%2e/%2e%2e/api/app.py",
        "//etc/passwd", "/%00/etc/passwd", "/api/v1/materials/..%2f..%2fpyproject.toml",
    ],
)  # fmt: skip
async def test_path_that_climbs_leads_nowhere(web: Any, path: str) -> None:
    answer = await web.admin.get(path)
    assert answer.status_code in (404, 405, 422) and b"root:" not in answer.content and b"SQLite" not in answer.content


@pytest.mark.parametrize(
    "name", ["../../evil.stl", "..\\..\\evil.stl", "/etc/passwd.stl", "a/../../b.stl", "<script>alert(1)</script>.stl", "x" * 400 + ".stl"]
)
async def test_name_of_an_upload_is_no_path_and_no_markup(web: Any, block: Any, name: str) -> None:
    answer = await web.operator.post("/api/v1/parts", files={"file": (name, block.read_bytes())})
    assert answer.status_code == 201, answer.text
    told = answer.json()["name"]
    assert not set(told) & set("/\\<>\"'\0") and ".." not in told and len(told) <= 100
    folder = web.service.store.folder
    assert not [path for path in folder.parent.rglob("*evil*") if folder not in path.parents]


async def test_forged_forwarding_headers_are_not_believed(web: Any) -> None:
    forged = {
        "X-Forwarded-For": "1.2.3.4",
        "X-Real-IP": "1.2.3.4",
        "Forwarded": "for=1.2.3.4",
        "X-Forwarded-Host": "evil.example",
        "X-Forwarded-Proto": "https",
    }
    answer = await web.nobody.post("/api/v1/session", json={"token": web.secrets[Role.OPERATOR]}, headers=forged)
    assert "secure" not in answer.headers["set-cookie"].lower() and "evil" not in answer.text
    items = (await web.admin.get("/api/v1/audit", params={"verb": "sign in"})).json()["items"]
    assert items[0]["origin"] == "127.0.0.1"


@pytest.mark.parametrize(
    "headers",
    [{"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "http://127.0.0.1:8000.evil.example"}, {"Origin": "http://["},
     {"Sec-Fetch-Site": "cross-site"}, {"Sec-Fetch-Site": "same-site"}],
)  # fmt: skip
async def test_session_is_not_for_pages_of_others(web: Any, headers: dict[str, str]) -> None:
    cookie, csrf = await session_of(web, token=web.secrets[Role.OPERATOR])
    asked = {"Cookie": cookie, "X-CSRF-Token": csrf, **headers}
    assert_problem(await web.nobody.post("/api/v1/cell/hold", json={}, headers=asked), 401)
    assert_problem(await web.nobody.post("/api/v1/session", json={"token": web.secrets[Role.OPERATOR]}, headers=headers), 403)


async def test_change_without_the_word_of_its_own_session_is_refused(web: Any) -> None:
    cookie, csrf = await session_of(web, token=web.secrets[Role.OPERATOR])
    _, other = await session_of(web, token=web.secrets[Role.OPERATOR])
    for word in (None, "", other, csrf[:-1], csrf.upper(), "\xe9" * 64):
        headers = {"Cookie": cookie} | ({"X-CSRF-Token": word.encode("latin-1")} if word is not None else {})
        for method, path in (
            ("POST", "/api/v1/cell/hold"),
            ("POST", "/api/v1/jobs"),
            ("DELETE", "/api/v1/session"),
            ("POST", "/api/v1/session/password"),
        ):
            body = {} if method == "POST" else None
            assert (await web.nobody.request(method, path, json=body, headers=headers)).status_code == 403, (word, path)
    assert (await web.nobody.get("/api/v1/jobs", headers={"Cookie": cookie})).status_code == 200
    assert_problem(await web.nobody.post("/api/v1/cell/hold", json={}, headers={"Cookie": cookie, "X-CSRF-Token": csrf}), 503)


async def test_stop_is_not_refused_for_want_of_the_pages_word(web: Any) -> None:
    cookie, _ = await session_of(web, token=web.secrets[Role.OPERATOR])
    assert_problem(await web.nobody.post("/api/v1/cell/stop", json={}, headers={"Cookie": cookie}), 503)  # no cell process is there


async def test_cookie_of_a_session_that_was_left_opens_nothing(web: Any) -> None:
    cookie, csrf = await session_of(web, token=web.secrets[Role.ADMIN])
    page = {"Cookie": cookie, "X-CSRF-Token": csrf}
    assert (await web.nobody.delete("/api/v1/session", headers=page)).status_code == 204
    assert_problem(await web.nobody.get("/api/v1/jobs", headers=page), 401)
    assert_problem(await web.nobody.post("/api/v1/cell/hold", json={}, headers=page), 401)
    assert (await web.nobody.delete("/api/v1/session", headers=page)).status_code == 204


async def test_idempotency_key_of_another_person_gives_nothing_of_theirs(web: Any, uploaded: dict[str, Any]) -> None:
    key = {"Idempotency-Key": "same"}
    first = (await web.operator.post("/api/v1/jobs", json={"part_id": uploaded["id"], "name": "theirs"}, headers=key)).json()
    other = await web.engineer.post("/api/v1/jobs", json={"part_id": uploaded["id"], "name": "mine"}, headers=key)
    assert other.json()["id"] != first["id"] and other.json()["name"] == "mine"


async def test_many_guesses_at_once_are_as_many(web: Any) -> None:
    await user_in(web, "anna")
    stand_still(web)
    guesses = [web.nobody.post("/api/v1/session", json={"user": "anna", "password": f"guess number {k}"}) for k in range(15)]
    statuses = [answer.status_code for answer in await asyncio.gather(*guesses)]
    assert statuses.count(401) <= 4 and set(statuses) <= {401, 429, 503}


async def test_unknown_name_takes_as_long_as_a_wrong_password(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passwords, "HASHER", argon2.PasswordHasher(time_cost=1, memory_cost=8192, parallelism=1))
    passwords._nobody.cache_clear()
    kept = passwords.hashed(PASSWORD)

    def least(against: str | None) -> float:
        times = []
        for _ in range(7):
            begin = time.thread_time()
            assert not passwords.verified(against, "a wrong password")
            times.append(time.thread_time() - begin)
        return min(times)

    passwords.make_ready()
    assert least(None) == pytest.approx(least(kept), rel=0.5)


@pytest.mark.parametrize("text", HOSTILE)
async def test_hostile_text_comes_back_as_data_that_no_browser_takes_for_a_page(web: Any, uploaded: dict[str, Any], text: str) -> None:
    answer = await web.operator.post("/api/v1/jobs", json={"part_id": uploaded["id"], "name": text})
    shown = [
        answer,
        await web.viewer.get("/api/v1/jobs"),
        await web.operator.get(f"/api/v1/jobs/{text.replace('/', '%2F')[:60]}".replace("\x00", "%00")),
    ]
    for one in shown:
        assert one.status_code < 500, one.text
        assert one.headers["content-type"].startswith(("application/json", "application/problem+json"))
        assert one.headers["x-content-type-options"] == "nosniff" and "default-src 'none'" in one.headers["content-security-policy"]
