"""What tests of hostile requests share: a person to sign in as, sessions, a clock that stands, and hashes that cost little."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import argon2
import pytest

from cellctl import passwords

PASSWORD = "correct horse battery"


@pytest.fixture(autouse=True)
def cheap_hashes(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(passwords, "HASHER", argon2.PasswordHasher(time_cost=1, memory_cost=64, parallelism=1))
    passwords._nobody.cache_clear()
    yield
    passwords._nobody.cache_clear()


async def user_in(web: Any, name: str) -> None:
    answer = await web.admin.post("/api/v1/users", json={"name": name, "role": "operator", "password": PASSWORD})
    assert answer.status_code == 201, answer.text


def stand_still(web: Any) -> None:
    """The store's clock shows one time: however busy the machine is, no wait passes."""
    now = web.service.store.clock()
    object.__setattr__(web.service.store, "clock", lambda: now)


async def session_of(web: Any, **given: str) -> tuple[str, str]:
    """(cookie, CSRF word)"""
    answer = await web.nobody.post("/api/v1/session", json=given)
    web.nobody.cookies.clear()
    assert answer.status_code == 200, answer.text
    return answer.headers["set-cookie"].partition(";")[0], answer.json()["csrf"]
