"""Everything that is known about a job, as one document: what was asked for, planned, proven, approved, commanded, read back and done."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from sqlalchemy import Connection

from cellctl.api.feed import event_document
from cellctl.domain.messages import Event
from cellctl.store import audit, consumables, history, jobs, parts
from cellctl.store.history import Run
from cellctl.store.jobs import JobRow

SCHEMA = 2
STANDING = frozenset({"HOLDING", "HELD", "FAULT", "STOPPED"})
"""States in which a job that is on the cell makes no way, and did not ask for it."""
OVERRIDES = frozenset({"override"})


def record_of(connection: Connection, cell_rows: Connection, job_id: str) -> dict[str, Any]:
    """Everything known about a job. cell_rows : of what the cell process wrote. Times: Unix, s. Raises NotFoundError."""
    job = jobs.get(connection, job_id)
    part = parts.get(connection, job.part_id)
    run = history.run_of(cell_rows, job_id)
    happened = history.events_of(cell_rows, job_id)
    deeds = audit.of_target(connection, job_id)
    return {
        "schema": SCHEMA,
        "job": {
            "id": job.id,
            "name": job.name,
            "state": job.state.value,
            "cell": job.cell,
            "material": job.material,
            "why": job.why,
            "continues_job": job.continues_job,
        },
        "resumption": None if job.continues_job is None else {**(job.resume_point or {}), **(job.resumption or {})},
        "part": {
            "id": part.id,
            "name": part.name,
            "units": part.units,
            "bbox_mm": part.inspection.bbox_mm,
            "volume_mm3": part.inspection.volume_mm3,
            "findings": [finding["text"] for finding in part.inspection.findings],
        },
        "sha256": {
            "file": part.sha256,
            "mesh": part.inspection.mesh_sha256,
            "plan": job.plan_sha256,
            "program": job.program_sha256,
            "proof": job.proof_sha256,
        },
        "recipe": tomllib.loads(job.recipe_toml),
        "approval": {"by": job.approved_by, "because": job.approve_because, "override_reason": job.override_reason},
        "people": people(job, deeds, happened),
        "error": job.error,
        "proof": job.proof,
        "timestamps": job.timestamps,
        "run": asdict(run) if run else None,
        "consumables": [] if run is None else [asdict(lot) for lot in consumables.in_force(connection, run.started_at, run.ended_at)],
        "samples": history.count_samples(cell_rows, job_id),
        "layers": [asdict(figures) for figures in history.layers_of(cell_rows, job_id)],
        "alarms": alarms(happened),
        "holds": holds(happened, run),
        "overrides": [deed for deed in commands(happened) if deed["verb"] in OVERRIDES],
        "commands": commands(happened),
        "deeds": deeds,
        "events": [event_document(event) for event in happened],
    }


def people(job: JobRow, deeds: Sequence[dict[str, Any]], happened: Iterable[Event]) -> dict[str, list[str]]:
    """What each person did, by name, in the order of doing."""
    did: dict[str, list[str]] = {}

    def add(name: str, deed: str) -> None:
        if name and deed not in did.setdefault(name, []):
            did[name].append(deed)

    add(job.created_by, "submitted")
    for deed in deeds:
        add(deed["who"], deed["verb"])
    add(job.approved_by, "approved")
    add(job.confirmed_by, "looked at the table")
    for event in happened:
        if event.kind == "command":
            add(str(event.data.get("who", "")), str(event.data.get("verb", "")))
    return did


def commands(happened: Iterable[Event]) -> list[dict[str, Any]]:
    """Commands to the cell while the job was on it."""
    return [
        {
            "at": event.at,
            "who": event.data.get("who", ""),
            "client": event.data.get("client", ""),
            "verb": event.data.get("verb", ""),
            "because": event.data.get("because", ""),
            "text": event.text,
        }
        for event in happened
        if event.kind == "command"
    ]


def alarms(happened: Iterable[Event]) -> list[dict[str, Any]]:
    """Alarms of the run: code, cause, remedy, when, and who reset them."""
    told: list[dict[str, Any]] = []
    for event in happened:
        if event.kind == "alarm":
            remedy = event.data.get("shown_remedy") or event.data.get("remedy", "")
            told.append({"at": event.at, "code": event.data.get("code", ""), "cause": event.text, "remedy": remedy, "reset_at": None, "reset_by": ""})
        elif event.kind == "reset":
            for alarm in told:
                if alarm["reset_at"] is None:
                    alarm |= {"reset_at": event.at, "reset_by": event.data.get("who", "")}
    return told


def holds(happened: Iterable[Event], run: Run | None) -> list[dict[str, Any]]:
    """Times in which the job stood on the cell against its Program: from, to (null: it ended so), first cause, and the states gone through."""
    found: list[dict[str, Any]] = []
    current: dict[str, Any] | None = None
    for event in happened:
        if event.kind != "state":
            continue
        state = str(event.data.get("state", ""))
        if state in STANDING and current is None:
            current = {"from_at": event.at, "to_at": None, "because": event.data.get("because", ""), "states": [state]}
            found.append(current)
        elif current is not None and state in STANDING:
            current["states"].append(state)
        elif current is not None and state in ("RUNNING", "PREPARING"):
            current["to_at"] = event.at
            current = None
    if current is not None and run is not None:
        current["to_at"] = run.ended_at
    return found
