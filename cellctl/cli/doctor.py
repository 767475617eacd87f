"""The command that looks a cell over: doctor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_CELL, DEFAULT_RUN, CellName, Json, RunFolder, writable

if TYPE_CHECKING:
    from cellctl.doctor import Report


def doctor(
    cell: CellName = DEFAULT_CELL,
    run: RunFolder = DEFAULT_RUN,
    probe_ports: Annotated[
        bool, typer.Option("--probe-ports", help="Open every serial port and ask who is there. It resets some boards: no machine may be running.")
    ] = False,
    let_dead_man_expire: Annotated[
        bool, typer.Option("--let-dead-man-expire", help="Write heartbeats and one harmless output per device, fall silent, time how it goes off.")
    ] = False,
    locked_out_by: Annotated[
        str, typer.Option("--locked-out-by", metavar="TEXT", help="How you made emission impossible; the laser's dead-man on a real cell needs it.")
    ] = "",
    ask: Annotated[bool, typer.Option("--ask", help="Ask for E-stop, door, chiller, gas, extraction; answers from terminal or pipe.")] = False,
    may_move: Annotated[bool, typer.Option("--may-move", help="With --ask: step each axis by 1 mm or degree and back, each after a yes.")] = False,
    by: Annotated[str, typer.Option("--by", help="Who examines; stands in the report. Default: the user of this computer.")] = "",
    status_queries: Annotated[int, typer.Option("--status-queries", min=1, max=1000, help="Of the CNC, timed, ten a second.")] = 20,
    requests: Annotated[int, typer.Option("--requests", min=1, max=10000, help="To each Modbus device, timed.")] = 100,
    answer_s: Annotated[float, typer.Option("--answer-within", min=0.1, max=300.0, help="Seconds for a contact to show what was asked for.")] = 10.0,
    html: Annotated[Path | None, typer.Option("--html", help="Write a page to print and sign.")] = None,
    json: Json = False,
) -> None:
    """Check a cell: ports, CNC, settings, registers, latencies; more where told. Moves and emits nothing by itself. Exit code 1: a fault."""
    from cellctl.doctor import Options, examine_cell
    from cellctl.doctor.page import html_of

    page = None if html is None else writable(html)
    options = Options(
        by, probe_ports, let_dead_man_expire, locked_out_by, ask_at_terminal if ask else None, may_move, status_queries, requests, answer_s
    )
    report = examine_cell(cell, run, options)
    if page is not None:
        page.write_text(html_of(report), encoding="utf-8")
    if json:
        output.as_json(report.document())
    else:
        _show(report)
    raise typer.Exit(0 if report.is_well else 1)


async def ask_at_terminal(text: str) -> str | None:
    """Show a line on stderr, read one from stdin; None at its end."""
    import asyncio
    import sys

    sys.stderr.write(f"{text}: ")
    sys.stderr.flush()
    line = await asyncio.to_thread(sys.stdin.readline)
    if not sys.stdin.isatty():
        sys.stderr.write("\n")
    return line.strip().lower() if line else None


def _show(report: Report) -> None:
    for section in dict.fromkeys(check.section for check in report.checks):
        output.line(f"\n{section}")
        rows = [
            (check.verdict, check.what, "; ".join(filter(None, (check.found, f"limit {check.limit}" if check.limit else "", check.remedy))))
            for check in report.checks
            if check.section == section
        ]
        output.table(("", "what", "found"), rows)
    counts = ", ".join(f"{report.count(verdict)} {verdict}" for verdict in ("FAULT", "warning", "ok", "not checked"))
    output.line(f"\n{report.cell} ({report.mode}), {report.cell_file}, sha256 {report.file_sha256[:12]}: {counts}")
    for check in report.faults:
        output.line(f"  FAULT {check.section}: {check.what}" + (f": {check.remedy}" if check.remedy else ""))
