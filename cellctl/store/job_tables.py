"""The tables around jobs: their steps, tags, notes, attachments and dependencies, their order's version, their counts, and what lies on the table."""

from __future__ import annotations

from sqlalchemy import Column, ForeignKey, Index, PrimaryKeyConstraint, String, Table, Text

from cellctl.store.schema import BigInt, Real, metadata


def _job(name: str = "job_id") -> Column[str]:
    return Column(name, String(40), ForeignKey("jobs.id"), nullable=False)


job_steps = Table(
    "job_steps",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    _job(),
    Column("at", Real, nullable=False),
    Column("left", String(32), nullable=False),
    Column("state", String(32), nullable=False),
    Column("why", Text, nullable=False),
    Column("who", Text, nullable=False, server_default=""),
    Index("ix_job_steps_job", "job_id", "seq"),
    sqlite_autoincrement=True,
)

job_tags = Table(
    "job_tags",
    metadata,
    Column("tag", String(40), nullable=False),
    _job(),
    PrimaryKeyConstraint("tag", "job_id"),
    Index("ix_job_tags_job", "job_id"),
)

job_notes = Table(
    "job_notes",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    _job(),
    Column("at", Real, nullable=False),
    Column("who", Text, nullable=False),
    Column("text", Text, nullable=False),
    Index("ix_job_notes_job", "job_id", "seq"),
    sqlite_autoincrement=True,
)

job_attachments = Table(
    "job_attachments",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    Column("id", String(40), nullable=False, unique=True),
    _job(),
    Column("at", Real, nullable=False),
    Column("who", Text, nullable=False),
    Column("name", Text, nullable=False),
    Column("kind", String(40), nullable=False),
    Column("bytes", BigInt, nullable=False),
    Column("sha256", String(64), nullable=False),
    Index("ix_job_attachments_job", "job_id", "seq"),
    sqlite_autoincrement=True,
)

job_dependencies = Table(
    "job_dependencies",
    metadata,
    _job(),
    _job("on_job"),
    Column("until", String(16), nullable=False),
    PrimaryKeyConstraint("job_id", "on_job", "until"),
    Index("ix_job_dependencies_on", "on_job"),
)

job_counts = Table(
    "job_counts",
    metadata,
    Column("state", String(32), primary_key=True),
    Column("count", BigInt, nullable=False),
)

queue_versions = Table(
    "queue_versions",
    metadata,
    Column("lane", String(16), primary_key=True),
    Column("version", BigInt, nullable=False),
)

cell_tables = Table(
    "cell_tables",
    metadata,
    Column("cell", String(200), primary_key=True),
    Column("job_id", String(40), nullable=False, server_default=""),
    Column("since", Real, nullable=False, server_default="0"),
    Column("cleared_at", Real),
    Column("cleared_by", Text, nullable=False, server_default=""),
    Column("because", Text, nullable=False, server_default=""),
)
