"""Users with passwords, scopes of tokens, sessions of either, throttled sign-in, an audit trail that only grows.

Revision ID: 0004
Revises: 0003
"""

import hashlib
import json

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None
REAL: sa.types.TypeEngine[float] = sa.Double().with_variant(sa.REAL(), "sqlite")

HASHED = ("at", "who", "role", "origin", "verb", "target", "because", "outcome")
SQLITE_GUARDS = {
    "audit_no_update": "BEFORE UPDATE ON audit BEGIN SELECT RAISE(ABORT, 'the audit trail only grows'); END",
    "audit_no_delete": "BEFORE DELETE ON audit BEGIN SELECT RAISE(ABORT, 'the audit trail only grows'); END",
    "audit_no_replace": (
        "BEFORE INSERT ON audit WHEN EXISTS (SELECT 1 FROM audit WHERE seq = NEW.seq) "
        "BEGIN SELECT RAISE(ABORT, 'the audit trail only grows'); END"
    ),
}
POSTGRES_REFUSE = (
    "CREATE FUNCTION audit_refuse() RETURNS trigger AS $$ "
    "BEGIN RAISE EXCEPTION 'the audit trail only grows'; END $$ LANGUAGE plpgsql"
)
POSTGRES_GUARDS = (
    "CREATE TRIGGER audit_no_change BEFORE UPDATE OR DELETE ON audit FOR EACH ROW EXECUTE FUNCTION audit_refuse()",
    "CREATE TRIGGER audit_no_truncate BEFORE TRUNCATE ON audit FOR EACH STATEMENT EXECUTE FUNCTION audit_refuse()",
)


def upgrade() -> None:
    """Make the tables; sessions of before end; rows of the trail that are there get their hashes."""
    op.create_table(
        "users",
        sa.Column("id", sa.String(length=40), nullable=False),
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("role", sa.String(length=16), nullable=False),
        sa.Column("password_hash", sa.Text(), nullable=False),
        sa.Column("created_at", REAL, nullable=False),
        sa.Column("password_at", REAL, nullable=False),
        sa.Column("disabled_at", REAL, nullable=True),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("name"),
    )
    op.create_table(
        "sign_in_tries",
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("failures", sa.Integer(), nullable=False),
        sa.Column("last_at", REAL, nullable=False),
        sa.Column("free_at", REAL, nullable=False),
        sa.PrimaryKeyConstraint("key"),
    )
    op.add_column("tokens", sa.Column("scopes", sa.Text(), nullable=False, server_default=""))
    op.drop_table("sessions")
    _sessions(sa.Column("user_id", sa.String(length=40), sa.ForeignKey("users.id"), nullable=True), nullable=True)
    op.add_column("audit", sa.Column("sha256", sa.String(length=64), nullable=False, server_default=""))
    _chain()
    _guard()


def downgrade() -> None:
    """As it was before; users, sessions and hashes are gone."""
    if op.get_bind().dialect.name == "postgresql":
        for name in ("audit_no_change", "audit_no_truncate"):
            op.execute(f"DROP TRIGGER {name} ON audit")
        op.execute("DROP FUNCTION audit_refuse()")
    else:
        for name in SQLITE_GUARDS:
            op.execute(f"DROP TRIGGER {name}")
    op.drop_column("audit", "sha256")
    op.drop_table("sessions")
    _sessions(nullable=False)
    op.drop_column("tokens", "scopes")
    op.drop_table("sign_in_tries")
    op.drop_table("users")


def _sessions(*more: sa.Column[str], nullable: bool) -> None:
    idle: list[sa.Column[float]] = [sa.Column("seen_at", REAL, nullable=False)] if more else []
    op.create_table(
        "sessions",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("token_id", sa.String(length=40), sa.ForeignKey("tokens.id"), nullable=nullable),
        *more,
        sa.Column("created_at", REAL, nullable=False),
        *idle,
        sa.Column("expires_at", REAL, nullable=False),
        sa.PrimaryKeyConstraint("sha256"),
    )


def _chain() -> None:
    """Hash every row with the one before it; as cellctl.store.audit does."""
    bind = op.get_bind()
    before = ""
    rows = bind.execute(sa.text(f"SELECT seq, {', '.join(HASHED)} FROM audit ORDER BY seq")).mappings().all()
    for row in rows:
        told = json.dumps([before, row["seq"], *(row[name] for name in HASHED)], ensure_ascii=True)
        before = hashlib.sha256(told.encode()).hexdigest()
        bind.execute(sa.text("UPDATE audit SET sha256 = :sha256 WHERE seq = :seq"), {"sha256": before, "seq": row["seq"]})


def _guard() -> None:
    if op.get_bind().dialect.name == "postgresql":
        for statement in (POSTGRES_REFUSE, *POSTGRES_GUARDS):
            op.execute(statement)
        return
    for name, body in SQLITE_GUARDS.items():
        op.execute(f"CREATE TRIGGER {name} {body}")
