"""Several cells on one store: the cells, which cell a job was meant for, and the claim before a start.

Revision ID: 0011
Revises: 0010
"""

from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None
TIME: Any = sa.Double().with_variant(sa.REAL(), "sqlite")


def upgrade() -> None:
    """Add them; jobs that are there were meant for the cell that they have."""
    op.create_table(
        "fleet",
        sa.Column("cell", sa.String(200), primary_key=True),
        sa.Column("owner", sa.String(40), nullable=False, server_default=""),
        sa.Column("secret", sa.String(64), nullable=False, server_default=""),
        sa.Column("host_url", sa.Text(), nullable=False, server_default=""),
        sa.Column("stop_url", sa.Text(), nullable=False, server_default=""),
        sa.Column("software", sa.String(40), nullable=False, server_default=""),
        sa.Column("cell_sha256", sa.String(64), nullable=False, server_default=""),
        sa.Column("facts", sa.Text(), nullable=False, server_default="{}"),
        sa.Column("state", sa.String(32), nullable=False, server_default=""),
        sa.Column("doing", sa.Text(), nullable=False, server_default="{}"),
        sa.Column("heard_at", TIME, nullable=False, server_default="0"),
    )
    op.add_column("jobs", sa.Column("cell_wanted", sa.Text(), nullable=False, server_default=""))
    op.add_column("jobs", sa.Column("claimed_by", sa.String(40), nullable=False, server_default=""))
    op.add_column("jobs", sa.Column("claimed_at", TIME))
    op.execute("UPDATE jobs SET cell_wanted = cell")
    op.create_index("ix_jobs_cell", "jobs", ["cell", "state", "priority", "rank", "seq"])


def downgrade() -> None:
    """Drop them; a job for any cell that has none yet has nobody left who would take it."""
    op.drop_index("ix_jobs_cell", "jobs")
    for name in ("claimed_at", "claimed_by", "cell_wanted"):
        op.drop_column("jobs", name)
    op.drop_table("fleet")
