"""Users, passwords, scopes, sessions and the audit trail, over REST and in the store."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import argon2
import pytest
from sqlalchemy.exc import DBAPIError

from cellctl import passwords
from cellctl.passwords import PasswordError
from cellctl.store import Store, audit, open_store, sessions, tokens, tries, users
from cellctl.store.audit import Deed
from cellctl.store.tokens import Role, Scope
from cellctl.store.tries import ACCOUNT, ADDRESS, PLACE, Try
from cellctl.store.users import LastAdminError, UserNameError
from tests.unit.cellctl.test_api_sign_in import assert_problem

PASSWORD, OTHER = "correct horse battery", "staple wagon corridor"
CHEAP = argon2.PasswordHasher(time_cost=1, memory_cost=64, parallelism=1)


@pytest.fixture(autouse=True)
def cheap_hashes(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The real ones take a tenth of a second each; one test measures them."""
    monkeypatch.setattr(passwords, "HASHER", CHEAP)
    passwords._nobody.cache_clear()
    yield
    passwords._nobody.cache_clear()


async def user_in(web: Any, name: str = "anna", role: str = "operator") -> None:
    answer = await web.admin.post("/api/v1/users", json={"name": name, "role": role, "password": PASSWORD})
    assert answer.status_code == 201 and "hash" not in answer.text and PASSWORD not in answer.text


async def sign_in(web: Any, name: str = "anna", password: str = PASSWORD) -> tuple[dict[str, str], dict[str, Any]]:
    """(headers of the session's page, the session)"""
    web.nobody.cookies.clear()
    answer = await web.nobody.post("/api/v1/session", json={"user": name, "password": password})
    assert answer.status_code == 200, answer.text
    cookie = answer.headers["set-cookie"].partition(";")[0]
    web.nobody.cookies.clear()
    return {"Cookie": cookie, "X-CSRF-Token": answer.json()["csrf"]}, answer.json()


async def test_user_signs_in_by_password_and_has_its_role(web: Any) -> None:
    await user_in(web, "Anna")
    page, session = await sign_in(web, "ANNA ")
    assert (session["name"], session["role"], session["is_user"]) == ("anna", "operator", True)
    assert_problem(await web.nobody.post("/api/v1/cell/hold", json={}, headers=page), 503)  # let in; no cell is there
    assert_problem(await web.nobody.get("/api/v1/users", headers=page), 403)


async def test_admin_changes_role_disables_and_sets_passwords_and_each_counts_at_once(web: Any) -> None:
    await user_in(web)
    page, _ = await sign_in(web)
    assert (await web.admin.patch("/api/v1/users/anna", json={"role": "viewer"})).json()["role"] == "viewer"
    assert_problem(await web.nobody.post("/api/v1/cell/hold", json={}, headers=page), 403)
    assert (await web.admin.post("/api/v1/users/anna/password", json={"password": OTHER})).status_code == 204
    assert_problem(await web.nobody.get("/api/v1/session", headers=page), 401)
    page, _ = await sign_in(web, password=OTHER)
    assert (await web.admin.patch("/api/v1/users/anna", json={"disabled": True})).json()["disabled_at"]
    assert_problem(await web.nobody.get("/api/v1/session", headers=page), 401)
    assert_problem(await web.nobody.post("/api/v1/session", json={"user": "anna", "password": OTHER}), 401)
    assert (await web.admin.patch("/api/v1/users/anna", json={"disabled": False})).json()["disabled_at"] is None
    await sign_in(web, password=OTHER)


async def test_own_password_change_needs_the_old_one_and_ends_the_other_sessions(web: Any) -> None:
    await user_in(web)
    here, _ = await sign_in(web)
    there, _ = await sign_in(web)
    path = "/api/v1/session/password"
    assert_problem(await web.nobody.post(path, json={"password": "wrong one here", "new_password": OTHER}, headers=here), 403)
    assert_problem(await web.nobody.post(path, json={"password": PASSWORD, "new_password": "short"}, headers=here), 422)
    assert (await web.nobody.post(path, json={"password": PASSWORD, "new_password": OTHER}, headers=here)).status_code == 204
    assert (await web.nobody.get("/api/v1/session", headers=here)).status_code == 200
    assert_problem(await web.nobody.get("/api/v1/session", headers=there), 401)
    assert_problem(await web.operator.post(path, json={"password": PASSWORD, "new_password": OTHER}), 409)


async def test_sign_out_everywhere_ends_every_session_of_the_user_and_nobody_elses(web: Any) -> None:
    await user_in(web)
    await user_in(web, "bert")
    pages = [(await sign_in(web))[0] for _ in range(2)]
    bert, _ = await sign_in(web, "bert")
    assert (await web.nobody.delete("/api/v1/session?everywhere=true", headers=pages[0])).status_code == 204
    assert [(await web.nobody.get("/api/v1/session", headers=page)).status_code for page in (*pages, bert)] == [401, 401, 200]


async def test_users_are_refused_in_one_line_where_name_or_password_will_not_do(web: Any) -> None:
    await user_in(web)
    for name, password, status in (("anna", PASSWORD, 409), ("no blanks", PASSWORD, 422), ("x", "aaaaaaaaaaaa", 422), ("bertolt", "bertolt123", 422)):
        assert_problem(await web.admin.post("/api/v1/users", json={"name": name, "role": "viewer", "password": password}), status)
    assert_problem(await web.admin.patch("/api/v1/users/nobody", json={"role": "viewer"}), 404)


async def test_last_admin_can_neither_be_disabled_nor_lowered(web: Any) -> None:
    await user_in(web, "boss", "admin")
    assert_problem(await web.admin.patch("/api/v1/users/boss", json={"disabled": True}), 409)
    assert_problem(await web.admin.patch("/api/v1/users/boss", json={"role": "engineer"}), 409)
    await user_in(web, "other", "admin")
    assert (await web.admin.patch("/api/v1/users/boss", json={"role": "engineer"})).status_code == 200


@pytest.mark.parametrize(
    ("scopes", "allowed"),
    [(["read"], {"GET jobs"}), (["cell"], {"POST cell/hold"}), (["jobs"], {"POST jobs"}), (["admin"], {"GET users"}),
     ([], {"GET jobs", "POST cell/hold", "POST jobs", "GET users"})],
)  # fmt: skip
async def test_token_is_good_for_its_scopes_only(web: Any, scopes: list[str], allowed: set[str]) -> None:
    made = (await web.admin.post("/api/v1/tokens", json={"name": "robot", "role": "admin", "scopes": scopes})).json()
    headers = {"Authorization": f"Bearer {made['secret']}"}
    found = set()
    for asked in ("GET jobs", "POST cell/hold", "POST jobs", "GET users"):
        method, path = asked.split()
        answer = await web.nobody.request(method, f"/api/v1/{path}", json={} if method == "POST" else None, headers=headers)
        if answer.status_code != 403:
            found.add(asked)
    assert found == allowed


def test_sign_in_waits_longer_with_each_failure_and_a_restart_forgets_nothing(store: Store) -> None:
    one, at = Try("anna", "10.0.0.9"), 1000.0
    waited = []
    for _ in range(PLACE.free + 4):
        with store.write() as rows:
            wait = tries.begin(rows, one, at)
            if wait:
                waited.append(wait)
                assert tries.begin(rows, one, at + wait - 0.01) > 0
                assert tries.begin(rows, one, at + wait) == 0
                at += wait
    assert waited == [1.0, 2.0, 4.0, 8.0]
    again = open_store(store.folder)
    with again.write() as rows:
        assert tries.begin(rows, one, at) == pytest.approx(16.0)
    again.close()


def test_stranger_elsewhere_cannot_keep_the_owner_out_from_where_it_signs_in(store: Store) -> None:
    owner = Try("anna", "10.0.0.1")
    with store.write() as rows:
        tries.begin(rows, owner, 0.0)
        tries.succeeded(rows, owner, 0.0)
        for number in range(ACCOUNT.free + 5):
            tries.begin(rows, Try("anna", f"10.0.1.{number}"), 10.0)
        assert tries.begin(rows, Try("anna", "10.0.2.1"), 10.0) > 0
        assert tries.begin(rows, owner, 10.0) == 0


def test_one_address_that_tries_many_accounts_waits_too(store: Store) -> None:
    with store.write() as rows:
        for number in range(ADDRESS.free):
            assert tries.begin(rows, Try(f"user{number}", "10.0.0.9"), 0.0) == 0
        assert tries.begin(rows, Try("anna", "10.0.0.9"), 0.0) > 0
        assert tries.begin(rows, Try("anna", "10.0.0.8"), 0.0) == 0


def test_session_ends_when_idle_and_at_its_limit(store: Store) -> None:
    with store.write() as rows:
        row = users.create(rows, "anna", Role.OPERATOR, passwords.hashed(PASSWORD), 0.0)
        secret = sessions.open_for(rows, sessions.of_user(row), 0.0)
        assert sessions.find(rows, secret, sessions.IDLE_S - 1.0)
        assert sessions.find(rows, secret, sessions.IDLE_S) is None
        assert sessions.find(rows, secret, sessions.IDLE_S, heard_at=10.0)
        sessions.heard(rows, {tokens.digest(secret): sessions.SESSION_S - 10.0})
        assert sessions.find(rows, secret, sessions.SESSION_S - 1.0)
        assert sessions.find(rows, secret, sessions.SESSION_S) is None


async def test_password_of_older_parameters_is_hashed_anew_when_its_owner_signs_in(web: Any) -> None:
    await user_in(web)
    passwords.HASHER = argon2.PasswordHasher(time_cost=2, memory_cost=64, parallelism=1)  # undone by cheap_hashes
    await sign_in(web)
    with web.service.store.read() as rows:
        assert ",t=2," in users.get(rows, "anna").password_hash


async def test_trail_tells_who_did_what_from_where_and_why_and_is_found_by_filter(web: Any) -> None:
    await user_in(web)
    await sign_in(web)
    await web.admin.patch("/api/v1/users/anna", json={"role": "engineer", "because": "trained"})
    await web.nobody.post("/api/v1/session", json={"user": "anna", "password": "wrong wrong"})
    await web.nobody.post("/api/v1/session", json={"user": "my secret password", "password": "x"})
    assert_problem(await web.operator.get("/api/v1/audit"), 403)
    items = (await web.engineer.get("/api/v1/audit")).json()["items"]
    told = [(item["who"], item["verb"], item["target"], item["because"]) for item in items[::-1]]
    assert ("the admin", "create user", "anna", "") in told and ("the admin", "change role", "anna", "trained") in told
    assert {item["who"] for item in items if item["outcome"].startswith("refused")} == {"anna", "unknown"}
    assert "my secret password" not in str(items) and items[0]["origin"] == "127.0.0.1"
    page = (await web.engineer.get("/api/v1/audit", params={"verb": "sign in", "limit": 1})).json()
    rest = (await web.engineer.get("/api/v1/audit", params={"verb": "sign in", "cursor": page["next"]})).json()
    assert len(page["items"]) == 1 and {item["verb"] for item in rest["items"]} == {"sign in"} and rest["next"] is None
    assert (await web.engineer.get("/api/v1/audit/verdict")).json()["fault"] == ""


def trail_of(store: Store, count: int) -> None:
    with store.write() as rows:
        for number in range(count):
            audit.add(rows, Deed("anna", "operator", "10.0.0.1", "stop", f"cell {number}", "smoke"), float(number) + 0.1, "ok")


@pytest.mark.parametrize(
    "sql",
    ["UPDATE audit SET who = 'bert'", "DELETE FROM audit WHERE seq = 2",
     "INSERT OR REPLACE INTO audit SELECT seq, at, 'bert', role, origin, verb, target, because, outcome, sha256 FROM audit WHERE seq = 2"],
)  # fmt: skip
def test_trail_refuses_every_change_of_what_is_there(store: Store, sql: str) -> None:
    trail_of(store, 3)
    with pytest.raises(DBAPIError, match="only grows"), store.write() as rows:
        rows.exec_driver_sql(sql)
    with store.read() as rows:
        assert audit.verify(rows).fault == "" and audit.count(rows) == 3


@pytest.mark.parametrize(
    ("sql", "fault"),
    [("UPDATE audit SET because = 'x' WHERE seq = 2", "row 2 is not what was written"), ("DELETE FROM audit WHERE seq = 2", "row 2 is missing"),
     ("DELETE FROM audit WHERE seq = 4", "rows 4 to 4 are missing"), ("UPDATE audit SET at = 0 WHERE seq = 1", "row 1 is not what was written")],
)  # fmt: skip
def test_change_by_who_takes_the_triggers_away_is_noticed(store: Store, sql: str, fault: str) -> None:
    trail_of(store, 4)
    with closing(sqlite3.connect(store.folder / "store.db")) as db, db:
        for name in ("audit_no_update", "audit_no_delete"):
            db.execute(f"DROP TRIGGER {name}")
        db.execute(sql)
    with store.read() as rows:
        assert audit.verify(rows).fault.startswith(fault)


def test_trail_that_was_written_anew_is_noticed_by_a_hash_noted_elsewhere(store: Store, empty_store: Path) -> None:
    trail_of(store, 3)
    with store.read() as rows:
        head = audit.verify(rows).head
        assert audit.verify(rows, head).fault == ""
        assert "written anew" in audit.verify(rows, "0" * 64).fault


def test_names_and_passwords_that_will_not_do_are_refused(store: Store) -> None:
    with pytest.raises(PasswordError, match="at least 10"):
        passwords.check("short", "anna")
    with store.write() as rows:
        users.create(rows, "anna", Role.ADMIN, "x", 0.0)
        with pytest.raises(UserNameError, match="already"):
            users.create(rows, " ANNA", Role.ADMIN, "x", 0.0)
        with pytest.raises(LastAdminError):
            users.set_disabled(rows, "anna", True, 1.0)


def test_scopes_of_a_token_are_kept_and_all_of_them_where_none_is_named(store: Store) -> None:
    with store.write() as rows:
        narrow, secret = tokens.create(rows, "robot", Role.OPERATOR, 0.0, scopes=[Scope.CELL, Scope.READ])
        assert tokens.find(rows, secret, 1.0) == narrow and narrow.scopes == (Scope.READ, Scope.CELL)
        assert tokens.create(rows, "all", Role.VIEWER, 0.0)[0].scopes == tuple(Scope)
