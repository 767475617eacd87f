"""More figures in a sample, thinned levels of them, and indexes by time and kind, by which trends and alarms are found.

Revision ID: 0007
Revises: 0006
"""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None
BIG = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
REAL: sa.types.TypeEngine[float] = sa.Double().with_variant(sa.REAL(), "sqlite")
FIGURES = (
    *("carrier_gas_setpoint_l_min", "carrier_gas_readback_l_min", "shield_gas_setpoint_l_min", "shield_gas_readback_l_min"),
    *("tip_speed_mm_s", "planner_fill_percent", "rx_fill_percent", "tick_jitter_ms", "spindle_rpm"),
    *("feed_override_percent", "laser_override_percent", "powder_override_percent"),
)
INDEXES = (("ix_journal_at", "journal", ["at"]), ("ix_events_at", "events", ["at"]), ("ix_events_kind", "events", ["kind", "seq"]))


def upgrade() -> None:
    """Add the columns (null in older samples), the levels and the indexes."""
    for name in FIGURES:
        op.add_column("journal", sa.Column(name, REAL, nullable=True))
    op.add_column("journal", sa.Column("interlocks", sa.Integer(), nullable=True))
    op.create_table(
        "trend_levels",
        sa.Column("level_s", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("start_at", BIG, autoincrement=False, nullable=False),
        sa.Column("samples", sa.Integer(), nullable=False),
        sa.Column("last_id", BIG, nullable=False),
        sa.Column("figures", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("level_s", "start_at"),
    )
    for name, table, columns in INDEXES:
        op.create_index(name, table, columns)


def downgrade() -> None:
    """Drop them again."""
    for name, table, _columns in INDEXES:
        op.drop_index(name, table)
    op.drop_table("trend_levels")
    for name in (*FIGURES, "interlocks"):
        op.drop_column("journal", name)
