"""Powder lots and signatures of records.

Revision ID: 0009
Revises: 0008
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

BIG = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL: sa.types.TypeEngine[float] = sa.Double().with_variant(sa.REAL(), "sqlite")


def upgrade() -> None:
    """Add what was loaded when, and which records were sealed."""
    op.create_table(
        "consumables",
        sa.Column("seq", BIG, primary_key=True, autoincrement=True),
        sa.Column("at", REAL, nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("lot", sa.Text(), nullable=False),
        sa.Column("material", sa.Text(), nullable=False, server_default=""),
        sa.Column("note", sa.Text(), nullable=False, server_default=""),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "records",
        sa.Column("job", sa.String(40), sa.ForeignKey("jobs.id"), primary_key=True),
        sa.Column("manifest_sha256", sa.String(64), nullable=False),
        sa.Column("at", REAL, nullable=False),
        sa.Column("samples", BIG, nullable=False),
    )


def downgrade() -> None:
    """Drop both; sealed records stay as files."""
    op.drop_table("records")
    op.drop_table("consumables")
