"""A store of the first version is brought up to date with what is in it."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from alembic import command
from alembic.config import Config

import cellctl.store
from cellctl.domain.jobs import JobState
from cellctl.store import jobs, open_store, upgrade
from cellctl.store.engine import DATABASE, open_engine

PART = ("part-1", "block", ".stl", "mm", "f" * 64, "m" * 64, 684, "[[0,0,0],[1,1,1]]", 12, 1.0, "[]", 1.0, "me")
PART_COLUMNS = "id, name, suffix, units, sha256, mesh_sha256, bytes, bbox_mm, facets, volume_mm3, findings, created_at, created_by"
JOB = ("job-1", "block", "part-1", "cell", "", "316L", "interrupted", 2.0, "me")
JOB_COLUMNS = "id, name, part_id, cell, recipe_toml, material, state, created_at, created_by"


def test_jobs_of_the_first_version_are_there_after_the_upgrade_and_continue_nothing(tmp_path: Path) -> None:
    upgrade(tmp_path)  # makes the folders
    (tmp_path / DATABASE).unlink()
    config = Config()
    config.set_main_option("script_location", str(Path(cellctl.store.__file__).parent / "migrations"))
    config.attributes["engine"] = engine = open_engine(tmp_path / DATABASE)
    command.upgrade(config, "0001")
    engine.dispose()
    with closing(sqlite3.connect(tmp_path / DATABASE)) as db, db:
        db.execute(f"INSERT INTO parts ({PART_COLUMNS}) VALUES ({', '.join('?' * len(PART))})", PART)
        db.execute(f"INSERT INTO jobs ({JOB_COLUMNS}) VALUES ({', '.join('?' * len(JOB))})", JOB)
    upgrade(tmp_path)
    store = open_store(tmp_path)
    try:
        with store.read() as rows:
            job = jobs.get(rows, "job-1")
    finally:
        store.close()
    assert (job.name, job.state, job.created_at) == ("block", JobState.INTERRUPTED, 2.0)
    assert (job.continues_job, job.resume_point, job.resumption) == (None, None, None)
