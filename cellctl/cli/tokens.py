"""Tokens, made in the store itself: who may write its folder may do this."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import local_store, output
from cellctl.cli.input import DEFAULT_STORE, InputFault, Json, StoreFolder

if TYPE_CHECKING:
    from cellctl.store.tokens import Role, Scope, TokenRow

app = typer.Typer(help="Make, list and revoke tokens of the local store.", no_args_is_help=True)


def asked_role(role: str) -> Role:
    """The role of this name. Raises InputFault."""
    from cellctl.store import tokens

    try:
        return tokens.Role(role)
    except ValueError:
        raise InputFault(f"--role {role}: there is no such role", "viewer, operator, engineer or admin") from None


def asked_scopes(words: list[str] | None) -> list[Scope]:
    """The scopes of these names. Raises InputFault."""
    from cellctl.store import tokens

    try:
        return [tokens.Scope(word) for word in words or []]
    except ValueError as error:
        raise InputFault(f"--scope: {error}", "read, jobs, cell or admin; several times for more") from None


def day(at: float | None) -> str:
    """A time as it is listed, UTC."""
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M") if at is not None else ""


def shown(row: TokenRow) -> dict[str, Any]:
    """A token, for programs."""
    return {**row.__dict__, "scopes": list(row.scopes)}


@app.command()
def create(
    name: Annotated[str, typer.Argument(help="Who will use it.")],
    role: Annotated[str, typer.Option("--role", help="viewer, operator, engineer or admin.")] = "operator",
    days: Annotated[
        float | None, typer.Option("--days", min=0.0, help="How long it is valid. Default: until revoked.")
    ] = None,
    scope: Annotated[
        list[str] | None, typer.Option("--scope", help="read, jobs, cell or admin; again for more. Default: all that the role may.")
    ] = None,
    store: StoreFolder = DEFAULT_STORE,
    json: Json = False,
) -> None:
    """Make a token and print it; it is nowhere else."""
    from cellctl.store import tokens, upgrade

    wanted, scopes = asked_role(role), asked_scopes(scope)
    upgrade(store)
    lasts_s = days * 86400.0 if days is not None else None
    row, secret = local_store.change(
        store, "create token", lambda rows, at: tokens.create(rows, name, wanted, at, lasts_s, scopes), lambda made: made[0].id, "token"
    )
    if json:
        output.as_json({**shown(row), "secret": secret})
    else:
        output.line(secret)


@app.command("list")
def list_tokens(store: StoreFolder = DEFAULT_STORE, json: Json = False) -> None:
    """All tokens, without their secrets."""
    from cellctl.store import open_store, tokens

    opened = open_store(store)
    try:
        with opened.read() as rows:
            found = tokens.every(rows)
    finally:
        opened.close()
    if json:
        output.as_json([shown(row) for row in found])
        return

    columns = ("id", "name", "role", "good for", "created (UTC)", "expires", "revoked")
    times = [(day(row.created_at), day(row.expires_at), day(row.revoked_at)) for row in found]
    output.table(columns, [(row.id, row.name, row.role, " ".join(row.scopes), *time) for row, time in zip(found, times, strict=True)])


@app.command()
def revoke(
    token: Annotated[str, typer.Argument(help="Its id.")], store: StoreFolder = DEFAULT_STORE, json: Json = False
) -> None:
    """End a token and its sessions."""
    from cellctl.store import tokens

    row = local_store.change(store, "revoke token", lambda rows, at: tokens.revoke(rows, token, at), lambda ended: ended.id, "token")
    if json:
        output.as_json(shown(row))
    else:
        output.line(f"{row.id} is revoked")
