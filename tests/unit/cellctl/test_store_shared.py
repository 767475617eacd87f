"""A store that several hosts share: how it is set up, what is refused, where things lie, and two hosts on one set of jobs."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import URL, insert

from cellctl.store import Store, StoreError, blobs, history, jobs, open_store, upgrade, webhooks
from cellctl.store.backup import back_up, restore
from cellctl.store.jobs import JobRow
from cellctl.store.schema import events
from cellctl.store.shared import Wanted, share, shared_of, told_url
from cellctl.store.sides import WrongSideError
from tests.postgres import Cluster
from tests.unit.cellctl.test_store import job_in, part_in, sharing

SECRET = "a-word-that-nobody-may-see"


@pytest.fixture
def one(store: Store, database: URL) -> Iterator[Store]:
    """A host's store."""
    with sharing(store, database) as opened:
        yield opened


@pytest.fixture
def other(one: Store, tmp_path: Path, database: URL) -> Iterator[Store]:
    """Another host's, of the same house."""
    share(tmp_path / "other", Wanted(f"@{tmp_path / 'shared.url'}", tmp_path / "files"))
    upgrade(tmp_path / "other")
    opened = open_store(tmp_path / "other", one.clock)
    yield opened
    opened.close()


def test_what_one_host_submits_the_other_sees_and_what_its_cell_writes_stays_its_own(one: Store, other: Store) -> None:
    job = job_in(one, part_in(one))
    with one.write_cell() as rows:
        rows.execute(insert(events).values(at=1.0, kind="alarm", text="the door is open"))
    with other.read() as rows:
        assert jobs.get(rows, job.id) == job
    with other.read_cell() as rows:
        assert history.last_seq(rows) == 0
    with one.read_cell() as rows:
        assert [event.text for event in history.events_after(rows, 0)] == ["the door is open"]


def test_files_are_seen_by_both_and_a_start_of_one_leaves_the_others_unfinished_ones_alone(one: Store, other: Store) -> None:
    with one.blobs.staging() as folder:
        (folder / "a.h5").write_bytes(b"plan")
        other.blobs.clear_staging()
        blobs.place(folder / "a.h5", one.blobs.plan("a" * 64))
    assert other.blobs.plan("a" * 64).read_bytes() == b"plan"
    assert one.blobs.checkpoints != other.blobs.checkpoints


def test_a_statement_on_the_wrong_side_is_refused_instead_of_finding_nothing(one: Store) -> None:
    with pytest.raises(WrongSideError, match="events"), one.read() as rows:
        history.last_seq(rows)
    with pytest.raises(WrongSideError, match="jobs"), one.read_cell() as rows:
        jobs.get(rows, "job")


def test_a_receiver_is_told_by_one_host_at_a_time_and_of_each_hosts_own_events(one: Store, other: Store) -> None:
    with one.write() as rows:
        hook, _ = webhooks.create(rows, "http://receiver/", ("cell.alarm",), 10.0, "ada", 0)
    for store, text in ((one, "of one"), (other, "of the other")):
        with store.write_cell() as rows:
            rows.execute(insert(events).values(at=9.0, kind="alarm", text="before it was added"))
            rows.execute(insert(events).values(at=11.0, kind="alarm", text=text))
    with one.write() as rows:
        assert webhooks.take(rows, hook.id, 20.0, 50.0) is not None
    with other.write() as rows:
        assert webhooks.take(rows, hook.id, 30.0, 60.0) is None
        assert webhooks.take(rows, hook.id, 50.0, 80.0) is not None  # the first one died
    for store, text in ((one, "of one"), (other, "of the other")):
        with store.read() as rows, store.read_cell() as cell_rows:
            place = webhooks.event_place(cell_rows, hook, store.is_shared)
            found = webhooks.letters(rows, cell_rows, hook, place, 9, text)
        assert [(letter.id, letter.data["text"]) for letter in found] == [(f"event-{text}-2", text)]


def test_text_is_ordered_found_and_told_apart_alike_wherever_it_lies(store: Store, one: Store) -> None:
    from cellctl.store import users
    from cellctl.store.job_search import Asked, find
    from cellctl.store.tokens import Role

    told = []
    for each in (store, one):
        part_id = part_in(each)
        for name in ("Wall 10%", "wall_2", "WALL-x", "other"):
            job_in(each, part_id, name)
        with each.write() as rows:
            for name in ("b.a", "a-b", "ab", "a_c", "a.b"):
                users.create(rows, name, Role.VIEWER, "hash", 1.0)
        with each.read() as rows:
            found = [[job.name for job in find(rows, Asked(text=text), "newest", None, 9)[0]] for text in ("wall", "WALL", "%", "_2")]
            told.append((found, [user.name for user in users.every(rows)]))
    assert told[0] == told[1]
    assert told[0][0] == [["WALL-x", "wall_2", "Wall 10%"], ["WALL-x", "wall_2", "Wall 10%"], ["Wall 10%"], ["wall_2"]]


def test_set_up_is_kept_for_its_owner_alone_and_again_is_harmless(tmp_path: Path) -> None:
    (tmp_path / "url").write_text(f"postgresql://cells:{SECRET}@db.shop/cells\n")
    named = Wanted(f"@{tmp_path / 'url'}", tmp_path / "files")
    share(tmp_path / "store", named)
    share(tmp_path / "store", named)
    kept = shared_of(tmp_path / "store")
    assert kept is not None and kept.database.password == SECRET and kept.files == tmp_path / "files"
    assert stat.S_IMODE(os.stat(tmp_path / "store" / "shared.toml").st_mode) == 0o600
    with pytest.raises(StoreError, match="already") as refused:
        share(tmp_path / "store", Wanted("postgresql://db.shop/other", tmp_path / "files"))
    assert SECRET not in refused.value.message + refused.value.hint


@pytest.mark.parametrize(
    ("word", "line"),
    [
        ("mysql://db.shop/cells", "only PostgreSQL"), ("postgresql://db.shop", "names no database"), ("a word", "no URL"),
        (f"postgresql://cells:{SECRET}@db.shop/cells", "would be seen"), ("@/nowhere/url", "cannot be read"),
        ("postgresql://db.shop/cells?options=-c%20fsync%3Doff", "options"),
    ],
)  # fmt: skip
def test_what_is_no_database_to_share_is_refused_in_one_line(word: str, line: str) -> None:
    with pytest.raises(StoreError, match=line) as refused:
        told_url(word)
    told = refused.value.message + refused.value.hint
    assert "\n" not in told and SECRET not in told and refused.value.hint


def test_store_with_jobs_of_its_own_is_not_shared(store: Store, tmp_path: Path) -> None:
    job_in(store, part_in(store))
    with pytest.raises(StoreError, match=r"store of its own already .*jobs: 1") as refused:
        share(store.folder, Wanted("postgresql://db.shop/cells", tmp_path / "files"))
    assert "--store" in refused.value.hint and not (store.folder / "shared.toml").exists()


def test_shared_database_that_cannot_be_reached_is_told_in_one_line_at_the_start(tmp_path: Path) -> None:
    share(tmp_path / "store", Wanted("postgresql://127.0.0.1:1/cells", tmp_path / "files"))
    with pytest.raises(StoreError, match="refused") as caught:
        upgrade(tmp_path / "store")
    assert "\n" not in caught.value.message and "PostgreSQL runs" in caught.value.hint


def test_backup_of_a_host_holds_what_is_its_own_and_tells_what_is_not_in_it(one: Store, tmp_path: Path) -> None:
    with one.write_cell() as rows:
        rows.execute(insert(events).values(at=1.0, kind="alarm", text="the door is open"))
    one.blobs.plan("a" * 64).write_bytes(b"plan")
    made = back_up(one.folder, tmp_path / "host.tar", 1.0)
    assert made.files == 1 and "pg_dump" in made.not_in_it and str(tmp_path / "files") in made.not_in_it
    restore(tmp_path / "host.tar", tmp_path / "again")
    share(tmp_path / "again", Wanted(f"@{tmp_path / 'shared.url'}", tmp_path / "files"))
    upgrade(tmp_path / "again")
    again = open_store(tmp_path / "again")
    with again.read_cell() as rows:
        assert [event.text for event in history.events_after(rows, 0)] == ["the door is open"]
    again.close()


def test_reads_and_writes_of_a_store_recover_when_the_server_is_back(one: Store, postgres: Cluster) -> None:
    from sqlalchemy.exc import DBAPIError

    from cellctl.domain.trouble import trouble_of

    job: JobRow = job_in(one, part_in(one))
    postgres.stop()
    try:
        for side in (one.read, one.write):
            with pytest.raises(DBAPIError) as caught, side() as rows:
                jobs.get(rows, job.id)
            trouble = trouble_of(caught.value)
            assert trouble is not None and trouble.status == 503 and trouble.hint
        with one.write_cell() as rows:
            rows.execute(insert(events).values(at=1.0, kind="state", text="RUNNING"))
    finally:
        postgres.start()
    with one.read() as rows:
        assert jobs.get(rows, job.id) == job
