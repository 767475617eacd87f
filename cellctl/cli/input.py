"""What the commands are given: options that several share, files that exist, the service and its token."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import ssl

    from cellctl.client import Client

HOME = Path(".cellctl")

Json = Annotated[bool, typer.Option("--json", help="Machine-readable output.")]
CellName = Annotated[str, typer.Option("--cell", help="Cell file, or the name of a shipped one.")]
StoreFolder = Annotated[Path, typer.Option("--store", help="Folder of the store.", envvar="CELLCTL_STORE")]
RunFolder = Annotated[
    Path, typer.Option("--run", help="Run directory: sockets, simulated ports, logs.", envvar="CELLCTL_RUN")
]
Url = Annotated[
    str | None, typer.Option("--url", help="The service. Default: the one that runs in --run.", envvar="CELLCTL_URL")
]
Units = Annotated[str, typer.Option("--units", help="What the numbers of the file mean: mm or inch.")]
Because = Annotated[str, typer.Option("--because", help="Why; the operator reads it.")]
JobId = Annotated[str, typer.Argument(metavar="JOB", help="Its id, the end of its id, or `last`.")]
DEFAULT_STORE = HOME
DEFAULT_RUN = HOME / "run"
DEFAULT_CELL = "trunnion_tcp"


class InputFault(Exception):
    """What was given on the command line cannot be used. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def existing_file(path: Path, what: str) -> Path:
    """The path, if it is a file that can be read. Raises InputFault."""
    if path.is_dir():
        raise InputFault(f"{path}: is a folder, not a {what}", f"name a {what}")
    if not path.is_file():
        raise InputFault(f"{path}: there is no such file", f"name a {what} that exists")
    if not os.access(path, os.R_OK):
        raise InputFault(f"{path}: may not be read", "look at the file's permissions")
    return path


def checked_units(units: str) -> str:
    """mm or inch. Raises InputFault."""
    if units not in ("mm", "inch"):
        raise InputFault(f"--units {units}: is neither mm nor inch", "say what the numbers of the file mean")
    return units


def writable(path: Path) -> Path:
    """The path of a file to be written; its folder is made. Raises InputFault."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputFault(f"{path}: cannot be written: {error.strerror}", "name a place that can be written") from None
    if path.is_dir():
        raise InputFault(f"{path}: is a folder", "name a file")
    return path


def connect(url: str | None, run: Path) -> Client:
    """A client of the service that is named, or of the one that runs here. The token comes from CELLCTL_TOKEN or the local store.

    Raises InputFault if there is no service or no token.
    """
    from cellctl.client import Client

    token = os.environ.get("CELLCTL_TOKEN", "")
    cert = os.environ.get("CELLCTL_CA")
    if url is None:
        try:
            address = json.loads((run / "service.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise InputFault(
                f"no service runs in {run}", "start one with `cellctl serve`, or name one with --url"
            ) from None
        url = str(address["url"])
        cert = address.get("tls_cert")
        kept = Path(address["store"]) / "operator.token"
        if not token and kept.is_file() and os.access(kept, os.R_OK):
            token = kept.read_text(encoding="ascii").strip()
    if not token:
        raise InputFault(
            "no token", "put one into CELLCTL_TOKEN; `cellctl token create NAME --role operator` makes one"
        )
    return Client(url, token, verify=_trusted(url, cert))


def _trusted(url: str, cert: str | None) -> ssl.SSLContext | bool:
    """What a client believes: the certificate of the service that runs here, or the authority in CELLCTL_CA, else the usual ones."""
    import ssl

    from cellctl.tls import certificate, pinned_context

    if cert is None or not url.startswith("https:"):
        return True
    path = existing_file(Path(cert), "certificate")
    if cert != os.environ.get("CELLCTL_CA"):
        return pinned_context(path)
    certificate(path)
    return ssl.create_default_context(cafile=path)


def find_job(client: Client, given: str) -> str:
    """The id of a job from its id, the end of it, or `last`. Raises InputFault."""
    if given.startswith("job-"):
        return given
    found = [str(job["id"]) for job in client.jobs()]
    chosen = found[:1] if given == "last" else [job_id for job_id in found if job_id.endswith(given)]
    if len(chosen) != 1:
        raise InputFault(
            f"{given}: {'no job' if not chosen else f'{len(chosen)} jobs'} like that", "`cellctl jobs` lists them"
        )
    return chosen[0]
