"""Hostile requests, all refused: traversal, forged headers, replay, brute force, oversize, secrets that must not show."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from typing import Any

import argon2
import pytest

from cellctl import passwords
from cellctl.api import sign_in as sign_in_module
from cellctl.store.tokens import Role
from tests.unit.cellctl.test_api_sign_in import assert_problem

PASSWORD = "correct horse battery"
HOSTILE = ["<script>alert(1)</script>", "\"><img src=x onerror=alert(1)>", "'; DROP TABLE jobs; --", "{{7*7}}", "\u202egnp.exe", "a\x00b", "javascript:alert(1)"]


@pytest.fixture(autouse=True)
def cheap_hashes(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(passwords, "HASHER", argon2.PasswordHasher(time_cost=1, memory_cost=64, parallelism=1))
    passwords._nobody.cache_clear()
    yield
    passwords._nobody.cache_clear()


async def user_in(web: Any, name: str) -> None:
    answer = await web.admin.post("/api/v1/users", json={"name": name, "role": "operator", "password": PASSWORD})
    assert answer.status_code == 201, answer.text


async def session_of(web: Any, **given: str) -> tuple[str, str]:
    """(cookie, CSRF word)"""
    answer = await web.nobody.post("/api/v1/session", json=given)
    web.nobody.cookies.clear()
    assert answer.status_code == 200, answer.text
    return answer.headers["set-cookie"].partition(";")[0], answer.json()["csrf"]


@pytest.mark.parametrize(
    "path",
    ["/api/v1/parts/..%2f..%2fstore.db/mesh", "/api/v1/parts/%2e%2e%2f%2e%2e/mesh", "/api/v1/jobs/../../../etc/passwd", "/api/v1/jobs/..%5c..%5cstore.db/record",
     "/..%2f..%2f..%2fetc%2fpasswd", "/assets/%2e%2e/%2e%2e/api/app.py", "//etc/passwd", "/%00/etc/passwd", "/api/v1/materials/..%2f..%2fpyproject.toml"],
)  # fmt: skip
async def test_path_that_climbs_leads_nowhere(web: Any, path: str) -> None:
    answer = await web.admin.get(path)
    assert answer.status_code in (404, 405, 422) and b"root:" not in answer.content and b"SQLite" not in answer.content


@pytest.mark.parametrize("name", ["../../evil.stl", "..\\..\\evil.stl", "/etc/passwd.stl", "a/../../b.stl", "<script>alert(1)</script>.stl", ".stl", "x" * 400 + ".stl"])
async def test_name_of_an_upload_is_no_path_and_no_markup(web: Any, block: Any, name: str) -> None:
    answer = await web.operator.post("/api/v1/parts", files={"file": (name, block.read_bytes())})
    assert answer.status_code == 201, answer.text
    told = answer.json()["name"]
    assert not set(told) & set("/\\<>\"'\0") and ".." not in told and len(told) <= 100
    folder = web.service.store.folder
    assert not [path for path in folder.parent.rglob("*evil*") if folder not in path.parents]


async def test_forged_forwarding_headers_are_not_believed(web: Any) -> None:
    forged = {"X-Forwarded-For": "1.2.3.4", "X-Real-IP": "1.2.3.4", "Forwarded": "for=1.2.3.4", "X-Forwarded-Host": "evil.example", "X-Forwarded-Proto": "https"}
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
        for method, path in (("POST", "/api/v1/cell/hold"), ("POST", "/api/v1/jobs"), ("DELETE", "/api/v1/session"), ("POST", "/api/v1/session/password")):
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


async def test_idempotency_key_of_another_person_gives_nothing_of_theirs(web: Any, block: Any) -> None:
    part = (await web.operator.post("/api/v1/parts", files={"file": ("a.stl", block.read_bytes())})).json()
    key = {"Idempotency-Key": "same"}
    first = (await web.operator.post("/api/v1/jobs", json={"part_id": part["id"], "name": "theirs"}, headers=key)).json()
    other = await web.engineer.post("/api/v1/jobs", json={"part_id": part["id"], "name": "mine"}, headers=key)
    assert other.json()["id"] != first["id"] and other.json()["name"] == "mine"


async def test_guessing_is_slowed_down_whatever_the_name_and_nobody_learns_which_exist(web: Any) -> None:
    await user_in(web, "anna")
    answers: dict[str, list[tuple[int, str]]] = {}
    for name in ("anna", "nobody-here"):
        answers[name] = []
        for number in range(8):
            answer = await web.nobody.post("/api/v1/session", json={"user": name, "password": f"guess number {number}"})
            answers[name].append((answer.status_code, answer.json()["detail"]))
        assert answer.headers["retry-after"].isdigit()
    assert answers["anna"] == answers["nobody-here"]
    assert [status for status, _ in answers["anna"]] == [401] * 5 + [429] * 3
    right = await web.nobody.post("/api/v1/session", json={"user": "anna", "password": PASSWORD})
    assert_problem(right, 429)
    assert "STOP" in right.json()["hint"]


async def test_many_guesses_at_once_are_as_many(web: Any) -> None:
    await user_in(web, "anna")
    guesses = [web.nobody.post("/api/v1/session", json={"user": "anna", "password": f"guess number {k}"}) for k in range(15)]
    statuses = [answer.status_code for answer in await asyncio.gather(*guesses)]
    assert statuses.count(401) <= 5 and set(statuses) <= {401, 429, 503}


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
async def test_hostile_text_comes_back_as_data_that_no_browser_takes_for_a_page(web: Any, block: Any, text: str) -> None:
    part = (await web.operator.post("/api/v1/parts", files={"file": ("a.stl", block.read_bytes())})).json()
    answer = await web.operator.post("/api/v1/jobs", json={"part_id": part["id"], "name": text})
    shown = [answer, await web.viewer.get("/api/v1/jobs"), await web.operator.get(f"/api/v1/jobs/{text.replace('/', '%2F')[:60]}".replace("\x00", "%00"))]
    for one in shown:
        assert one.status_code < 500, one.text
        assert one.headers["content-type"].startswith(("application/json", "application/problem+json"))
        assert one.headers["x-content-type-options"] == "nosniff" and "default-src 'none'" in one.headers["content-security-policy"]


@pytest.mark.parametrize(
    "body",
    [b"[" * 100_000, b'{"a":' * 50_000, b'{"part_id": ' + b"9" * 5000 + b"}", b'{"part_id": "\\ud800"}', b'{"part_id": 1e999}', b"\xff\xfe", b"NaN",
     b'{"part_id": "x", "part_id": "y", "name": null, "cell": {}}', b'"' + b"x" * 900_000 + b'"'],
)  # fmt: skip
async def test_body_that_is_deep_huge_or_no_text_is_refused_and_breaks_nothing(web: Any, body: bytes) -> None:
    for path in ("/api/v1/jobs", "/api/v1/session", "/api/v1/cell/jog", "/api/v1/users"):
        answer = await web.admin.post(path, content=body, headers={"Content-Type": "application/json"})
        assert 400 <= answer.status_code < 500, (path, answer.status_code, answer.text[:200])


@pytest.mark.parametrize("client_id", ["a b", "x" * 65, "<script>", "ä"])
async def test_clients_name_that_is_none_is_refused_at_uploads_too(web: Any, block: Any, client_id: str) -> None:
    headers = {"X-Client-Id": client_id.encode("latin-1")}
    answer = await web.operator.post("/api/v1/parts", files={"file": ("a.stl", block.read_bytes())}, headers=headers)
    assert_problem(answer, 422)


async def test_body_above_its_limit_is_refused_whatever_its_headers_say(web: Any) -> None:
    async def endless() -> Any:
        for _ in range(40):
            yield b" " * 65_536

    for path in ("/api/v1/jobs", "/api/v1/session", "/api/v1/parts"):
        assert (await web.nobody.post(path, content=endless())).status_code == 413


async def test_secrets_are_in_no_answer_no_address_and_no_log(web: Any, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    await user_in(web, "anna")
    secrets = [*web.secrets.values(), PASSWORD]
    cookie, csrf = await session_of(web, user="anna", password=PASSWORD)
    secrets += [cookie.partition("=")[2]]
    texts = []
    for body in ({"user": "anna", "password": PASSWORD, "token": PASSWORD}, {"user": "anna", "password": PASSWORD, "more": 1}, {"token": [PASSWORD]}):
        texts.append((await web.nobody.post("/api/v1/session", json=body)).text)
    headers = {"Cookie": cookie, "X-CSRF-Token": csrf}
    texts += [(await web.nobody.get(path, headers=headers)).text for path in ("/api/v1/session", "/api/v1/nothing", "/metrics", "/openapi.json")]
    texts += [(await web.admin.get(path)).text for path in ("/api/v1/audit", "/api/v1/users", "/api/v1/tokens")]
    for secret in web.secrets.values():  # a token in an address signs nobody in
        answer = await web.nobody.get(f"/api/v1/jobs?token={secret}&access_token={secret}")
        assert answer.status_code == 401
        texts.append(answer.text)

    def broken(*_given: object) -> None:
        raise RuntimeError("a fault that nobody foresaw")

    monkeypatch.setattr(sign_in_module, "account_of", broken)
    answer = await web.operator.get("/api/v1/jobs", headers={"Cookie": cookie})
    assert answer.status_code == 500
    texts += [answer.text, *capfd.readouterr()]
    assert "a fault that nobody foresaw" in texts[-1] + texts[-2]
    found = [secret[:12] for secret in secrets for text in texts if secret in text]
    assert not found


async def test_every_answer_has_the_headers_that_browsers_go_by(web: Any) -> None:
    for answer in (await web.nobody.get("/"), await web.operator.get("/api/v1/jobs"), await web.nobody.get("/api/v1/jobs"), await web.nobody.get("/x", headers={"Host": "evil"})):
        headers = answer.headers
        if answer.status_code == 421:
            continue
        assert headers["cross-origin-opener-policy"] == headers["cross-origin-resource-policy"] == "same-origin"
        assert headers["referrer-policy"] == "no-referrer" and headers["x-frame-options"] == "DENY"
        assert "camera=()" in headers["permissions-policy"]
        policy = headers["content-security-policy"]
        assert "frame-ancestors 'none'" in policy and "base-uri 'none'" in policy and "unsafe" not in policy and "*" not in policy


