"""The cells of the house on the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_RUN, Json, RunFolder, Url, connect

if TYPE_CHECKING:
    from cellctl.client_documents import FleetCell


def fleet(url: Url = None, run: RunFolder = DEFAULT_RUN, json: Json = False) -> None:
    """All cells of the house: what each does, how many jobs wait for it, and how old that news is."""
    with connect(url, run) as client:
        found = client.fleet()
    if json:
        output.as_json(found)
        return
    columns = ("cell", "state", "job", "left", "waiting", "alarms", "heard", "because")
    output.table(columns, [_row(cell) for cell in found["cells"]])
    if found["unassigned"]:
        output.line(f"{found['unassigned']} jobs for any cell: none was chosen yet")


def _row(cell: FleetCell) -> tuple[str, ...]:
    job = cell["job"]
    left = job["remaining_s"] if job is not None else None
    heard = f"{cell['age_s']:.0f} s ago" if cell["heard"] == "living" else f"{cell['heard']}, {output.duration(cell['age_s'])} ago"
    return (
        cell["cell"] + (" (here)" if cell["here"] else ""),
        cell["state"] or "no answer",
        job["name"] if job is not None else "",
        output.duration(left) if left is not None else "",
        str(cell["queued"]),
        str(cell["alarms"]) if cell["alarms"] else "",
        heard,
        cell["because"],
    )
