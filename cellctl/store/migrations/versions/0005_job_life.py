"""Order, dependencies, tags, notes, attachments and re-runs of jobs; who confirmed the table clear.

Revision ID: 0005
Revises: 0004
"""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None
BIG = sa.BigInteger().with_variant(sa.Integer, "sqlite")
REAL: sa.types.TypeEngine[float] = sa.Double().with_variant(sa.REAL(), "sqlite")
RANK_GAP = 2**20
COLUMNS: tuple[tuple[str, Any, dict[str, Any]], ...] = (
    ("priority", sa.Integer(), {"nullable": False, "server_default": "5"}),
    ("rank", BIG, {"nullable": False, "server_default": "0"}),
    ("not_before", REAL, {}),
    ("tags", sa.Text(), {"nullable": False, "server_default": "[]"}),
    ("made_from", sa.String(40), {}),
    ("made_how", sa.String(16), {"nullable": False, "server_default": ""}),
    ("changes", sa.Text(), {}),
    ("cleared_at", REAL, {}),
)
INDEXES = (
    ("ix_jobs_queue", "jobs", ["state", "priority", "rank", "seq"]),
    ("ix_jobs_rank", "jobs", ["rank"]),
    ("ix_jobs_confirmed", "jobs", ["state", "table_clear"]),
    ("ix_jobs_part", "jobs", ["part_id"]),
    ("ix_cell_runs_started", "cell_runs", ["started_at"]),
)
TABLES = ("job_steps", "job_tags", "job_notes", "job_attachments", "job_dependencies", "job_counts", "queue_versions", "cell_tables")


def _job(name: str = "job_id") -> sa.Column[Any]:
    return sa.Column(name, sa.String(40), sa.ForeignKey("jobs.id"), nullable=False)


def _numbered(name: str, *columns: sa.Column[Any]) -> None:
    """A table whose rows come in the order of `seq`, found by their job."""
    seq = sa.Column("seq", BIG, primary_key=True, autoincrement=True)
    op.create_table(name, seq, *columns, sqlite_autoincrement=True)
    op.create_index(f"ix_{name}_job", name, ["job_id", "seq"])


def _at() -> sa.Column[Any]:
    return sa.Column("at", REAL, nullable=False)


def _who() -> sa.Column[Any]:
    return sa.Column("who", sa.Text(), nullable=False)


def _threads() -> None:
    _numbered(
        "job_steps", _job(), _at(), sa.Column("left", sa.String(32), nullable=False), sa.Column("state", sa.String(32), nullable=False),
        sa.Column("why", sa.Text(), nullable=False), sa.Column("who", sa.Text(), nullable=False, server_default=""),
    )  # fmt: skip
    _numbered("job_notes", _job(), _at(), _who(), sa.Column("text", sa.Text(), nullable=False))
    _numbered(
        "job_attachments", sa.Column("id", sa.String(40), nullable=False, unique=True), _job(), _at(), _who(),
        sa.Column("name", sa.Text(), nullable=False), sa.Column("kind", sa.String(40), nullable=False),
        sa.Column("bytes", BIG, nullable=False), sa.Column("sha256", sa.String(64), nullable=False),
    )  # fmt: skip


def _links() -> None:
    op.create_table("job_tags", sa.Column("tag", sa.String(40), nullable=False), _job(), sa.PrimaryKeyConstraint("tag", "job_id"))
    op.create_index("ix_job_tags_job", "job_tags", ["job_id"])
    until = sa.Column("until", sa.String(16), nullable=False)
    op.create_table("job_dependencies", _job(), _job("on_job"), until, sa.PrimaryKeyConstraint("job_id", "on_job", "until"))
    op.create_index("ix_job_dependencies_on", "job_dependencies", ["on_job"])


def _standings() -> None:
    op.create_table("job_counts", sa.Column("state", sa.String(32), primary_key=True), sa.Column("count", BIG, nullable=False))
    op.create_table("queue_versions", sa.Column("lane", sa.String(16), primary_key=True), sa.Column("version", BIG, nullable=False))
    op.create_table(
        "cell_tables",
        sa.Column("cell", sa.String(200), primary_key=True),
        sa.Column("job_id", sa.String(40), nullable=False, server_default=""),
        sa.Column("since", REAL, nullable=False, server_default="0"),
        sa.Column("cleared_at", REAL),
        sa.Column("cleared_by", sa.Text(), nullable=False, server_default=""),
        sa.Column("because", sa.Text(), nullable=False, server_default=""),
    )


def upgrade() -> None:
    """Add it all; jobs that are there keep the order of their submission."""
    for name, kind, options in COLUMNS:
        op.add_column("jobs", sa.Column(name, kind, **options))
    op.execute(f"UPDATE jobs SET rank = seq * {RANK_GAP}")
    for name, table, columns in INDEXES:
        op.create_index(name, table, columns)
    _threads()
    _links()
    _standings()
    op.execute("INSERT INTO job_counts (state, count) SELECT state, count(*) FROM jobs GROUP BY state")


def downgrade() -> None:
    """Drop it again."""
    for name in reversed(TABLES):
        op.drop_table(name)
    for name, table, _columns in INDEXES:
        op.drop_index(name, table)
    for name, _kind, _options in COLUMNS:
        op.drop_column("jobs", name)
