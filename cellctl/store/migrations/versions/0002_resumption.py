"""Jobs that go on with the part of an interrupted one.

Revision ID: 0002
Revises: 0001
"""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add what such a job is made from."""
    op.add_column("jobs", sa.Column("continues_job", sa.String(40), nullable=True))
    op.add_column("jobs", sa.Column("resume_point", sa.Text(), nullable=True))
    op.add_column("jobs", sa.Column("resumption", sa.Text(), nullable=True))
    op.create_index("ix_jobs_continues_job", "jobs", ["continues_job"])


def downgrade() -> None:
    """Drop it again."""
    op.drop_index("ix_jobs_continues_job", "jobs")
    for name in ("resumption", "resume_point", "continues_job"):
        op.drop_column("jobs", name)
