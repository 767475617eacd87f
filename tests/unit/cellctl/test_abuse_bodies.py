"""Hostile requests, all refused: guessing, deep and huge bodies, secrets that must not show."""

from __future__ import annotations

from typing import Any

import pytest
import structlog

from cellctl.api import sign_in as sign_in_module
from cellctl.api.__main__ import configure_log
from tests.unit.cellctl.hostile import PASSWORD, session_of, stand_still, user_in
from tests.unit.cellctl.hostile import cheap_hashes as cheap_hashes
from tests.unit.cellctl.test_api_sign_in import assert_problem


async def test_guessing_is_slowed_down_whatever_the_name_and_nobody_learns_which_exist(web: Any) -> None:
    await user_in(web, "anna")
    stand_still(web)
    answers: dict[str, list[tuple[int, str]]] = {}
    for name in ("anna", "nobody-here"):
        answers[name] = []
        for number in range(8):
            answer = await web.nobody.post("/api/v1/session", json={"user": name, "password": f"guess number {number}"})
            answers[name].append((answer.status_code, answer.json()["detail"]))
        assert answer.headers["retry-after"].isdigit()
    assert answers["anna"] == answers["nobody-here"]
    assert [status for status, _ in answers["anna"]] == [401] * 4 + [429] * 4
    right = await web.nobody.post("/api/v1/session", json={"user": "anna", "password": PASSWORD})
    assert_problem(right, 429)
    assert "STOP" in right.json()["hint"]


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
        assert (await web.nobody.post(path, content=endless())).status_code in (401, 413)


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
    structlog.reset_defaults()  # another test may have it quiet
    configure_log()  # as the web process logs
    answer = await web.operator.get("/api/v1/jobs", headers={"Cookie": cookie})
    assert answer.status_code == 500
    structlog.reset_defaults()
    texts += [answer.text, *capfd.readouterr()]
    assert "a fault that nobody foresaw" in texts[-1] + texts[-2]
    found = [secret[:12] for secret in secrets for text in texts if secret in text]
    assert not found


async def test_every_answer_has_the_headers_that_browsers_go_by(web: Any) -> None:
    for answer in (
        await web.nobody.get("/"),
        await web.operator.get("/api/v1/jobs"),
        await web.nobody.get("/api/v1/jobs"),
        await web.nobody.get("/x", headers={"Host": "evil"}),
    ):
        headers = answer.headers
        if answer.status_code == 421:
            continue
        assert headers["cross-origin-opener-policy"] == headers["cross-origin-resource-policy"] == "same-origin"
        assert headers["referrer-policy"] == "no-referrer" and headers["x-frame-options"] == "DENY"
        assert "camera=()" in headers["permissions-policy"]
        policy = headers["content-security-policy"]
        assert "frame-ancestors 'none'" in policy and "base-uri 'none'" in policy and "unsafe" not in policy and "*" not in policy
