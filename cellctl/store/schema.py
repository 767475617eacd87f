"""The tables. `migrations/` makes them; a test holds both against each other. Times are Unix seconds, documents are JSON text."""

from __future__ import annotations

from sqlalchemy import (
    REAL,
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.types import TypeEngine

metadata = MetaData()

BigInt = BigInteger().with_variant(Integer, "sqlite")
Real: TypeEngine[float] = Double().with_variant(REAL, "sqlite")  # eight bytes in both: PostgreSQL's REAL has four, too few for a time
NEXT_CHANGE = text("(SELECT coalesce(max(changed), 0) + 1 FROM jobs)")
"""Numbers every change to a job in the order in which changes are committed: whoever knows one asks for what came after it."""

parts = Table(
    "parts",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    Column("id", String(40), nullable=False, unique=True),
    Column("name", Text, nullable=False),
    Column("suffix", String(8), nullable=False),
    Column("units", String(8), nullable=False),
    Column("sha256", String(64), nullable=False),
    Column("mesh_sha256", String(64), nullable=False),
    Column("bytes", BigInt, nullable=False),
    Column("bbox_mm", Text, nullable=False),
    Column("facets", BigInt, nullable=False),
    Column("volume_mm3", Real, nullable=False),
    Column("findings", Text, nullable=False),
    Column("created_at", Real, nullable=False),
    Column("created_by", Text, nullable=False),
    sqlite_autoincrement=True,
)


def _made(name: str) -> Table:
    """What was made once of the same, by the key of what it was made from."""
    key, sha256 = Column("key", String(64), primary_key=True), Column("sha256", String(64), nullable=False)
    return Table(name, metadata, key, sha256, Column("summary", Text, nullable=False), Column("created_at", Real, nullable=False))


plans, programs, proofs = _made("plans"), _made("programs"), _made("proofs")

jobs = Table(
    "jobs",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    Column("id", String(40), nullable=False, unique=True),
    Column("name", Text, nullable=False),
    Column("part_id", String(40), ForeignKey("parts.id"), nullable=False),
    Column("cell", Text, nullable=False),
    Column("recipe_toml", Text, nullable=False),
    Column("material", Text, nullable=False),
    Column("state", String(32), nullable=False),
    Column("why", Text, nullable=False, server_default=""),
    Column("error", Text),
    Column("plan_sha256", String(64)),
    Column("program_sha256", String(64)),
    Column("proof_sha256", String(64)),
    Column("proof", Text),
    Column("layers", Integer, nullable=False, server_default="0"),
    Column("lines_total", Integer, nullable=False, server_default="0"),
    Column("lines_executed", Integer, nullable=False, server_default="0"),
    Column("duration_s", Real, nullable=False, server_default="0"),
    Column("approved_by", Text, nullable=False, server_default=""),
    Column("approve_because", Text, nullable=False, server_default=""),
    Column("override_reason", Text, nullable=False, server_default=""),
    Column("table_clear", Boolean, nullable=False, server_default="0"),
    Column("timestamps", Text, nullable=False, server_default="{}"),
    Column("created_at", Real, nullable=False),
    Column("created_by", Text, nullable=False),
    Column("continues_job", String(40)),
    Column("resume_point", Text),
    Column("resumption", Text),
    Column("confirmed_by", Text, nullable=False, server_default=""),
    Column("confirmed_client", Text, nullable=False, server_default=""),
    Column("material_sha256", String(64), nullable=False, server_default=""),
    Column("cell_sha256", String(64), nullable=False, server_default=""),
    Column("changed", BigInt, nullable=False, server_default="0", default=NEXT_CHANGE, onupdate=NEXT_CHANGE),
    Column("priority", Integer, nullable=False, server_default="5"),
    Column("rank", BigInt, nullable=False, server_default="0"),
    Column("not_before", Real),
    Column("tags", Text, nullable=False, server_default="[]"),
    Column("made_from", String(40)),
    Column("made_how", String(16), nullable=False, server_default=""),
    Column("changes", Text),
    Column("cleared_at", Real),
    Column("cell_wanted", Text, nullable=False, server_default=""),
    Column("claimed_by", String(40), nullable=False, server_default=""),
    Column("claimed_at", Real),
    Index("ix_jobs_state", "state"),
    Index("ix_jobs_continues_job", "continues_job"),
    Index("ix_jobs_changed", "changed"),
    Index("ix_jobs_queue", "state", "priority", "rank", "seq"),
    Index("ix_jobs_rank", "rank"),
    Index("ix_jobs_confirmed", "state", "table_clear"),
    Index("ix_jobs_part", "part_id"),
    Index("ix_jobs_cell", "cell", "state", "priority", "rank", "seq"),
    sqlite_autoincrement=True,
)

tokens = Table(
    "tokens",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("name", Text, nullable=False),
    Column("role", String(16), nullable=False),
    Column("sha256", String(64), nullable=False, unique=True),
    Column("created_at", Real, nullable=False),
    Column("expires_at", Real),
    Column("revoked_at", Real),
    Column("scopes", Text, nullable=False, server_default=""),
)

users = Table(
    "users",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("name", String(64), nullable=False, unique=True),
    Column("role", String(16), nullable=False),
    Column("password_hash", Text, nullable=False),
    Column("created_at", Real, nullable=False),
    Column("password_at", Real, nullable=False),
    Column("disabled_at", Real),
)

sessions = Table(
    "sessions",
    metadata,
    Column("sha256", String(64), primary_key=True),
    Column("token_id", String(40), ForeignKey("tokens.id")),
    Column("user_id", String(40), ForeignKey("users.id")),
    Column("created_at", Real, nullable=False),
    Column("seen_at", Real, nullable=False),
    Column("expires_at", Real, nullable=False),
)

# Failed sign-ins by account, by address, and by both; free_at: from when on the next one is looked at.
sign_in_tries = Table(
    "sign_in_tries",
    metadata,
    Column("key", String(200), primary_key=True),
    Column("failures", Integer, nullable=False),
    Column("last_at", Real, nullable=False),
    Column("free_at", Real, nullable=False),
)

# Triggers of the migration refuse every change of a row that is there.
audit = Table(
    "audit",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    Column("at", Real, nullable=False),
    Column("who", Text, nullable=False),
    Column("role", String(16), nullable=False),
    Column("origin", Text, nullable=False),
    Column("verb", Text, nullable=False),
    Column("target", Text, nullable=False),
    Column("because", Text, nullable=False),
    Column("outcome", Text, nullable=False),
    Column("sha256", String(64), nullable=False, server_default=""),
    Index("ix_audit_target", "target"),
    sqlite_autoincrement=True,
)

idempotency = Table(
    "idempotency",
    metadata,
    Column("who", Text, primary_key=True),
    Column("key", String(200), primary_key=True),
    Column("request_sha256", String(64), nullable=False),
    Column("answer", Text, nullable=False),
    Column("created_at", Real, nullable=False),
    Index("ix_idempotency_created", "created_at"),
)

uploads = Table(
    "uploads",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("who", Text, nullable=False),
    Column("filename", Text, nullable=False),
    Column("units", String(8), nullable=False),
    Column("sha256", String(64), nullable=False, server_default=""),
    Column("bytes", BigInt, nullable=False),
    Column("received", BigInt, nullable=False, server_default="0"),
    Column("created_at", Real, nullable=False),
    Column("touched_at", Real, nullable=False),
    Column("part_id", String(40)),
)

material_versions = Table(
    "material_versions",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    Column("name", Text, nullable=False),
    Column("version", Integer, nullable=False),
    Column("sha256", String(64), nullable=False),
    Column("toml", Text, nullable=False),
    Column("because", Text, nullable=False, server_default=""),
    Column("created_at", Real, nullable=False),
    Column("created_by", Text, nullable=False),
    UniqueConstraint("name", "version", name="uq_material_versions_name"),
    sqlite_autoincrement=True,
)

cell_versions = Table(
    "cell_versions",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    Column("name", Text, nullable=False),
    Column("version", Integer, nullable=False),
    Column("sha256", String(64), nullable=False),
    Column("facts", Text, nullable=False),
    Column("file", Text, nullable=False, server_default=""),
    Column("first_seen_at", Real, nullable=False),
    Column("last_seen_at", Real, nullable=False),
    Column("starts", Integer, nullable=False, server_default="1"),
    UniqueConstraint("name", "version", name="uq_cell_versions_name"),
    sqlite_autoincrement=True,
)

# Written by the cell process with plain SQL; read here.
measured = Table(
    "measured",
    metadata,
    Column("seq", Integer, primary_key=True, autoincrement=True),
    Column("cell", Text, nullable=False),
    Column("at", Real, nullable=False),
    Column("who", Text, nullable=False),
    Column("because", Text, nullable=False, server_default=""),
    Column("what", Text, nullable=False, server_default=""),
    Column("document", Text, nullable=False),
    Column("points", Text, nullable=False, server_default="{}"),
    Index("ix_measured_cell", "cell", "seq"),
    sqlite_autoincrement=True,
)

events = Table(
    "events",
    metadata,
    Column("seq", Integer, primary_key=True, autoincrement=True),
    Column("at", Real, nullable=False),
    Column("kind", Text, nullable=False),
    Column("text", Text, nullable=False),
    Column("job", Text, nullable=False, server_default=""),
    Column("data", Text, nullable=False, server_default="{}"),
    Index("ix_events_job", "job"),
    Index("ix_events_at", "at"),
    Index("ix_events_kind", "kind", "seq"),
    sqlite_autoincrement=True,
)

journal = Table(
    "journal",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=True),
    Column("at", Real),
    Column("job", Text),
    Column("state", Text),
    Column("executed_line", Integer),
    Column("layer", Integer),
    Column("arc_mm", Real),
    Column("laser_setpoint_w", Real),
    Column("laser_readback_w", Real),
    Column("powder_setpoint_g_min", Real),
    Column("powder_readback_g_min", Real),
    Column("tip_x", Real),
    Column("tip_y", Real),
    Column("tip_z", Real),
    Column("carrier_gas_setpoint_l_min", Real),
    Column("carrier_gas_readback_l_min", Real),
    Column("shield_gas_setpoint_l_min", Real),
    Column("shield_gas_readback_l_min", Real),
    Column("tip_speed_mm_s", Real),
    Column("planner_fill_percent", Real),
    Column("rx_fill_percent", Real),
    Column("tick_jitter_ms", Real),
    Column("spindle_rpm", Real),
    Column("feed_override_percent", Real),
    Column("laser_override_percent", Real),
    Column("powder_override_percent", Real),
    Column("interlocks", Integer),
    Index("ix_journal_job", "job"),
    Index("ix_journal_at", "at"),
    sqlite_autoincrement=True,
)

# Of the samples, made by the web process: least, greatest, sum and count of each channel in steps of level_s (trend_levels.py).
trend_levels = Table(
    "trend_levels",
    metadata,
    Column("level_s", Integer, primary_key=True, autoincrement=False),
    Column("start_at", BigInt, primary_key=True, autoincrement=False),
    Column("samples", Integer, nullable=False),
    Column("last_id", BigInt, nullable=False),
    Column("figures", LargeBinary, nullable=False),
)

# How far the receivers of webhooks were told of the events of this host's cell.
hook_places = Table(
    "hook_places",
    metadata,
    Column("hook", String(40), primary_key=True),
    Column("event_seq", BigInt, nullable=False),
)

cell_runs = Table(
    "cell_runs",
    metadata,
    Column("job", Text, primary_key=True),
    Column("name", Text),
    Column("program", Text),
    Column("program_sha256", Text),
    Column("started_at", Real),
    Column("ended_at", Real),
    Column("outcome", Text),
    Column("last_line", Integer),
    Column("total_lines", Integer),
    Column("who", Text),
    Column("command_id", Text, unique=True),
    Index("ix_cell_runs_started", "started_at"),
)

consumables = Table(
    "consumables",
    metadata,
    Column("seq", BigInt, primary_key=True, autoincrement=True),
    Column("at", Real, nullable=False),
    Column("who", Text, nullable=False),
    Column("kind", String(16), nullable=False),
    Column("lot", Text, nullable=False),
    Column("material", Text, nullable=False, server_default=""),
    Column("note", Text, nullable=False, server_default=""),
    sqlite_autoincrement=True,
)

records = Table(
    "records",
    metadata,
    Column("job", String(40), ForeignKey("jobs.id"), primary_key=True),
    Column("manifest_sha256", String(64), nullable=False),
    Column("at", Real, nullable=False),
    Column("samples", BigInt, nullable=False),
)

webhooks = Table(
    "webhooks",
    metadata,
    Column("id", String(40), primary_key=True),
    Column("url", Text, nullable=False),
    Column("topics", Text, nullable=False),
    Column("secret", Text, nullable=False),
    Column("created_at", Real, nullable=False),
    Column("created_by", Text, nullable=False),
    Column("step_seq", BigInt, nullable=False, server_default="0"),
    Column("event_seq", BigInt, nullable=False, server_default="0"),
    Column("delivered_at", Real),
    Column("failing_since", Real),
    Column("failures", Integer, nullable=False, server_default="0"),
    Column("next_at", Real, nullable=False, server_default="0"),
    Column("last_error", Text, nullable=False, server_default=""),
    Column("paused", Text, nullable=False, server_default=""),
)

# One row for each cell; its service writes it (fleet.py). heard_at: by the clock of the database, which all hosts share.
fleet = Table(
    "fleet",
    metadata,
    Column("cell", String(200), primary_key=True),
    Column("owner", String(40), nullable=False, server_default=""),
    Column("secret", String(64), nullable=False, server_default=""),
    Column("host_url", Text, nullable=False, server_default=""),
    Column("stop_url", Text, nullable=False, server_default=""),
    Column("certificate", Text, nullable=False, server_default=""),
    Column("software", String(40), nullable=False, server_default=""),
    Column("cell_sha256", String(64), nullable=False, server_default=""),
    Column("facts", Text, nullable=False, server_default="{}"),
    Column("state", String(32), nullable=False, server_default=""),
    Column("doing", Text, nullable=False, server_default="{}"),
    Column("heard_at", Real, nullable=False, server_default="0"),
)
