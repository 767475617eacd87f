"""The audit trail of the local store, on the command line."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_STORE, InputFault, Json, StoreFolder

Text = str | None


def audit(
    verify: Annotated[bool, typer.Option("--verify", help="Look whether the trail is as it was written. Exit 1 if not.")] = False,
    anchor: Annotated[str, typer.Option("--anchor", help="With --verify: a hash noted earlier, which must still be there.")] = "",
    who: Annotated[Text, typer.Option("--who", help="Only what this person or token did.")] = None,
    verb: Annotated[Text, typer.Option("--verb", help="Only this, as in 'sign in' or 'stop'.")] = None,
    target: Annotated[Text, typer.Option("--target", help="Only what was done to this job, part, user or cell.")] = None,
    since: Annotated[Text, typer.Option("--since", help="From this time on (ISO 8601; UTC unless it says otherwise).")] = None,
    limit: Annotated[int, typer.Option("--limit", min=1, max=100_000, help="At most so many, the newest.")] = 50,
    store: StoreFolder = DEFAULT_STORE,
    json: Json = False,
) -> None:
    """Who did what, from where and why; the newest first."""
    from cellctl.store import audit as trail
    from cellctl.store import open_store

    if verify:
        _verify(store, anchor, json)
        return
    wanted = trail.Wanted(who, verb, target, _time(since) if since is not None else None)
    opened = open_store(store)
    try:
        with opened.read() as rows:
            found = [dict(row) for row in trail.find_page(rows, wanted, None, limit)[0]]
    finally:
        opened.close()
    if json:
        output.as_json(found)
        return
    columns = ("time (UTC)", "who", "role", "from", "what", "to", "because", "outcome")
    cells = [(_shown(row["at"]), *(str(row[name]) for name in ("who", "role", "origin", "verb", "target", "because", "outcome"))) for row in found]
    output.table(columns, cells)


def _verify(store: Path, anchor: str, json: bool) -> None:
    from cellctl.store import audit as trail
    from cellctl.store import open_store

    opened = open_store(store)
    try:
        with opened.read() as rows:
            verdict = trail.verify(rows, anchor)
    finally:
        opened.close()
    if json:
        output.as_json(verdict.__dict__)
    elif verdict.fault:
        output.line(f"THE TRAIL WAS CHANGED: {verdict.fault}; the {verdict.rows} rows before are as they were written")
    else:
        output.line(f"{verdict.rows} rows, all as they were written; hash of the last one (note it elsewhere): {verdict.head or 'none'}")
    raise typer.Exit(1 if verdict.fault else 0)


def _shown(at: float) -> str:
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M:%S")


def _time(given: str) -> float:
    try:
        time = datetime.fromisoformat(given)
    except ValueError:
        raise InputFault(f"--since {given}: is no time", "as in 2026-03-01 or 2026-03-01T14:00") from None
    return (time if time.tzinfo is not None else time.replace(tzinfo=UTC)).timestamp()
