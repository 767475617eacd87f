from __future__ import annotations

from typing import Any

import httpx
import pytest

from cellctl.api.page import Page, inline_script_hashes
from cellctl.store.tokens import Role


def assert_problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert problem["status"] == status and problem["title"] and "\n" not in problem["detail"]
    return problem


ROUTES = [
    "/api/v1/parts",
    "/api/v1/jobs",
    "/api/v1/cell",
    "/api/v1/cell/events",
    "/api/v1/materials",
    "/api/v1/tokens",
    "/api/v1/session",
]


@pytest.mark.parametrize("path", ROUTES)
async def test_without_a_token_nothing_is_told(web: Any, path: str) -> None:
    answer = await web.nobody.get(path)
    assert_problem(answer, 401)
    assert answer.headers["www-authenticate"] == "Bearer"


@pytest.mark.parametrize("header", ["Bearer ", "Bearer nonsense", "Basic YTpi", "Bearer cell_", "bearer"])
async def test_wrong_credentials_are_refused(web: Any, header: str) -> None:
    assert_problem(await web.nobody.get("/api/v1/jobs", headers={"Authorization": header}), 401)


async def test_each_role_may_do_its_own_and_no_more(web: Any) -> None:
    body = {"part_id": "part-x"}
    assert_problem(await web.viewer.post("/api/v1/jobs", json=body), 403)
    assert_problem(await web.viewer.post("/api/v1/cell/stop", json={}), 403)
    assert_problem(await web.operator.post("/api/v1/jobs", json=body), 404)
    assert_problem(await web.engineer.get("/api/v1/tokens"), 403)
    assert (await web.admin.get("/api/v1/tokens")).status_code == 200


async def test_session_cookie_signs_in_until_signed_out(web: Any) -> None:
    browser = web.nobody
    answer = await browser.post("/api/v1/session", json={"token": web.secrets[Role.OPERATOR]})
    assert answer.json()["role"] == "operator" and answer.json()["stop_url"] == "http://127.0.0.1:8001/stop"
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "samesite=strict" in cookie.lower()
    assert (await browser.get("/api/v1/session")).json()["name"] == "the operator"
    page = {"X-CSRF-Token": answer.json()["csrf"]}
    assert (await browser.delete("/api/v1/session", headers=page)).status_code == 204
    assert_problem(await browser.get("/api/v1/session"), 401)


async def test_cookie_does_not_count_for_a_page_of_another_origin(web: Any) -> None:
    browser = web.nobody
    session = (await browser.post("/api/v1/session", json={"token": web.secrets[Role.OPERATOR]})).json()
    for origin in ("http://evil.example", "http://127.0.0.1:9999", "null"):
        assert_problem(await browser.post("/api/v1/cell/stop", json={}, headers={"Origin": origin}), 401)
    same = await browser.post("/api/v1/cell/hold", json={}, headers={"Origin": "http://127.0.0.1:8000", "X-CSRF-Token": session["csrf"]})
    assert_problem(same, 503)  # let in; no cell process is there


@pytest.mark.parametrize("origin", ["http://[", "null", "http://evil.example"])
async def test_origin_that_is_not_ours_opens_no_session(web: Any, origin: str) -> None:
    answer = await web.nobody.post("/api/v1/session", json={"token": "x"}, headers={"Origin": origin})
    assert_problem(answer, 403)


async def test_wrong_token_opens_no_session(web: Any) -> None:
    answer = await web.nobody.post("/api/v1/session", json={"token": "cell_wrong"})
    assert_problem(answer, 401)
    assert "set-cookie" not in answer.headers


async def test_revoked_token_is_refused_at_once(web: Any) -> None:
    made = (await web.admin.post("/api/v1/tokens", json={"name": "guest", "role": "viewer"})).json()
    headers = {"Authorization": f"Bearer {made['secret']}"}
    assert (await web.nobody.get("/api/v1/jobs", headers=headers)).status_code == 200
    assert (await web.admin.delete(f"/api/v1/tokens/{made['id']}")).json()["revoked_at"]
    assert_problem(await web.nobody.get("/api/v1/jobs", headers=headers), 401)
    listed = (await web.admin.get("/api/v1/tokens")).text
    assert made["secret"] not in listed


async def test_name_that_is_not_ours_is_not_answered(web: Any) -> None:
    for host in ("evil.example", "127.0.0.1.evil.example:8000", ""):
        assert_problem(await web.operator.get("/api/v1/jobs", headers={"Host": host}), 421)
    assert (await web.operator.get("/api/v1/jobs", headers={"Host": "localhost:8000"})).status_code == 200


async def test_every_answer_carries_a_strict_policy(web: Any) -> None:
    for answer in (
        await web.nobody.get("/healthz"),
        await web.nobody.get("/nothing"),
        await web.operator.get("/api/v1/jobs"),
    ):
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy and "frame-ancestors 'none'" in policy
        assert "http://127.0.0.1:8001" in policy and "ws://127.0.0.1:8000" in policy
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_only_inline_scripts_are_hashed() -> None:
    html = (
        '<script type="module" src="/a.js"></script><script>stop()</script><script type="application/json">{}</script>'
    )
    # printf 'stop()' | openssl dgst -sha256 -binary | base64
    assert inline_script_hashes(html) == ["sha256-+cxkFLprM1p+UYdsltwfzLJhu4c0AWgWWM2wCE77y2Q="]


async def test_page_leads_nowhere_outside_its_folder(web: Any, tmp_path: Any) -> None:
    for path in (
        "/../pyproject.toml",
        "/%2e%2e/%2e%2e/pyproject.toml",
        "/assets/..%2f..%2f..%2fpyproject.toml",
        "/%00",
        "/.sources",
    ):
        answer = await web.nobody.get(path)
        assert answer.status_code == 404 and b"hatchling" not in answer.content
    assert Page(tmp_path).script_hashes() == []


async def test_unknown_paths_methods_and_bodies_are_problems(web: Any) -> None:
    assert_problem(await web.operator.get("/api/v1/nothing"), 404)
    assert_problem(await web.operator.put("/api/v1/jobs"), 405)
    assert_problem(await web.operator.post("/api/v1/jobs", content=b"{"), 422)
    problem = assert_problem(await web.operator.post("/api/v1/jobs", json={"part_id": "x", "prio": 1}), 422)
    assert problem["errors"] == [{"field": "prio", "error": "Extra inputs are not permitted"}]
    assert_problem(await web.operator.get("/api/v1/jobs?limit=0"), 422)
    assert_problem(await web.operator.get("/api/v1/jobs?cursor=nonsense"), 422)
    assert_problem(await web.operator.post("/api/v1/jobs", content=b" " * 2_000_000), 413)
