"""What a store that is shared needs: how far webhooks were told of the events of each host; answers to requests are found by their age.

Revision ID: 0012
Revises: 0011
"""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None
BIG = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    """Add both; what was told so far stays told."""
    op.create_table("hook_places", sa.Column("hook", sa.String(40), primary_key=True), sa.Column("event_seq", BIG, nullable=False))
    op.execute("INSERT INTO hook_places (hook, event_seq) SELECT id, event_seq FROM webhooks")
    op.create_index("ix_idempotency_created", "idempotency", ["created_at"])


def downgrade() -> None:
    """Drop them again; receivers go on from where they stood."""
    op.drop_index("ix_idempotency_created", "idempotency")
    op.execute("UPDATE webhooks SET event_seq = coalesce((SELECT event_seq FROM hook_places WHERE hook = id), event_seq)")
    op.drop_table("hook_places")
