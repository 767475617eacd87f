from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import URL

from cellctl.domain.jobs import STEPS, JobState, WrongJobStateError
from cellctl.store import (
    Store,
    StoreError,
    audit,
    blobs,
    idempotency,
    jobs,
    open_store,
    parts,
    sessions,
    tokens,
    upgrade,
)
from cellctl.store.engine import DATABASE, blobs_of
from cellctl.store.idempotency import KeyReusedError
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.pages import CursorError
from cellctl.store.parts import Inspection, PartRow
from cellctl.store.schema import metadata
from cellctl.store.shared import Wanted, share
from cellctl.store.tokens import Role


@contextmanager
def sharing(store: Store, database: URL) -> Iterator[Store]:
    """A store beside this one, with what people share in that database."""
    folder = store.folder.parent / "sharing"
    (folder.parent / "shared.url").write_text(database.render_as_string(hide_password=False))
    share(folder, Wanted(f"@{folder.parent / 'shared.url'}", folder.parent / "files"))
    shutil.copy(store.folder / DATABASE, folder / DATABASE)
    blobs_of(folder).make_folders()
    shared = open_store(folder, store.clock)
    yield shared
    shared.close()


@pytest.fixture(params=["sqlite", "postgresql"])
def store(request: pytest.FixtureRequest, store: Store) -> Iterator[Store]:
    """A store of one's own, in a file, or with what is shared on a server."""
    if request.param == "sqlite":
        yield store
        return
    with sharing(store, request.getfixturevalue("database")) as shared:
        yield shared


in_a_file = pytest.mark.parametrize("store", ["sqlite"], indirect=True)


def part_in(store: Store) -> str:
    inspection = Inspection("m" * 64, [[0, 0, 0], [1, 1, 1]], 12, 1.0, [])
    row = PartRow(new_id("part", store.clock()), "block", ".stl", "mm", "f" * 64, 684, store.clock(), "me", inspection)
    with store.write() as rows:
        parts.add(rows, row)
    return row.id


def job_in(store: Store, part_id: str, name: str = "job", state: JobState = JobState.SUBMITTED) -> JobRow:
    with store.write() as rows:
        row = JobRow(new_id("job", store.clock()), name, part_id, "cell", "", "316L", store.clock(), "me", state=state)
        return jobs.add(rows, row)


def test_migrations_make_the_tables_of_the_schema(store: Store) -> None:
    with store.engine.connect() as rows:
        assert compare_metadata(MigrationContext.configure(rows), metadata) == []


@in_a_file
def test_upgrade_of_a_store_that_is_up_to_date_changes_nothing(store: Store) -> None:
    part_id = part_in(store)
    upgrade(store.folder)
    with store.read() as rows:
        assert parts.get(rows, part_id).name == "block"


@in_a_file
def test_every_connection_writes_ahead_and_waits_for_the_disk(store: Store) -> None:
    with store.read() as rows:
        assert rows.exec_driver_sql("PRAGMA journal_mode").scalar_one() == "wal"
        assert rows.exec_driver_sql("PRAGMA synchronous").scalar_one() == 2  # FULL
        assert rows.exec_driver_sql("PRAGMA foreign_keys").scalar_one() == 1


@in_a_file
def test_plain_sql_of_the_cell_process_fits_its_tables(store: Store) -> None:
    with closing(sqlite3.connect(store.folder / "store.db")) as connection, connection:
        for _ in range(2):
            connection.execute("INSERT INTO events (at, kind, text) VALUES (1.0, 'state', 'IDLE')")
        assert connection.execute("SELECT seq, job, data FROM events").fetchall() == [(1, "", "{}"), (2, "", "{}")]
    connection.close()


@in_a_file
def test_store_of_a_newer_version_is_refused_in_one_line(store: Store) -> None:
    with closing(sqlite3.connect(store.folder / "store.db")) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    connection.close()
    with pytest.raises(StoreError, match="another version") as caught:
        upgrade(store.folder)
    assert "\n" not in caught.value.message and caught.value.hint


def test_damaged_store_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "store.db").write_bytes(b"this is not a database, however long it is" * 100)
    with pytest.raises(StoreError, match="not a database") as caught:
        upgrade(tmp_path)
    assert "\n" not in caught.value.message


def test_absent_store_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no store") as caught:
        open_store(tmp_path / "nowhere")
    assert "cellctl serve" in caught.value.hint


def test_transaction_that_fails_leaves_nothing(store: Store) -> None:
    part_id = part_in(store)
    job = job_in(store, part_id)
    with pytest.raises(WrongJobStateError), store.write() as rows:
        jobs.change(rows, job.id, name="changed")
        jobs.move(rows, job.id, JobState.RUNNING, at=1.0)
    with store.read() as rows:
        assert jobs.get(rows, job.id) == job


@in_a_file
@pytest.mark.parametrize("state", list(JobState))
def test_job_moves_along_the_table_only(store: Store, state: JobState) -> None:
    part_id = part_in(store)
    for target in JobState:
        job = job_in(store, part_id, state=state)
        if (state, target) in STEPS:
            with store.write() as rows:
                moved = jobs.move(rows, job.id, target, at=5.0)
            assert moved.state is target and moved.timestamps[target.value] == 5.0
        else:
            with pytest.raises(WrongJobStateError), store.write() as rows:
                jobs.move(rows, job.id, target, at=5.0)


def test_a_deed_is_written_down_whatever_was_typed(store: Store) -> None:
    with store.write() as rows:
        audit.add(rows, audit.Deed("me", "operator", "here", "stop", "cell", "a\0b"), 1.0, "ok")
        assert [one["because"] for one in audit.of_target(rows, "cell")] == ["a\N{SYMBOL FOR NULL}b"]
    with store.read() as rows:
        assert audit.verify(rows).fault == ""


def test_pages_hold_every_job_once_while_others_are_added(store: Store) -> None:
    part_id = part_in(store)
    made = [job_in(store, part_id, f"job {number}").id for number in range(7)]
    seen: list[str] = []
    cursor: str | None = None
    while True:
        with store.read() as rows:
            found, cursor = jobs.find_page(rows, cursor, 3)
        seen += [job.id for job in found]
        job_in(store, part_id, "later")
        if cursor is None:
            break
    assert seen == made[::-1]


@in_a_file
@pytest.mark.parametrize(
    "cursor", ["", "x", "////", "YmVmb3JlOi0x", "YWZ0ZXI6MQ", "YmVmb3JlOjk5OTk5OTk5OTk5OTk5OTk5OTk5OTk"]
)
def test_cursor_from_elsewhere_is_refused(store: Store, cursor: str) -> None:
    with pytest.raises(CursorError), store.read() as rows:
        jobs.find_page(rows, cursor, 3)


def test_token_is_found_by_its_secret_which_is_not_kept(store: Store) -> None:
    with store.write() as rows:
        row, secret = tokens.create(rows, "me", Role.OPERATOR, 0.0, lifetime_s=10.0)
        assert tokens.find(rows, secret, 9.0) == row
        assert tokens.find(rows, secret, 11.0) is None
        assert tokens.find(rows, secret + "x", 9.0) is None
    assert secret.encode() not in b"".join(path.read_bytes() for path in store.folder.glob("store.db*"))


def test_revoked_token_ends_its_sessions(store: Store) -> None:
    with store.write() as rows:
        row, secret = tokens.create(rows, "me", Role.OPERATOR, 0.0)
        session = sessions.open_for(rows, sessions.of_token(row), 0.0)
        found = sessions.find(rows, session, 1.0)
        assert found is not None and (found.id, found.is_user) == (row.id, False)
        tokens.revoke(rows, row.id, 2.0)
        assert sessions.find(rows, session, 3.0) is None
        assert tokens.find(rows, secret, 3.0) is None


def test_roles_include_those_before_them() -> None:
    assert Role.ADMIN.includes(Role.ENGINEER) and Role.OPERATOR.includes(Role.VIEWER)
    assert not Role.VIEWER.includes(Role.OPERATOR)


def test_key_gives_its_first_answer_and_refuses_another_request(store: Store) -> None:
    digest, other = idempotency.request_digest("job", {"a": 1}), idempotency.request_digest("job", {"a": 2})
    with store.write() as rows:
        assert idempotency.answered(rows, "me", "k", digest) is None
        idempotency.remember(rows, "me", "k", digest, {"id": "first"}, 0.0)
        assert idempotency.answered(rows, "me", "k", digest) == {"id": "first"}
        assert idempotency.answered(rows, "you", "k", other) is None
        with pytest.raises(KeyReusedError):
            idempotency.answered(rows, "me", "k", other)


def test_answers_to_requests_are_forgotten_after_a_month_the_oldest_first(store: Store) -> None:
    with store.write() as rows:
        for k in range(200):
            idempotency.remember(rows, "me", f"old-{k}", "d", {}, 0.0)
        for k in range(20):
            idempotency.remember(rows, "me", f"new-{k}", "d", {}, idempotency.KEPT_S + 1.0)
        kept = {key for (key,) in rows.exec_driver_sql("SELECT key FROM idempotency")}
    assert kept == {f"new-{k}" for k in range(20)}


def test_blob_is_placed_whole_and_again_without_harm(store: Store, tmp_path: Path) -> None:
    for _ in range(2):
        with store.blobs.staging() as folder:
            (folder / "program").mkdir()
            (folder / "program" / "a.ngc").write_text("N1 G21")
            blobs.place(folder / "program", store.blobs.program("a" * 64))
    assert [path.name for path in store.blobs.program("a" * 64).iterdir()] == ["a.ngc"]
    assert not list(store.blobs.unfinished.iterdir())
