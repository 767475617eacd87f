"""`cellctl record`: what is known of a job, its sealed files, and whether they are still what was sealed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_RUN, InputFault, Json, RunFolder, Url, connect, existing_file, find_job, writable

if TYPE_CHECKING:
    from cellctl.client import Client


def record(
    job: Annotated[str | None, typer.Argument(metavar="JOB", help="Its id, the end of its id, or `last`.")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write all files of the sealed record into this folder.")] = None,
    html: Annotated[Path | None, typer.Option("--html", help="Write the record as a page.")] = None,
    parquet: Annotated[Path | None, typer.Option("--parquet", help="Write the raw samples of the run.")] = None,
    verify: Annotated[Path | None, typer.Option("--verify", help="Check this folder: was anything changed since it was sealed?")] = None,
    key: Annotated[Path | None, typer.Option("--key", help="With --verify: public key of the service (PEM), from elsewhere than the record.")] = None,
    url: Url = None,
    run: RunFolder = DEFAULT_RUN,
    json: Json = False,
) -> None:
    """A job's record: what was commanded, read back and done by whom. With --verify it needs no service."""
    if verify is not None:
        _verify(verify, key, json)
        return
    if job is None:
        raise InputFault("record: no job is named", "cellctl record JOB, or --verify FOLDER")
    with connect(url, run) as client:
        job_id = find_job(client, job)
        for path, form in ((html, "html"), (parquet, "parquet")):
            if path is not None:
                writable(path).write_bytes(client.content(f"jobs/{job_id}/record", format=form))
                output.line(f"{path}")
        if out is not None:
            _fetch(client, job_id, out)
        if html is not None or parquet is not None or out is not None:
            return
        document = client.record(job_id)
    if json:
        output.as_json(document)
    else:
        _show(document)


def _fetch(client: Client, job_id: str, folder: Path) -> None:
    """All files of the sealed record, and whether they are what was sealed."""
    from cellctl.record.seal import verify

    if folder.exists() and any(folder.iterdir()):
        raise InputFault(f"{folder}: is not empty", "name a new folder: a sealed record holds its own files alone")
    seal = client.get(f"jobs/{job_id}/record/seal")
    folder.mkdir(parents=True, exist_ok=True)
    for file in seal["files"]:
        (folder / Path(file["name"]).name).write_bytes(client.content(f"jobs/{job_id}/record/files/{file['name']}"))
    manifest = verify(folder, client.get("record-key")["public_pem"].encode("ascii"))
    output.line(f"{folder}: {len(manifest['files'])} files, unchanged since they were sealed; key {manifest['key'][:16]}…")


def _verify(folder: Path, key: Path | None, json: bool) -> None:
    """Raises SealError with what was changed."""
    from cellctl.record.seal import verify

    if not folder.is_dir():
        raise InputFault(f"{folder}: there is no such folder", "name the folder that `cellctl record JOB -o FOLDER` wrote")
    manifest = verify(folder, existing_file(key, "public key").read_bytes() if key is not None else None)
    if json:
        output.as_json({"verified": True, **manifest})
        return
    output.line(f"{folder}: nothing was changed, taken away or added; job {manifest['job']}")
    whose = "the key that was given" if key is not None else "the key beside it; compare this fingerprint with the service's (GET /api/v1/record-key)"
    output.line(f"  sealed with {whose}: {manifest['key']}")


def _show(document: dict[str, Any]) -> None:
    """In lines for a person."""
    output.line(f"{document['job']['name']}: {document['job']['state']}")
    for name, value in document["sha256"].items():
        output.line(f"  {name:8} {value or ''}")
    for row in document["layers"]:
        power = f"laser {row['laser_setpoint_max_w']:.0f} W set, {row['laser_readback_max_w']:.0f} W read"
        output.line(
            f"  layer {row['layer']}: {power}; powder {row['powder_setpoint_max_g_min']:.1f} g/min set, {row['powder_readback_max_g_min']:.1f} read"
        )
    for lot in document["consumables"]:
        output.line(f"  {lot['kind']}: lot {lot['lot']} {lot['material']}".rstrip())
    for event in document["events"]:
        output.line(f"  {event['kind']}: {event['text']}")
