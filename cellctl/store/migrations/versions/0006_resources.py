"""Uploads that can be resumed; versions of materials and cells, and which of them a job is made with; the order of changes to jobs.

Revision ID: 0006
Revises: 0005
"""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None
BIG = sa.BigInteger().with_variant(sa.Integer, "sqlite")
REAL: sa.types.TypeEngine[float] = sa.Double().with_variant(sa.REAL(), "sqlite")


def upgrade() -> None:
    """Add tables and columns."""
    op.create_table(
        "uploads",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("filename", sa.Text(), nullable=False),
        sa.Column("units", sa.String(8), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False, server_default=""),
        sa.Column("bytes", BIG, nullable=False),
        sa.Column("received", BIG, nullable=False, server_default="0"),
        sa.Column("created_at", REAL, nullable=False),
        sa.Column("touched_at", REAL, nullable=False),
        sa.Column("part_id", sa.String(40)),
    )
    op.create_table(
        "material_versions",
        sa.Column("seq", BIG, primary_key=True, autoincrement=True),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("toml", sa.Text(), nullable=False),
        sa.Column("because", sa.Text(), nullable=False, server_default=""),
        sa.Column("created_at", REAL, nullable=False),
        sa.Column("created_by", sa.Text(), nullable=False),
        sa.UniqueConstraint("name", "version", name="uq_material_versions_name"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "cell_versions",
        sa.Column("seq", BIG, primary_key=True, autoincrement=True),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("facts", sa.Text(), nullable=False),
        sa.Column("file", sa.Text(), nullable=False, server_default=""),
        sa.Column("first_seen_at", REAL, nullable=False),
        sa.Column("last_seen_at", REAL, nullable=False),
        sa.Column("starts", sa.Integer(), nullable=False, server_default="1"),
        sa.UniqueConstraint("name", "version", name="uq_cell_versions_name"),
        sqlite_autoincrement=True,
    )
    op.add_column("jobs", sa.Column("material_sha256", sa.String(64), nullable=False, server_default=""))
    op.add_column("jobs", sa.Column("cell_sha256", sa.String(64), nullable=False, server_default=""))
    op.add_column("jobs", sa.Column("changed", BIG, nullable=False, server_default="0"))
    op.create_index("ix_jobs_changed", "jobs", ["changed"])


def downgrade() -> None:
    """Drop them again."""
    op.drop_index("ix_jobs_changed", "jobs")
    for name in ("changed", "cell_sha256", "material_sha256"):
        op.drop_column("jobs", name)
    for name in ("cell_versions", "material_versions", "uploads"):
        op.drop_table(name)
