"""Commands that ask the service: submit, jobs, watch, approve, cancel, and the cell's own verbs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import (
    DEFAULT_RUN,
    Because,
    JobId,
    Json,
    RunFolder,
    Units,
    Url,
    checked_units,
    connect,
    existing_file,
    find_job,
)

if TYPE_CHECKING:
    from cellctl.client import Client
    from cellctl.client_documents import Job

TableClear = Annotated[
    bool, typer.Option("--table-clear", help="I looked: the table is clear and the substrate is clamped.")
]
PartUntouched = Annotated[
    bool,
    typer.Option(
        "--part-untouched",
        help="Of a job that goes on with another: I looked: the part stands untouched on the table, tool and work offset are as they were.",
    ),
]
TakeControl = Annotated[
    bool, typer.Option("--take-control", help="Take control over from another console or client first; --because says why.")
]
WATCH_PERIOD_S = 0.25
WAITS_FOR_PEOPLE = frozenset({"waiting_for_approval"})
ENDED = frozenset({"completed", "failed", "aborted", "cancelled", "interrupted"})


def submit(
    part: Annotated[Path, typer.Argument(help="Mesh file: STL, 3MF, OBJ or PLY.")],
    recipe: Annotated[Path | None, typer.Option("--recipe", help="Recipe (TOML).")] = None,
    units: Units = "mm",
    name: Annotated[str | None, typer.Option("--name", help="Of the job.")] = None,
    cell: Annotated[str | None, typer.Option("--cell", help="Its name, or any: the fitting one with the least work. Default: the service's.")] = None,
    approve_it: Annotated[
        bool, typer.Option("--approve", help="Wait for the proof and approve it if it passed.")
    ] = False,
    table_clear: TableClear = False,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """Upload a part and submit a job for it."""
    existing_file(part, "mesh file")
    recipe_toml = existing_file(recipe, "recipe").read_text(encoding="utf-8", errors="replace") if recipe else None
    with connect(url, run) as client:
        with output.progress(quiet=json) as report:
            uploaded = client.upload(part, checked_units(units), lambda done, total: report(f"sending {part.name}", done / total))
        if not json:
            low, high = uploaded["bbox_mm"]
            size = " × ".join(f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
            output.line(f"{part.name}: {size} mm (file in {uploaded['units']}), {uploaded['facets']} facets")
            for finding in uploaded["findings"]:
                output.line(f"  {finding['text']}")
        job = client.submit(uploaded["id"], recipe_toml=recipe_toml, name=name, cell=cell)
        if approve_it:
            job = follow(client, job["id"], quiet=json)
            if job["state"] in WAITS_FOR_PEOPLE:
                job = client.approve(job["id"], because="approved on the command line", table_clear=table_clear)
        show_job(job, json)
    raise typer.Exit(1 if job["state"] == "failed" else 0)


def show_job(job: Job, json: bool) -> None:
    """Print one job."""
    if json:
        output.as_json(job)
        return
    output.line(f"{job['id']}  {job['state']}" + (f": {job['why']}" if job["why"] else ""))
    if job["error"]:
        output.line(f"  {job['error']['title']}: {job['error']['detail']}")
        if job["error"]["hint"]:
            output.line(f"  hint: {job['error']['hint']}")


def jobs(
    state: Annotated[str | None, typer.Option("--state", help="Only jobs in this state.")] = None,
    tag: Annotated[str | None, typer.Option("--tag", help="Only jobs with this tag.")] = None,
    text: Annotated[str | None, typer.Option("--text", help="Only jobs with these words in name, tags, reason or notes.")] = None,
    by: Annotated[str | None, typer.Option("--by", help="Only jobs that this person submitted.")] = None,
    cell: Annotated[str | None, typer.Option("--cell", help="Only jobs of this cell; any: those that wait for one.")] = None,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """All jobs, newest first."""
    with connect(url, run) as client:
        found = list(client.jobs(state, tag=tag, text=text, by=by, cell=cell))
    if json:
        output.as_json(found)
        return
    rows = [
        (
            job["id"],
            job["name"],
            job["state"],
            f"{100 * job['progress']:.0f} %",
            job["why"] or (job["error"]["detail"] if job["error"] else ""),
        )
        for job in found
    ]
    output.table(("id", "name", "state", "done", "why"), rows)


def follow(client: Client, job_id: str, quiet: bool) -> Job:
    """Show a job's way until it ends or waits for a person; the job then."""
    import time

    with output.progress(quiet) as report:
        while True:
            job = client.job(job_id)
            stage = job["state"] if job["stage"] == job["state"] else f"{job['state']}: {job['stage']}"
            report(stage, job["progress"])
            waits = job["state"] in WAITS_FOR_PEOPLE or (job["state"] == "queued" and not job["table_clear"])
            if job["state"] in ENDED or waits:
                return job
            time.sleep(WATCH_PERIOD_S)


def watch(job: JobId, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False) -> None:
    """Follow a job until it ends or waits for a person. Exit 1 if it failed."""
    with connect(url, run) as client:
        seen = follow(client, find_job(client, job), quiet=json)
    show_job(seen, json)
    raise typer.Exit(1 if seen["state"] in ("failed", "aborted", "interrupted") else 0)


def approve(
    job: JobId,
    because: Because = "",
    override_reason: Annotated[
        str, typer.Option("--override-reason", help="Engineers: why it may run without a passing proof.")
    ] = "",
    table_clear: TableClear = False,
    part_untouched: PartUntouched = False,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """Approve a job whose proof passed."""
    found = {"table_clear": table_clear, "part_untouched": part_untouched}
    with connect(url, run) as client:
        job_id = find_job(client, job)
        show_job(client.approve(job_id, because=because, override_reason=override_reason, **found), json)


def cancel(
    job: JobId, because: Because = "", url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Cancel a job that is not on the cell."""
    with connect(url, run) as client:
        show_job(client.cancel(find_job(client, job), because), json)


def _command(
    verb: str, because: str, url: str | None, run: Path, json: bool, *, takes_control: bool = False, **fields: object
) -> None:
    with connect(url, run) as client:
        if takes_control:
            client.take_control(because or f"to {verb} on the command line")
        answer = client.command(verb, because, **fields)
    if json:
        output.as_json(answer)
    else:
        output.line(f"{verb}: accepted, the cell is {answer['state']}")


def hold(
    because: Because = "", take: TakeControl = False, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Hold: laser off, decelerate, stand still; can be resumed."""
    _command("hold", because, url, run, json, takes_control=take)


def resume(
    because: Because = "", take: TakeControl = False, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Resume a held job."""
    _command("resume", because, url, run, json, takes_control=take)


def abort(
    because: Because = "", take: TakeControl = False, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Abort the job."""
    _command("abort", because, url, run, json, takes_control=take)


def reset(
    because: Because = "", take: TakeControl = False, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Reset a latched fault or stop, once its cause is removed."""
    _command("reset", because, url, run, json, takes_control=take)


def stop(because: Because = "", url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False) -> None:
    """Stop everything now: laser off, powder off, motion stopped. Leaves by reset."""
    _command("stop", because, url, run, json)


def home(
    because: Because = "", take: TakeControl = False, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Home the machine."""
    _command("home", because, url, run, json, takes_control=take)


def unlock(
    because: Because = "", take: TakeControl = False, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Unlock the machine without homing. No job starts until it is homed or its position is confirmed."""
    _command("unlock", because, url, run, json, takes_control=take)


def confirm_position(
    because: Because = "", take: TakeControl = False, url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False
) -> None:
    """Vouch for the machine's position after an unlock; --because says how it was checked."""
    _command("confirm_position", because, url, run, json, takes_control=take)


def jog(
    axis: Annotated[str, typer.Argument(help="Letter of the axis.")],
    distance: Annotated[float, typer.Argument(help="mm or degrees, with its sign.")],
    feed: Annotated[float, typer.Option("--feed", help="mm or degrees per minute.")] = 500.0,
    because: Because = "",
    take: TakeControl = False,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """Jog one axis by a step, with the laser locked out."""
    _command("jog", because, url, run, json, takes_control=take, axis=axis.upper(), distance=distance, feed=feed)


def override(
    percent: Annotated[int, typer.Argument(min=10, max=200, help="Feed in percent of the programmed one; 100: as programmed.")],
    because: Because = "",
    take: TakeControl = False,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """Feed override of the machine; below 100 % the laser's power follows."""
    _command("override", because, url, run, json, takes_control=take, feed_percent=percent)


def control(
    release: Annotated[bool, typer.Option("--release", help="Give control back.")] = False,
    take: TakeControl = False,
    because: Because = "",
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """Who has control of the cell; take it over or give it back."""
    with connect(url, run) as client:
        if take:
            output.line(f"{client.take_control(because)['data']['holder']} has control")
            return
        if release:
            client.release_control()
        held = None if release else client.snapshot()["control"]
    if json:
        output.as_json({"control": held})
    elif held is None:
        output.line("nobody has control")
    else:
        output.line(f"{held['holder']} has control ({held['client']})" + (", not heard for a while" if held.get("absent") else ""))
