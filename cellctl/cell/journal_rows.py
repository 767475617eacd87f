"""Rows of the journal, and what an earlier process left in them."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import dataclass, field
from typing import Any

from cellctl.cell.black_box import BlackBox, Place
from cellctl.domain.channels import NAMES

KEPT_COMMANDS = 10_000

# The same tables as the store's migrations make.
TABLES = """
CREATE TABLE IF NOT EXISTS events (
  seq INTEGER PRIMARY KEY AUTOINCREMENT, at REAL NOT NULL, kind TEXT NOT NULL, text TEXT NOT NULL,
  job TEXT NOT NULL DEFAULT '', data TEXT NOT NULL DEFAULT '{}');
CREATE TABLE IF NOT EXISTS journal (
  id INTEGER PRIMARY KEY AUTOINCREMENT, at REAL, job TEXT, state TEXT, executed_line INTEGER, layer INTEGER, arc_mm REAL,
  laser_setpoint_w REAL, laser_readback_w REAL, powder_setpoint_g_min REAL, powder_readback_g_min REAL,
  tip_x REAL, tip_y REAL, tip_z REAL, carrier_gas_setpoint_l_min REAL, carrier_gas_readback_l_min REAL,
  shield_gas_setpoint_l_min REAL, shield_gas_readback_l_min REAL, tip_speed_mm_s REAL, planner_fill_percent REAL,
  rx_fill_percent REAL, tick_jitter_ms REAL, spindle_rpm REAL, feed_override_percent REAL, laser_override_percent REAL,
  powder_override_percent REAL, interlocks INTEGER);
CREATE TABLE IF NOT EXISTS measured (
  seq INTEGER PRIMARY KEY AUTOINCREMENT, cell TEXT NOT NULL, at REAL NOT NULL, who TEXT NOT NULL, because TEXT NOT NULL DEFAULT '',
  what TEXT NOT NULL DEFAULT '', document TEXT NOT NULL, points TEXT NOT NULL DEFAULT '{}');
CREATE TABLE IF NOT EXISTS cell_runs (
  job TEXT PRIMARY KEY, name TEXT, program TEXT, program_sha256 TEXT, started_at REAL, ended_at REAL, outcome TEXT,
  last_line INTEGER, total_lines INTEGER, who TEXT, command_id TEXT UNIQUE);
"""
EVENT = "INSERT INTO events (at, kind, text, job, data) VALUES (?, ?, ?, ?, ?)"
PLACE = ("at", "job", "state", "executed_line", "layer", "arc_mm", "tip_x", "tip_y", "tip_z", "interlocks")
SAMPLE = f"INSERT INTO journal ({', '.join((*PLACE, *NAMES))}) VALUES ({', '.join('?' * (len(PLACE) + len(NAMES)))})"
RUN = (
    "INSERT INTO cell_runs (job, name, program, program_sha256, started_at, ended_at, outcome, last_line, total_lines, who,"
    " command_id) VALUES (?,?,?,?,?,NULL,'',0,?,?,?)"
)
MEASURED = "INSERT INTO measured (cell, at, who, because, what, document, points) VALUES (?,?,?,?,?,?,?)"
PROGRESS = "UPDATE cell_runs SET last_line = ? WHERE job = ?"
END = "UPDATE cell_runs SET ended_at = ?, outcome = ?, last_line = ? WHERE job = ?"


@dataclass(frozen=True)
class Sample:
    """One row of the journal. at : Unix time (s); executed_line : count of executed lines; arc in mm, tip in the build frame.

    figures : one for each of domain.channels.NAMES, None where nobody knows; without a job all that is of a job is None
    interlocks : bits as in domain.channels.INTERLOCK_BITS
    """

    at: float
    job: str
    state: str
    executed_line: int | None
    layer: int | None
    arc_mm: float | None
    figures: tuple[float | None, ...]
    tip: tuple[float, float, float] | tuple[None, None, None] = (None, None, None)
    interlocks: int | None = None

    @property
    def row(self) -> tuple[Any, ...]:
        """Values in the order of the statement SAMPLE."""
        return (
            self.at, self.job, self.state, self.executed_line, self.layer, self.arc_mm, *self.tip, self.interlocks, *self.figures,
        )  # fmt: skip


@dataclass(frozen=True)
class UnfinishedRun:
    """A run that no process ended.

    last_line : lines executed; place : where the tip was at the last tick; metal_end : where the light that was on has ended by the
    laser's dead-man; line -1 : not known, arc_mm then from the last sample. known_by : "tick" (black box) or "sample" (journal)
    """

    job: str
    name: str
    last_line: int
    total_lines: int
    place: Place = field(default_factory=Place)
    metal_end: Place = field(default_factory=Place)
    known_by: str = "sample"

    @property
    def arc_mm(self) -> float:
        """Path length of the tip that was executed, mm."""
        return self.place.arc_mm

    @property
    def document(self) -> dict[str, Any]:
        """What is written down of it beside its lines."""
        return {"place": self.place.document, "metal_end": self.metal_end.document, "known_by": self.known_by}


@dataclass
class Found:
    """What the store held when it was opened.

    is_stopped : whether a stop was latched and not reset since
    jobs : all that were ever started; replies : per command id the reply that it got; alarms : latched and not reset since, as (code, detail, remedy)
    """

    unfinished: list[UnfinishedRun] = field(default_factory=list)
    replies: dict[str, dict[str, Any]] = field(default_factory=dict)
    jobs: set[str] = field(default_factory=set)
    alarms: list[tuple[str, str, str]] = field(default_factory=list)
    seen: dict[str, tuple[str, float]] = field(default_factory=dict)  # code -> who acknowledged it, and when (Unix, s)
    is_stopped: bool = False
    measured: dict[str, str] = field(default_factory=dict)  # cell -> newest document of what was measured
    last: dict[str, dict[str, Any]] = field(default_factory=dict)  # kind -> data of the last event of it: who has control, the position


def find(db: sqlite3.Connection, box: BlackBox) -> Found:
    """What an earlier process left: unfinished runs, answered commands, latched alarms."""
    found = Found()
    rows = db.execute(
        "SELECT job, name, last_line, total_lines FROM cell_runs WHERE ended_at IS NULL ORDER BY started_at"
    )
    found.unfinished = [_unfinished(db, box, *row) for row in rows.fetchall()]
    found.jobs = {job for (job,) in db.execute("SELECT job FROM cell_runs")}
    rows = db.execute("SELECT data FROM events WHERE kind = 'command' ORDER BY seq DESC LIMIT ?", (KEPT_COMMANDS,))
    for (data,) in reversed(rows.fetchall()):
        entry = json.loads(data)
        found.replies.setdefault(entry["id"], entry["reply"])
    rows = db.execute(
        "SELECT data FROM events WHERE kind = 'alarm' AND seq > (SELECT coalesce(max(seq), 0) FROM events WHERE kind = 'reset') ORDER BY seq"
    )
    found.alarms = [
        (entry["code"], entry["detail"], entry["remedy"]) for entry in map(json.loads, (row[0] for row in rows))
    ]
    (reset,) = db.execute("SELECT coalesce(max(seq), 0) FROM events WHERE kind = 'reset'").fetchone()
    rows = db.execute("SELECT at, data FROM events WHERE kind = 'acknowledge' AND seq > ? ORDER BY seq", (reset,))
    for at, data in rows:
        entry = json.loads(data)
        found.seen.update(dict.fromkeys(entry["codes"], (entry["who"], at)))
    last = db.execute("SELECT data FROM events WHERE kind = 'state' ORDER BY seq DESC LIMIT 1").fetchone()
    found.is_stopped = last is not None and json.loads(last[0])["state"] == "STOPPED"
    found.measured = dict(db.execute("SELECT cell, document FROM measured ORDER BY seq"))
    for kind in ("control", "position"):
        row = db.execute("SELECT data FROM events WHERE kind = ? ORDER BY seq DESC LIMIT 1", (kind,)).fetchone()
        if row is not None:
            found.last[kind] = json.loads(row[0])
    return found


def _unfinished(
    db: sqlite3.Connection, box: BlackBox, job: str, name: str, last_line: int, total: int
) -> UnfinishedRun:
    """Progress never goes back: the farther of the last tick (lost with the machine's power) and the last sample is the truth."""
    row = db.execute(
        "SELECT executed_line, arc_mm FROM journal WHERE job = ? ORDER BY id DESC LIMIT 1", (job,)
    ).fetchone()
    executed, arc_mm = (max(last_line, row[0]), row[1]) if row is not None else (last_line, 0.0)
    moment = box.of_job(job)
    if moment is None or moment.executed < executed:
        return UnfinishedRun(job, name, executed, total, Place(arc_mm=arc_mm))
    return UnfinishedRun(job, name, moment.executed, total, moment.place, moment.dark, "tick")
