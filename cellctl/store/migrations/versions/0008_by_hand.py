"""What was measured at the machine: placements and tools.

Revision ID: 0008
Revises: 0007
"""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None
REAL: sa.types.TypeEngine[float] = sa.Double().with_variant(sa.REAL(), "sqlite")


def upgrade() -> None:
    """Add the versions of what was measured; a cell process of this version may have made the table already."""
    if sa.inspect(op.get_bind()).has_table("measured"):
        op.drop_table("measured")
    op.create_table(
        "measured",
        sa.Column("seq", sa.Integer(), primary_key=True, autoincrement=True),
        sa.Column("cell", sa.Text(), nullable=False),
        sa.Column("at", REAL, nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("because", sa.Text(), nullable=False, server_default=""),
        sa.Column("what", sa.Text(), nullable=False, server_default=""),
        sa.Column("document", sa.Text(), nullable=False),
        sa.Column("points", sa.Text(), nullable=False, server_default="{}"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_measured_cell", "measured", ["cell", "seq"])


def downgrade() -> None:
    """Drop them again."""
    op.drop_index("ix_measured_cell", "measured")
    op.drop_table("measured")
