"""Who vouched for the table before a job, and at which client: its start acts for that client.

Revision ID: 0003
Revises: 0002
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None
COLUMNS = ("confirmed_by", "confirmed_client")


def upgrade() -> None:
    """Add who looked, and where."""
    for name in COLUMNS:
        op.add_column("jobs", sa.Column(name, sa.Text(), nullable=False, server_default=""))


def downgrade() -> None:
    """Drop it again."""
    for name in COLUMNS:
        op.drop_column("jobs", name)
