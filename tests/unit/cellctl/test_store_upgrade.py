"""A store of the first version is brought up to date with what is in it, in a file and on a server."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import URL, Engine, text

import cellctl.store
from cellctl.domain.jobs import JobState
from cellctl.store import Store, audit, jobs
from cellctl.store.blobs import Blobs
from cellctl.store.engine import DATABASE, migrate, open_engine
from cellctl.store.postgres import open_postgres
from cellctl.store.schema import metadata
from tests.postgres import Cluster

PART = ("part-1", "block", ".stl", "mm", "f" * 64, "m" * 64, 684, "[[0,0,0],[1,1,1]]", 12, 1.0, "[]", 1.0, "me")
PART_COLUMNS = "id, name, suffix, units, sha256, mesh_sha256, bytes, bbox_mm, facets, volume_mm3, findings, created_at, created_by"
JOB = ("job-1", "block", "part-1", "cell", "", "316L", "interrupted", 2.0, "me")
JOB_COLUMNS = "id, name, part_id, cell, recipe_toml, material, state, created_at, created_by"


AUDIT = (1.5, "me", "operator", "here", "start", "job-1", "because", "ok")
AUDIT_COLUMNS = "at, who, role, origin, verb, target, because, outcome"


@pytest.fixture(params=["sqlite", "postgresql"])
def engine(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Engine]:
    """Of a database with nothing in it."""
    if request.param == "sqlite":
        opened = open_engine(tmp_path / DATABASE)
        yield opened
        opened.dispose()
        return
    cluster: Cluster = request.getfixturevalue("postgres")
    name = cluster.fresh("template0")
    opened = open_postgres(cluster.url(name))
    yield opened
    opened.dispose()
    cluster.drop(name)


def alembic(engine: Engine, revision: str) -> None:
    config = Config()
    config.set_main_option("script_location", str(Path(cellctl.store.__file__).parent / "migrations"))
    config.attributes["engine"] = engine
    command.upgrade(config, revision)


def test_jobs_of_the_first_version_are_there_after_the_upgrade_and_continue_nothing(engine: Engine, tmp_path: Path) -> None:
    alembic(engine, "0001")
    with engine.begin() as rows:
        for table, columns, values in (("parts", PART_COLUMNS, PART), ("jobs", JOB_COLUMNS, JOB), ("audit", AUDIT_COLUMNS, AUDIT)):
            names = columns.split(", ")
            rows.execute(text(f"INSERT INTO {table} ({columns}) VALUES (:{', :'.join(names)})"), dict(zip(names, values, strict=True)))
    migrate(engine, "a store of the first version")
    store = Store(tmp_path, engine, engine, Blobs(tmp_path))
    with store.read() as rows:
        job = jobs.get(rows, "job-1")
        assert (audit.verify(rows).rows, audit.verify(rows).fault) == (1, "")
    with engine.connect() as rows:
        assert compare_metadata(MigrationContext.configure(rows), metadata) == []
    assert (job.name, job.state, job.created_at, job.cell_wanted) == ("block", JobState.INTERRUPTED, 2.0, "cell")
    assert (job.continues_job, job.resume_point, job.resumption) == (None, None, None)


def make_tables(url: URL) -> bool:
    """As a host does at its start; whether they are the schema's."""
    opened = open_postgres(url)
    migrate(opened, "the store")
    with opened.connect() as rows:
        same = compare_metadata(MigrationContext.configure(rows), metadata) == []
    opened.dispose()
    return same


def test_two_hosts_that_make_the_tables_at_once_both_find_them(postgres: Cluster) -> None:
    name = postgres.fresh("template0")
    with ProcessPoolExecutor(2, mp_context=get_context("fork")) as hosts:
        assert list(hosts.map(make_tables, [postgres.url(name)] * 2)) == [True, True]
    postgres.drop(name)
