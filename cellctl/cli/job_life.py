"""Commands of a job's life: the queue and its order, the table, a job once more, and notes."""

from __future__ import annotations

import secrets
from typing import Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_RUN, Because, InputFault, JobId, Json, RunFolder, Url, connect, find_job
from cellctl.cli.remote import show_job

WAYS = ("first", "last", "up", "down")


def queue(
    move: Annotated[str | None, typer.Option("--move", metavar="JOB", help="A job to be moved; --to says where.")] = None,
    to: Annotated[str, typer.Option("--to", help="first, last, up, down, or a position from 0.")] = "up",
    planning: Annotated[bool, typer.Option("--planning", help="The queue before the planner.")] = False,
    because: Because = "",
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """The queue in its order, with what each job waits for; with --move a job takes another place."""
    if to not in WAYS and not to.isdigit():
        raise InputFault(f"--to {to}: is no place", f"one of {', '.join(WAYS)}, or a position from 0")
    lane = "planning" if planning else "cell"
    with connect(url, run) as client:
        if move is not None:
            where = {"to": to} if to in WAYS else {"position": int(to)}
            client.post(f"queue/move?lane={lane}", {"job": find_job(client, move), **where, "because": because})
        shown = client.get("queue", lane=lane, limit=200)
    if json:
        output.as_json(shown)
        return
    rows = [(str(number), job["id"], job["name"], str(job["priority"]), job["why"]) for number, job in enumerate(shown["items"])]
    output.table(("place", "id", "name", "priority", "waits for"), rows)


def table(
    clear: Annotated[bool, typer.Option("--clear", help="I looked: the part is off, the table is clear and the substrate is clamped.")] = False,
    start: Annotated[str | None, typer.Option("--start", metavar="JOB", help="With --clear: a queued job that may start on it.")] = None,
    because: Because = "",
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """What lies on the cell's table; with --clear a person vouches that it is clear."""
    if start is not None and not clear:
        raise InputFault("--start without --clear", "look at the table first, then give both")
    with connect(url, run) as client:
        if clear:
            shown = client.post("table/clear", {"because": because, "start": find_job(client, start) if start else None})
        else:
            shown = client.get("table")
    output.as_json(shown) if json else output.line(shown["text"])


def rerun(job: JobId, because: Because = "", url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False) -> None:
    """A new job of the same part and recipe; what was planned and proved is used again. It has to be approved anew."""
    with connect(url, run) as client:
        show_job(client.rerun(find_job(client, job), because), json)


def retry(job: JobId, because: Because = "", url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False) -> None:
    """A new job that goes on at the step at which a failed one ended, before it came to the cell."""
    with connect(url, run) as client:
        show_job(client.retry(find_job(client, job), because), json)


def note(
    job: JobId,
    text: Annotated[str | None, typer.Argument(help="Words to be added; without them all notes are shown.")] = None,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """The notes of a job, and a new one. Notes stay."""
    with connect(url, run) as client:
        path = f"jobs/{find_job(client, job)}/notes"
        if text is not None:
            client.post(path, {"text": text}, secrets.token_hex(16))
        shown = client.get(path)
    if json:
        output.as_json(shown)
        return
    for one in shown["items"]:
        output.line(f"{one['who']}: {one['text']}")
