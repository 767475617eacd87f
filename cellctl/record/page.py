"""The record as one HTML page: no script, nothing from elsewhere, every text escaped, to be read on a screen and printed on A4."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cellctl.record import course
from sim.report.markup import Node, StyleSheet, table, tag
from sim.report.style import STYLE as REPORT_STYLE

STYLE = REPORT_STYLE + "svg .held{fill:#56606c;fill-opacity:.16;stroke:none}\n"
PAGE_POLICY = (
    f"default-src 'none'; img-src data:; style-src 'sha256-{base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()}'; "
    "base-uri 'none'; form-action 'none'"
)
"""Content-Security-Policy that the page carries: its own style, pictures within it, and nothing else."""
KINDS = {"powder": "Powder", "carrier_gas": "Carrier gas", "shield_gas": "Shield gas"}
Cells = tuple[Node | str, ...]


def html_of(record: dict[str, Any], samples: Path | None = None, picture: bytes | None = None) -> str:
    """The page. samples : the record's Parquet file, for the charts; picture : PNG of the part as the proof built it"""
    sections: list[Node | None] = [
        *_head(record),
        _verdict(record),
        *_titled("Alarms", _alarms(record)),
        *_titled("Holds", _holds(record)),
        *_titled("Overrides", _commands(record["overrides"])),
        *_course(record, samples),
        *_titled("By layer", [*course.by_layer(record["layers"]), _layers(record["layers"])] if record["layers"] else []),
        *_as_built(record, picture),
        *_titled("Powder and gas", _lots(record)),
        *_titled("People", _people(record)),
        *_titled("Content (SHA-256)", [_pairs(((name, value or "\N{EN DASH}") for name, value in record["sha256"].items()), "hash")]),
        *_titled("Recipe", [_pairs(_flat(record["recipe"]))]),
        *_titled("When", [_pairs((name.replace("_", " "), _time(at)) for name, at in record["timestamps"].items())]),
        *_titled("Who did what", [_deeds(record)] if record["deeds"] else []),
        *_titled("Events", [_events(record)] if record["events"] else []),
    ]
    title = f"Record of {record['job']['name']}"
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=PAGE_POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        StyleSheet("style", (), (STYLE,)),
    )
    return f"<!doctype html>\n{tag('html', head, tag('body', *sections), lang='en')}\n"


def _titled(title: str, nodes: Sequence[Node | None]) -> list[Node | None]:
    return [tag("h2", title), *nodes] if nodes else []


def _time(at: float | None) -> str:
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M:%S UTC") if at else "\N{EN DASH}"


def _clock(at: float | None) -> str:
    return datetime.fromtimestamp(at, UTC).strftime("%H:%M:%S") if at else "\N{EN DASH}"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.5g}".replace("-", "\N{MINUS SIGN}") if abs(value) < 1e5 else f"{value:.0f}"
    return "" if value is None else str(value)


def _pairs(pairs: Iterable[tuple[str, Any]], class_: str | None = None) -> Node:
    wide = "wide" if class_ == "hash" else None
    return tag("dl", *(tag("div", tag("dt", name), tag("dd", _text(value), class_=class_), class_=wide) for name, value in pairs), class_="pairs")


def _flat(document: dict[str, Any], before: str = "") -> list[tuple[str, Any]]:
    """A tree as pairs, names joined by dots."""
    found: list[tuple[str, Any]] = []
    for name, value in document.items():
        found += _flat(value, f"{before}{name}.") if isinstance(value, dict) else [(f"{before}{name}", value)]
    return found


def _head(record: dict[str, Any]) -> list[Node]:
    job, part, run = record["job"], record["part"], record["run"] or {}
    size = " × ".join(f"{high - low:.4g}" for low, high in zip(*part["bbox_mm"], strict=True))
    pairs = [
        ("Job", job["id"]), ("Cell", job["cell"]), ("Material", job["material"]), ("Part", part["name"]),
        ("Size", f"{size} mm"), ("Volume", f"{part['volume_mm3']:.0f} mm\N{SUPERSCRIPT THREE}"),
        ("Started", _time(run.get("started_at"))), ("Ended", _time(run.get("ended_at"))),
    ]  # fmt: skip
    if job["continues_job"]:
        pairs.append(("Goes on with", job["continues_job"]))
    return [tag("p", "Record of a job", class_="kind"), tag("h1", job["name"]), _pairs(pairs)]


def _verdict(record: dict[str, Any]) -> Node:
    """What became of it, at a glance."""
    job, run, proof = record["job"], record["run"], record["proof"] or {}
    lines = [] if run is None else [f"{run['last_line']} of {run['total_lines']} lines executed"]
    approval = record["approval"]
    if proof:
        override = approval["override_reason"] or "no"
        lines.append("the proof passed" if proof.get("passed") else f"the proof did not pass; overridden: {override}")
    lines.append(f"approved by {approval['by'] or 'nobody'}" + (f": {approval['because']}" if approval["because"] else ""))
    for count, what in ((len(record["alarms"]), "alarm"), (len(record["holds"]), "hold"), (len(record["overrides"]), "override")):
        lines.append(f"{count or 'no'} {what}{'' if count == 1 else 's'}")
    if record["error"]:
        lines.append(f"{record['error']['title']}: {record['error']['detail']}")
    word = job["state"].replace("_", " ")
    look = "verdict passed" if word == "completed" else "verdict failed"
    return tag("div", tag("strong", word), tag("ul", *(tag("li", line) for line in lines)), class_=look)


def _alarms(record: dict[str, Any]) -> list[Node]:
    rows: list[Cells] = [
        (_clock(a["at"]), a["cause"], a["remedy"], f"{_clock(a['reset_at'])} {a['reset_by']}".strip()) for a in record["alarms"]
    ]
    return [table(("Time", "Cause", "Remedy", "Reset"), rows)] if rows else []


def _holds(record: dict[str, Any]) -> list[Node]:
    rows: list[Cells] = [
        (_clock(h["from_at"]), f"{h['to_at'] - h['from_at']:.0f} s" if h["to_at"] else "to the end", " → ".join(h["states"]).lower(), h["because"])
        for h in record["holds"]
    ]
    return [table(("From", "#For", "States", "Because"), rows)] if rows else []


def _commands(commands: Sequence[dict[str, Any]]) -> list[Node]:
    rows: list[Cells] = [(_clock(c["at"]), c["who"], c["text"]) for c in commands]
    return [table(("Time", "Who", "What"), rows)] if rows else []


def _course(record: dict[str, Any], samples: Path | None) -> list[Node | None]:
    return _titled("Course of the run", course.section(samples, record)) if samples is not None and record["run"] else []


def _layers(layers: Sequence[dict[str, Any]]) -> Node:
    rows: list[Cells] = [
        (
            str(row["layer"] + 1), f"{_clock(row['from_at'])} + {row['to_at'] - row['from_at']:.0f} s", str(row["samples"]),
            *(_text(float(row[name])) for name in (
                "laser_setpoint_max_w", "laser_readback_max_w", "laser_readback_mean_w",
                "powder_setpoint_max_g_min", "powder_readback_max_g_min", "powder_readback_mean_g_min",
            )),
        )
        for row in layers
    ]  # fmt: skip
    columns = ("#Layer", "From", "#Samples", "#W set", "#W read", "#W mean", "#g/min set", "#g/min read", "#g/min mean")
    return table(columns, rows)


def _as_built(record: dict[str, Any], picture: bytes | None) -> list[Node | None]:
    """The part as the twin built it from the Program that was run."""
    proof = record["proof"]
    if not proof:
        return []
    words = "The part as the twin built it from this Program, coloured by its deviation from the mesh; not a measurement of the metal"
    shown = None
    if picture:
        source = f"data:image/png;base64,{base64.b64encode(picture).decode()}"
        shown = tag("figure", tag("img", src=source, alt=words), tag("figcaption", words + "."))
    return _titled("As built in the twin", [shown, _pairs((name, value) for name, value in _flat(proof) if not isinstance(value, list))])


def _lots(record: dict[str, Any]) -> list[Node]:
    rows: list[Cells] = [
        (KINDS.get(lot["kind"], lot["kind"]), lot["lot"], lot["material"], _time(lot["at"]), lot["who"], lot["note"]) for lot in record["consumables"]
    ]
    if not rows:
        return [tag("p", "Nobody told which lots were loaded.", class_="soft")] if record["run"] else []
    return [table(("What", "Lot", "Material", "Loaded", "By", "Note"), rows)]


def _people(record: dict[str, Any]) -> list[Node]:
    rows: list[Cells] = [(name, ", ".join(deeds)) for name, deeds in record["people"].items()]
    return [table(("Who", "Did"), rows)] if rows else []


def _deeds(record: dict[str, Any]) -> Node:
    rows: list[Cells] = [(_time(d["at"]), d["who"], d["origin"], d["verb"], d["because"], d["outcome"]) for d in record["deeds"]]
    return table(("Time", "Who", "From", "What", "Because", "Outcome"), rows)


def _events(record: dict[str, Any]) -> Node:
    rows: list[Cells] = [(_clock(e["at"]), e["kind"], e["text"]) for e in record["events"]]
    return table(("Time", "Kind", "What"), rows)
