"""The record of a job: hashes, people, proof, run, figures per layer, events; as a document and as a page without scripts."""

from __future__ import annotations

import base64
import hashlib
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from html import escape
from typing import Any

from sqlalchemy import Connection

from cellctl.api.feed import event_document
from cellctl.store import audit, history, jobs, parts

SCHEMA = 1


def record_of(connection: Connection, job_id: str) -> dict[str, Any]:
    """Everything known about a job. Raises NotFoundError."""
    job = jobs.get(connection, job_id)
    part = parts.get(connection, job.part_id)
    run = history.run_of(connection, job_id)
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
        "error": job.error,
        "proof": job.proof,
        "timestamps": job.timestamps,
        "run": asdict(run) if run else None,
        "layers": [asdict(figures) for figures in history.layers_of(connection, job_id)],
        "deeds": audit.of_target(connection, job_id),
        "events": [event_document(event) for event in history.events_of(connection, job_id)],
    }


def _time(at: float | None) -> str:
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M:%S UTC") if at else ""


def _text(value: Any) -> str:
    if isinstance(value, float):
        value = f"{value:.4g}" if abs(value) < 1e5 else f"{value:.0f}"
    return escape("" if value is None else str(value))


def _table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join("<tr>" + "".join(f"<td>{_text(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<h2>{escape(title)}</h2><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if body else ""


def _pairs(title: str, values: dict[str, Any] | None) -> str:
    return _table(title, ("what", "value"), (values or {}).items())


STYLE = """body{font:14px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:70rem;padding:0 1rem;color:#1a1d21}
table{border-collapse:collapse;margin:.5rem 0 1.5rem}th,td{text-align:left;padding:.25rem .75rem;border-bottom:1px solid #d6dae0}
th{font-weight:600;background:#f2f4f7}td{font-variant-numeric:tabular-nums;overflow-wrap:anywhere}h1{margin-bottom:.2rem}"""


PAGE_POLICY = (
    f"default-src 'none'; style-src 'sha256-{base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()}'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of the page: its own style and nothing else."""


def html_of(record: dict[str, Any]) -> str:
    """The record as one page that needs nothing else; every text is escaped."""
    job = record["job"]
    layers = record["layers"]
    sections = [
        f"<h1>{_text(job['name'])}</h1><p>{_text(job['state'])} · {_text(job['cell'])} · {_text(job['material'])} · {_text(job['id'])}</p>",
        _pairs("Content (SHA-256)", record["sha256"]),
        _pairs("Part", record["part"]),
        _pairs("Proof", record["proof"]),
        _pairs("Approval", record["approval"]),
        _pairs(f"Goes on with {job['continues_job']}", record["resumption"]),
        _pairs("Run", record["run"]),
        _pairs("Error", record["error"]),
        _pairs("Recipe", record["recipe"]),
        _table("When", ("state", "time"), ((name, _time(at)) for name, at in record["timestamps"].items())),
        _table("Layers", list(layers[0]) if layers else [], (list(row.values()) for row in layers)),
        _table("Who did what", ("time", "who", "from", "what", "because", "outcome"),
               ((_time(d["at"]), d["who"], d["origin"], d["verb"], d["because"], d["outcome"]) for d in record["deeds"])),
        _table("Events", ("time", "kind", "text"), ((_time(e["at"]), e["kind"], e["text"]) for e in record["events"])),
    ]  # fmt: skip
    title = f"Record of {_text(job['name'])}"
    return f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style><body>{"".join(sections)}</body></html>'
