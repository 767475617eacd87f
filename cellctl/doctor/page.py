"""The report as one HTML page without scripts, to be read on a screen, printed on A4 and signed."""

from __future__ import annotations

import base64
import hashlib
from datetime import UTC, datetime

from cellctl.doctor.report import Check, Report
from sim.report.markup import Node, StyleSheet, table, tag
from sim.report.style import STYLE as REPORT_STYLE

STYLE = REPORT_STYLE + (
    "table.checks{table-layout:fixed}.checks th:nth-child(1){width:19mm}.checks th:nth-child(2){width:46mm}.checks th:nth-child(4){width:38mm}"
    ".checks td{overflow-wrap:anywhere}\n"
)
STYLE_SHA256 = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
PAGE_POLICY = f"default-src 'none'; style-src 'sha256-{STYLE_SHA256}'; base-uri 'none'; form-action 'none'"
"""Content-Security-Policy that the page carries: its own style and nothing else."""
LOOK = {"ok": "ok", "FAULT": "not-ok", "warning": "warning", "told": "soft", "not checked": "soft"}
Cells = tuple[Node | str, ...]


def html_of(report: Report) -> str:
    """The page."""
    title = f"Examination of {report.cell}"
    policy = tag("meta", http_equiv="Content-Security-Policy", content=PAGE_POLICY)
    style = StyleSheet("style", (), (STYLE,))
    head = tag("head", tag("meta", charset="utf-8"), policy, tag("title", title), style)
    body = [*_head(report, title), _verdict(report), *_faults(report)]
    for section in dict.fromkeys(check.section for check in report.checks):
        rows = [_row(check) for check in report.checks if check.section == section and check.verdict != "not checked"]
        if rows:
            body += [tag("h2", section), table(("Verdict", "What", "Found", "Limit"), rows, "checks")]
    body += [*_unchecked(report), *_signatures()]
    return f"<!doctype html>\n{tag('html', head, tag('body', *body), lang='en')}\n"


def _head(report: Report, title: str) -> list[Node]:
    at = datetime.fromtimestamp(report.at, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    pairs = [("Date", at), ("By", report.who), ("Cell", report.cell), ("Mode", report.mode), ("Cell file", report.cell_file)]
    hashes = [("SHA-256 of the file", report.file_sha256), ("SHA-256 of its facts", report.facts_sha256)]
    nodes = [tag("div", tag("dt", name), tag("dd", value)) for name, value in pairs]
    nodes += [tag("div", tag("dt", name), tag("dd", value, class_="hash"), class_="wide") for name, value in hashes]
    return [tag("p", "cellctl doctor", class_="kind"), tag("h1", title), tag("dl", *nodes, class_="pairs")]


def _verdict(report: Report) -> Node:
    counts = [(report.count("FAULT"), "fault"), (report.count("warning"), "warning")]
    lines = [f"{count} {what}{'' if count == 1 else 's'}" for count, what in counts]
    lines.append(f"{report.count('ok')} as they have to be")
    lines.append(f"{report.count('not checked')} not checked: see the end")
    word = "as the cell file says" if report.is_well else "not as the cell file says"
    look = "verdict passed" if report.is_well else "verdict failed"
    return tag("div", tag("strong", word), tag("ul", *(tag("li", line) for line in lines)), class_=look)


def _faults(report: Report) -> list[Node]:
    rows: list[Cells] = [
        (_mark(check), f"{check.section}: {check.what}", check.remedy) for check in report.checks if check.verdict in ("FAULT", "warning")
    ]
    return [tag("h2", "To do"), table(("Verdict", "What", "What to do"), rows, "checks")] if rows else []


def _row(check: Check) -> Cells:
    return _mark(check), check.what, check.found, check.limit


def _mark(check: Check) -> Node:
    return tag("span", check.verdict, class_=LOOK[check.verdict])


def _unchecked(report: Report) -> list[Node]:
    rows: list[Cells] = [(f"{check.section}: {check.what}", check.remedy) for check in report.checks if check.verdict == "not checked"]
    return [tag("h2", "Not checked"), table(("What", "Why"), rows)] if rows else []


def _signatures() -> list[Node]:
    fields = (tag("div", "Examined by, date, signature"), tag("div", "Cell released by, date, signature"))
    return [tag("h2", "Signed"), tag("div", *fields, class_="sign")]
