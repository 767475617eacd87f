"""The certificate by which a cell's host is known to the others.

Revision ID: 0013
Revises: 0012
"""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add it; hosts tell theirs with the next heartbeat."""
    op.add_column("fleet", sa.Column("certificate", sa.Text(), nullable=False, server_default=""))


def downgrade() -> None:
    """Drop it."""
    op.drop_column("fleet", "certificate")
