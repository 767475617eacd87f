"""`cellctl backup` and `cellctl restore`: a store in one file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_STORE, Json, StoreFolder, existing_file, writable


def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A new file, such as store-2026-11-23.tar.")],
    store: StoreFolder = DEFAULT_STORE,
    json: Json = False,
) -> None:
    """Write a backup of the store; the service may go on working. It holds the key that seals records: keep it safe.

    Of a store that is shared: what this host has for itself; what else is to be backed up is told."""
    from cellctl.store.backup import back_up

    with output.progress(json) as told:
        made = back_up(store, writable(file), time.time(), told)
    if json:
        output.as_json(made.__dict__)
    else:
        output.line(f"{file}: {made.files} files, {made.bytes / 1e6:.1f} MB, schema {made.revision}")
        if made.not_in_it:
            output.line(f"not in it: {made.not_in_it}")


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `cellctl backup` wrote.")],
    store: StoreFolder = DEFAULT_STORE,
    json: Json = False,
) -> None:
    """Make a store from a backup, in a folder that is empty or not there yet; older ones are brought up to date at the next start."""
    from cellctl.store.backup import restore as bring_back

    with output.progress(json) as told:
        made = bring_back(existing_file(file, "backup"), store, told)
    if json:
        output.as_json(made.__dict__)
    else:
        output.line(f"{store}: {made.files} files, {made.bytes / 1e6:.1f} MB, schema {made.revision}")
        output.line(f"`cellctl serve --store {store}` goes on from there")
