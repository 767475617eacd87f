"""Commands of a job's life, of people and of backups, as they are typed: what they print, their JSON and their exit codes."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from cellctl.domain.jobs import JobState
from cellctl.store import audit, jobs, open_store
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from planner.recipe import Recipe
from tests.unit.cellctl.hostile import PASSWORD, cheap_hashes
from tests.unit.cellctl.served_by_thread import AtPort, at_port
from tests.unit.cellctl.test_cli import run, says_one_line_and_a_hint
from tests.unit.cellctl.test_store import part_in

__all__ = ["cheap_hashes"]

Typed = Callable[..., tuple[int, str]]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> Iterator[AtPort]:
    with at_port(tmp_path_factory.mktemp("cli"), empty_store) as found:
        yield found


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Typed:
    """Type a command: (exit code, what it printed; of a refused one what it said)."""

    def type_it(*words: str, stdin: str = "") -> tuple[int, str]:
        capfd.readouterr()
        monkeypatch.setattr("sys.stdin", io.StringIO(stdin))
        code = run(*words, monkeypatch=monkeypatch)
        said = capfd.readouterr()
        assert "Traceback" not in said.err
        assert code == 0 or says_one_line_and_a_hint(said.err), said.err
        return code, said.out if code == 0 else said.err

    return type_it


@pytest.fixture
def at_service(typed: Typed, served: AtPort, monkeypatch: pytest.MonkeyPatch) -> Typed:
    """As typed, asking the service."""
    monkeypatch.setenv("CELLCTL_TOKEN", served.token)
    return lambda *words: typed(*words, "--url", served.url)


def job_in(served: AtPort, name: str, state: JobState) -> str:
    """A job of this service's cell."""
    store, toml = served.service.store, tomli_w.dumps(Recipe(process="deposit").model_dump(mode="json", exclude_none=True))
    part = part_in(store)
    with store.write() as rows:
        row = JobRow(new_id("job", store.clock()), name, part, served.service.cell.name, toml, "316L", store.clock(), "me", state=state)
        return jobs.add(rows, row).id


def test_queue_is_shown_and_reordered(at_service: Typed, served: AtPort) -> None:
    first, second = (job_in(served, name, JobState.QUEUED) for name in ("first", "second"))
    code, text = at_service("queue")
    assert code == 0 and text.index(first) < text.index(second) and "a person confirms" in text
    code, text = at_service("queue", "--move", second, "--to", "first", "--because", "urgent", "--json")
    assert code == 0 and [job["id"] for job in json.loads(text)["items"]][:2] == [second, first]
    assert at_service("queue", "--move", second, "--to", "somewhere")[0] == 2
    assert at_service("queue", "--move", "nothing", "--to", "up")[0] == 2


def test_table_is_told_and_cleared(at_service: Typed, served: AtPort) -> None:
    assert "nothing starts before a person found the table clear" in at_service("table")[1]
    code, text = at_service("table", "--clear", "--because", "swept", "--json")
    assert code == 0 and json.loads(text)["cleared_by"] == "an engineer" and json.loads(text)["because"] == "swept"
    assert at_service("table", "--start", "last")[0] == 2, "nobody looked"


def test_a_job_is_made_once_more_and_tried_again(at_service: Typed, served: AtPort) -> None:
    done, failed = job_in(served, "done", JobState.COMPLETED), job_in(served, "failed", JobState.FAILED)
    for verb, job in (("rerun", done), ("retry", failed)):
        code, text = at_service(verb, job, "--because", "once more", "--json")
        made = json.loads(text)
        assert code == 0 and (made["made_from"], made["made_how"], made["state"]) == (job, verb, "submitted")
    code, text = at_service("retry", done)
    assert code != 0 and "it has not failed" in text


def test_notes_are_added_and_shown(at_service: Typed, served: AtPort) -> None:
    job = job_in(served, "noted", JobState.COMPLETED)
    assert at_service("note", job, "a scratch on the left side")[0] == 0
    code, text = at_service("note", job)
    assert code == 0 and "a scratch on the left side" in text and "an engineer" in text


def deeds(store: Path) -> list[tuple[str, str]]:
    opened = open_store(store)
    try:
        with opened.read() as rows:
            return [(row["verb"], row["target"]) for row in reversed(audit.find_page(rows, audit.Wanted(), None, 50)[0])]
    finally:
        opened.close()


def test_users_are_made_listed_changed_and_shut_out_each_with_its_row_in_the_trail(typed: Typed, tmp_path: Path, empty_store: Path) -> None:
    shutil.copytree(empty_store, tmp_path / "store")
    of = ("--store", str(tmp_path / "store"))
    code, text = typed("user", "add", "anna", "--role", "operator", "--json", *of, stdin=PASSWORD + "\n")
    assert code == 0 and json.loads(text)["role"] == "operator" and "password_hash" not in text
    assert typed("user", "role", "anna", "engineer", *of)[0] == 0
    assert typed("user", "password", "anna", *of, stdin=PASSWORD + " staple\n")[0] == 0
    assert "is disabled" in typed("user", "disable", "anna", *of)[1]
    found: list[dict[str, Any]] = json.loads(typed("user", "list", "--json", *of)[1])
    assert [(one["name"], one["role"], one["disabled_at"] is not None) for one in found] == [("anna", "engineer", True)]
    assert "engineer" in typed("user", "enable", "anna", *of)[1]
    assert typed("user", "disable", "nobody", *of)[0] == 2
    assert typed("user", "add", "ben", *of, stdin="short\n")[0] == 2
    verbs = [verb for verb, target in deeds(tmp_path / "store") if target == "anna"]
    assert verbs == ["create user", "change role", "set password", "disable user", "enable user"]


def test_tokens_are_made_listed_and_revoked_each_with_its_row_in_the_trail(typed: Typed, tmp_path: Path, empty_store: Path) -> None:
    shutil.copytree(empty_store, tmp_path / "store")
    of = ("--store", str(tmp_path / "store"))
    made = json.loads(typed("token", "create", "a robot", "--role", "viewer", "--scope", "read", "--days", "2", "--json", *of)[1])
    assert made["scopes"] == ["read"] and made["expires_at"] - made["created_at"] == pytest.approx(2 * 86400.0)
    assert made["secret"] not in typed("token", "list", *of)[1]
    assert typed("token", "revoke", made["id"], *of) == (0, f"{made['id']} is revoked\n")
    assert json.loads(typed("token", "list", "--json", *of)[1])[0]["revoked_at"] is not None
    assert typed("token", "revoke", "nothing", *of)[0] == 2
    assert deeds(tmp_path / "store") == [("create token", made["id"]), ("revoke token", made["id"])]


def test_a_store_is_backed_up_and_restored(typed: Typed, tmp_path: Path, empty_store: Path) -> None:
    shutil.copytree(empty_store, tmp_path / "store")
    made = json.loads(typed("token", "create", "me", "--json", "--store", str(tmp_path / "store"))[1])
    backup = tmp_path / "backup.tar"
    assert typed("backup", str(backup), "--store", str(tmp_path / "store"))[0] == 0 and backup.stat().st_size > 0
    assert typed("restore", str(backup), "--store", str(tmp_path / "again"))[0] == 0
    assert [one["id"] for one in json.loads(typed("token", "list", "--json", "--store", str(tmp_path / "again"))[1])] == [made["id"]]
    assert typed("restore", str(backup), "--store", str(tmp_path / "again"))[0] == 2, "nothing is written over"
    assert typed("backup", str(backup), "--store", str(tmp_path / "nowhere"))[0] == 2
