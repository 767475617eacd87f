"""Webhooks, and how far each was told.

Revision ID: 0010
Revises: 0009
"""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

BIG = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL: sa.types.TypeEngine[float] = sa.Double().with_variant(sa.REAL(), "sqlite")


def upgrade() -> None:
    """Add the receivers."""
    op.create_table(
        "webhooks",
        sa.Column("id", sa.String(40), primary_key=True),
        sa.Column("url", sa.Text(), nullable=False),
        sa.Column("topics", sa.Text(), nullable=False),
        sa.Column("secret", sa.Text(), nullable=False),
        sa.Column("created_at", REAL, nullable=False),
        sa.Column("created_by", sa.Text(), nullable=False),
        sa.Column("step_seq", BIG, nullable=False, server_default="0"),
        sa.Column("event_seq", BIG, nullable=False, server_default="0"),
        sa.Column("delivered_at", REAL),
        sa.Column("failing_since", REAL),
        sa.Column("failures", sa.Integer(), nullable=False, server_default="0"),
        sa.Column("next_at", REAL, nullable=False, server_default="0"),
        sa.Column("last_error", sa.Text(), nullable=False, server_default=""),
        sa.Column("paused", sa.Text(), nullable=False, server_default=""),
    )


def downgrade() -> None:
    """Drop them."""
    op.drop_table("webhooks")
