"""`cellctl go-on JOB`: the part of an interrupted job is gone on with, by a new job whose program is shown before anybody approves it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_RUN, Because, InputFault, JobId, Json, RunFolder, Url, connect, find_job
from cellctl.cli.remote import WAITS_FOR_PEOPLE, follow, show_job

if TYPE_CHECKING:
    from cellctl.client_documents import Job, ProgramHead


def go_on(
    job: JobId,
    layer: Annotated[int | None, typer.Option("--layer", min=0, help="From the begin of this layer, counted from 0.")] = None,
    operation: Annotated[
        int | None, typer.Option("--operation", min=0, help="From the begin of this operation, by its number over the whole plan.")
    ] = None,
    overlap: Annotated[
        float | None, typer.Option("--overlap", min=0.0, help="Millimetres of the bead that are run again; default: one bead's width.")
    ] = None,
    look: Annotated[bool, typer.Option("--look", help="Only show where metal ended.")] = False,
    because: Because = "",
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """Go on with the part of an interrupted job, from where metal ended; a new job, to be approved. Exit 1 if it failed."""
    if layer is not None and operation is not None:
        raise InputFault("--layer and --operation are both given", "leave one out")
    with connect(url, run) as client:
        job_id = find_job(client, job)
        point = client.resumption_point(job_id)
        if look:
            output.as_json(point) if json else show_point(point)
            return
        if not json:
            show_point(point)
        made = client.go_on(job_id, layer=layer, operation=operation, overlap_mm=overlap, because=because)
        made = follow(client, made["id"], quiet=json)
        head = client.program_head(made["id"]) if made["program_sha256"] else None
    if json:
        output.as_json({"resumption_point": point, "job": made, "program_head": head})
    else:
        show_program(made, head)
        show_job(made, json)
        if made["state"] in WAITS_FOR_PEOPLE:
            output.line(f"approve it with: cellctl approve {made['id']} --part-untouched")
    raise typer.Exit(1 if made["state"] == "failed" else 0)


def show_point(point: dict[str, Any]) -> None:
    """Print where metal ended, how that is known, and what forbids going on."""
    end = point["metal_end"]
    if end is not None:
        output.line(f"metal ended in {end['text']}")
        output.line(f"  known {end['known_by_text']}")
        output.line(f"  {point['lines_executed']} of {point['lines_total']} lines were executed")
    for note in point["notes"]:
        output.line(f"  {note}")
    if not point["possible"]:
        output.line(f"it cannot go on: {point['why_not']}")


def show_program(job: Job, head: ProgramHead | None) -> None:
    """Print the figures of the generated program, its head, and the first lines behind the joint."""
    figures = job["resumption"]
    if figures is None or head is None:
        return
    output.line(
        f"overlap {figures['overlap_mm']:g} mm, lead-in {figures['lead_in_mm']:g} mm, clearance {figures['clearance_mm']:g} mm; "
        f"{figures['extra_s']:g} s longer, {figures['remaining_s']:g} s and {figures['remaining_lines']} lines of the first program remain"
    )
    for number, text in enumerate(head["lines"]):
        if number == head["head_lines"]:
            output.line(f"  -- here the first program goes on, from its line N{figures['resumed_line']} --")
        output.line(f"  {text}")
