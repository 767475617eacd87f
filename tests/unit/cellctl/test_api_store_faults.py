"""A disk or store that refuses, as a client of REST is told; commands to the cell do not wait for the audit trail."""

from __future__ import annotations

import asyncio
import errno
import sqlite3

import pytest
from sqlalchemy import event

from cellctl.api.deeds import Deeds
from cellctl.domain.trouble import trouble_of
from cellctl.store import audit
from cellctl.store.audit import Deed
from tests.unit.cellctl.conftest import Web


def make_full(web: Web) -> None:
    """No page more for the store from now on."""
    engine = web.service.store.engine

    @event.listens_for(engine, "begin")
    def _full(connection: object) -> None:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar_one()  # type: ignore[attr-defined]
        connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")  # type: ignore[attr-defined]


async def test_full_store_answers_507_with_what_to_do_and_reads_go_on(web: Web) -> None:
    make_full(web)
    answers = [await web.admin.post("/api/v1/tokens", json={"name": f"t{k} {'x' * 60}", "role": "viewer"}) for k in range(120)]
    refused = next(answer for answer in answers if answer.status_code >= 500)
    assert refused.status_code == 507 and refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["title"] == "The disk is full" and "make room" in refused.json()["hint"]
    assert (await web.admin.get("/api/v1/jobs")).status_code == 200


async def test_deed_that_a_locked_store_does_not_take_keeps_no_answer_waiting_and_is_written_later(web: Web) -> None:
    store, deeds = web.service.store, Deeds()
    with sqlite3.connect(store.folder / "store.db", isolation_level=None) as other:
        other.execute("BEGIN EXCLUSIVE")
        async with asyncio.timeout(8.0):
            await deeds.note(store, Deed("me", "operator", "here", "stop", "cell", "test"), "ok")
        assert deeds.waiting == 1
        other.execute("ROLLBACK")
    other.close()
    async with asyncio.timeout(30.0):
        while deeds.waiting:
            await asyncio.sleep(0.01)
    with store.read() as rows:
        assert [one["verb"] for one in audit.of_target(rows, "cell")] == ["stop"]


@pytest.mark.parametrize(
    ("error", "title", "status"),
    [
        (sqlite3.OperationalError("database is locked"), "The store is locked", 503),
        (sqlite3.OperationalError("attempt to write a readonly database"), "The store is read-only", 503),
        (sqlite3.OperationalError("database or disk is full"), "The disk is full", 507),
        (OSError(errno.ENOSPC, "No space left on device"), "The disk is full", 507),
        (OSError("Can't write data (file write failed: No space left on device)"), "The disk is full", 507),
        (OSError(errno.EROFS, "Read-only file system"), "The disk is read-only", 503),
    ],
)
def test_what_a_disk_refuses_is_told_by_its_own_words(error: Exception, title: str, status: int) -> None:
    found = trouble_of(error)
    assert found is not None and (found.title, found.status) == (title, status) and found.hint


def test_other_errors_are_no_trouble_of_the_disk() -> None:
    assert trouble_of(ValueError("no")) is None and trouble_of(ConnectionResetError(errno.ECONNRESET, "reset")) is None
