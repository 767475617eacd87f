"""Writes and seals the record of every job whose run has ended, once, and keeps it beside plans and proofs."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import structlog
from sqlalchemy import Connection, insert, select

from cellctl.domain.jobs import ENDED
from cellctl.domain.trouble import trouble_of
from cellctl.planning.process import WorkerError, Workers
from cellctl.planning.task import Task
from cellctl.record.layout import MANIFEST
from cellctl.store import Store, history
from cellctl.store.blobs import place
from cellctl.store.schema import jobs as job_table
from cellctl.store.schema import records

PERIOD_S = 2.0
SETTLE_S = 5.0  # behind the end of a run: what was told last is on the disk by then
AT_ONCE = 500  # jobs asked for in one statement
log = structlog.get_logger(__name__)


def _task(store: Store, job_id: str, folder: Path, sealed_at: float) -> Task:
    return Task(kind="record", folder=str(folder), parent=0, memory_bytes=0, store=str(store.folder), job=job_id, sealed_at=sealed_at)


def _quiet(_stage: str, _fraction: float) -> None:
    """Nobody looks how far it is."""


def _keep(store: Store, job_id: str, folder: Path, summary: dict[str, Any], now: float) -> None:
    """Files first, then the row: a row never names a missing folder."""
    place(folder, store.blobs.record(summary["manifest_sha256"]))
    with store.write() as connection:
        values = {"job": job_id, "manifest_sha256": summary["manifest_sha256"], "at": now, "samples": summary["samples"]}
        connection.execute(insert(records).values(values))


def sealed(store: Store, connection: Connection, job_id: str) -> Path | None:
    """The folder of a job's sealed record, None before it is sealed."""
    manifest = connection.execute(select(records.c.manifest_sha256).where(records.c.job == job_id)).scalar_one_or_none()
    return None if manifest is None else store.blobs.record(manifest)


def manifest_of(folder: Path) -> dict[str, Any]:
    """Of a sealed record: job, sealed_at, key, files."""
    document: dict[str, Any] = json.loads((folder / MANIFEST).read_bytes())
    return document


def standing_of(connection: Connection, ran: Sequence[str]) -> tuple[set[str], set[str]]:
    """Of jobs whose run has ended: those whose record is sealed, and those whose record is to be sealed."""
    is_sealed, is_due = set[str](), set[str]()
    for start in range(0, len(ran), AT_ONCE):
        some = list(ran[start : start + AT_ONCE])
        is_sealed |= set(connection.execute(select(records.c.job).where(records.c.job.in_(some))).scalars())
        ended = job_table.c.state.in_([state.value for state in ENDED])
        is_due |= set(connection.execute(select(job_table.c.id).where(job_table.c.id.in_(some), ended)).scalars())
    return is_sealed, is_due - is_sealed


class Keeping:
    """Call `run` as one task. workers : processes of low priority write the records, which can be large"""

    def __init__(self, store: Store, workers: Workers) -> None:
        self._store = store
        self._workers = workers
        self._sealing = asyncio.Lock()
        self._failed: dict[str, str] = {}  # job -> what was told of it, once
        self._sealed: set[str] = set()  # known of this cell's jobs: nothing is to be done for them any more

    async def run(self) -> None:
        """Look and seal, for ever. That the store refuses is told once."""
        told = ""
        while True:
            try:
                await self.seal_all()
                told = ""
            except Exception as error:
                trouble = trouble_of(error)
                if trouble is None:
                    log.exception("records")
                elif trouble.title != told:
                    log.error("records wait for the store", error=trouble.detail)
                    told = trouble.title
            await asyncio.sleep(PERIOD_S)

    async def write_now(self, job_id: str, folder: Path) -> None:
        """The files of a job's record as it stands now, into an empty folder. Raises WorkerError."""
        await self._workers.run(_task(self._store, job_id, folder, 0.0), _quiet)

    async def seal_all(self) -> None:
        """Seal what is to be sealed. What fails is told once and tried again."""
        async with self._sealing:
            for job_id in await asyncio.to_thread(self.waiting):
                try:
                    await self._seal(job_id)
                except (WorkerError, OSError) as error:
                    if self._failed.get(job_id) != str(error):
                        self._failed[job_id] = str(error)
                        log.error("record not sealed", job=job_id, error=str(error))

    async def _seal(self, job_id: str) -> None:
        """Write, sign and keep the record of a job."""
        store, now = self._store, self._store.clock()
        with store.blobs.staging() as staged:
            folder = staged / "record"
            folder.mkdir()
            summary = await self._workers.run(_task(store, job_id, folder, now), _quiet)
            await asyncio.to_thread(_keep, store, job_id, folder, summary, now)

    def waiting(self) -> list[str]:
        """Jobs whose run on this cell has ended, and whose record is still to be sealed; oldest first."""
        with self._store.read_cell() as cell_rows:
            ran = [job for job in history.ended_runs(cell_rows, self._store.clock() - SETTLE_S) if job not in self._sealed]
        if not ran:
            return []
        with self._store.read() as connection:
            is_sealed, is_due = standing_of(connection, ran)
        self._sealed |= is_sealed
        return [job for job in ran if job in is_due]
