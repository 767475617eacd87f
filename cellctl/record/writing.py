"""What a worker does for a record: gather, write, and seal if that is asked for."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sqlalchemy import Connection

from cellctl.planning.task import Task
from cellctl.record.gather import record_of
from cellctl.record.layout import DOCUMENT, PAGE, PROOF, PROOF_PAGE, RECIPE, SAMPLES
from cellctl.record.page import html_of
from cellctl.record.samples import write_parquet
from cellctl.record.seal import open_seal, verify
from cellctl.store import Store, jobs, open_store


def record(task: Task, progress: Callable[[str, float], None]) -> dict[str, Any]:
    """The stage: {samples, manifest_sha256}, the latter empty of a record that is not sealed. Raises NotFoundError, SealError."""
    store, folder = open_store(Path(task.store)), Path(task.folder)
    try:
        progress("gathering", 0.0)
        with store.read() as connection, store.read_cell() as cell_rows:
            document = write_record(store, connection, cell_rows, task.job, folder)
        if task.sealed_at == 0.0:
            return {"samples": document["samples"], "manifest_sha256": ""}
        seal = open_seal(store.folder)
        manifest = seal.close(folder, {"job": task.job, "sealed_at": task.sealed_at, "schema": document["schema"]})
        verify(folder, seal.public_pem)  # what cannot be verified here would be of no use to anybody
        return {"samples": document["samples"], "manifest_sha256": manifest}
    finally:
        store.close()


def write_record(store: Store, connection: Connection, cell_rows: Connection, job_id: str, folder: Path) -> dict[str, Any]:
    """Samples, document, page, recipe and, where there is one, proof into an empty folder; the document. Raises NotFoundError."""
    document = record_of(connection, cell_rows, job_id)
    job = jobs.get(connection, job_id)
    write_parquet(cell_rows, job_id, folder / SAMPLES)
    (folder / RECIPE).write_text(job.recipe_toml, encoding="utf-8")
    (folder / DOCUMENT).write_text(json.dumps(document, indent=1, ensure_ascii=False), encoding="utf-8")
    picture = None
    if job.proof_sha256 is not None:
        shown = store.blobs.picture(job.proof_sha256)
        picture = shown.read_bytes() if shown.is_file() else None
        for name, kept in ((PROOF, store.blobs.proof(job.proof_sha256)), (PROOF_PAGE, store.blobs.report(job.proof_sha256))):
            if kept.is_file():
                (folder / name).write_bytes(kept.read_bytes())
    (folder / PAGE).write_text(html_of(document, folder / SAMPLES, picture), encoding="utf-8")
    return document
