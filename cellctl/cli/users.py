"""Users, made in the store itself: who may write its folder may do this. Passwords come from a prompt or stdin, never from the command line."""

from __future__ import annotations

import getpass
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import local_store, output
from cellctl.cli.input import DEFAULT_STORE, InputFault, Json, StoreFolder
from cellctl.cli.tokens import asked_role, day

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from cellctl.store.users import UserRow

app = typer.Typer(help="Make, list, change and disable users of the local store.", no_args_is_help=True)
Name = Annotated[str, typer.Argument(help="The user's name.")]
Role = Annotated[str, typer.Option("--role", help="viewer, operator, engineer or admin.")]


def asked_password(name: str) -> str:
    """A new password: asked for twice at a terminal, else the first line of stdin. Raises InputFault, PasswordError."""
    from cellctl import passwords

    if sys.stdin.isatty():
        password = getpass.getpass(f"New password of {name}: ")
        if getpass.getpass("Again: ") != password:
            raise InputFault("the two passwords differ", "type it again")
    else:
        password = sys.stdin.readline().rstrip("\r\n")
    passwords.check(password, name)
    return password


def change(store: Path, verb: str, how: Callable[[Connection, float], UserRow], outcome: str = "ok") -> UserRow:
    """Change a user and write it down. Raises InputFault."""
    return local_store.change(store, verb, how, lambda row: row.name, "user", outcome)


def shown(row: UserRow) -> dict[str, object]:
    """A user without the password's hash."""
    return {key: value for key, value in row.__dict__.items() if key != "password_hash"}


def told(row: UserRow, text: str, json: bool) -> None:
    """Say what was done."""
    if json:
        output.as_json(shown(row))
    else:
        output.line(text)


@app.command()
def add(name: Name, role: Role = "operator", store: StoreFolder = DEFAULT_STORE, json: Json = False) -> None:
    """Make a user. The password is asked for, or read from stdin."""
    from cellctl import passwords
    from cellctl.store import upgrade, users

    wanted = asked_role(role)
    upgrade(store)
    kept = passwords.hashed(asked_password(name))
    row = change(store, "create user", lambda rows, at: users.create(rows, name, wanted, kept, at), f"ok: {wanted.value}")
    told(row, f"{row.name} can sign in as {row.role.value}", json)


@app.command("list")
def list_users(store: StoreFolder = DEFAULT_STORE, json: Json = False) -> None:
    """All users."""
    from cellctl.store import open_store, users

    opened = open_store(store)
    try:
        with opened.read() as rows:
            found = users.every(rows)
    finally:
        opened.close()
    if json:
        output.as_json([shown(row) for row in found])
        return
    cells = [(row.name, row.role.value, day(row.created_at), day(row.password_at), day(row.disabled_at)) for row in found]
    output.table(("name", "role", "created (UTC)", "password set", "disabled"), cells)


@app.command()
def password(name: Name, store: StoreFolder = DEFAULT_STORE, json: Json = False) -> None:
    """Set a user's password; its sessions end. The password is asked for, or read from stdin."""
    from cellctl import passwords
    from cellctl.store import users

    kept = passwords.hashed(asked_password(name))
    row = change(store, "set password", lambda rows, at: users.set_password(rows, name, kept, at))
    told(row, f"{row.name} has a new password; every session of {row.name} has ended", json)


@app.command()
def disable(name: Name, store: StoreFolder = DEFAULT_STORE, json: Json = False) -> None:
    """Nobody signs in as this user any more; its sessions end."""
    from cellctl.store import users

    row = change(store, "disable user", lambda rows, at: users.set_disabled(rows, name, True, at))
    told(row, f"{row.name} is disabled", json)


@app.command()
def enable(name: Name, store: StoreFolder = DEFAULT_STORE, json: Json = False) -> None:
    """A disabled user may sign in again."""
    from cellctl.store import users

    row = change(store, "enable user", lambda rows, at: users.set_disabled(rows, name, False, at))
    told(row, f"{row.name} can sign in as {row.role.value}", json)


@app.command("role")
def set_role(
    name: Name, role: Annotated[str, typer.Argument(help="viewer, operator, engineer or admin.")],
    store: StoreFolder = DEFAULT_STORE, json: Json = False,
) -> None:  # fmt: skip
    """Give a user another role, at once."""
    from cellctl.store import users

    wanted = asked_role(role)
    row = change(store, "change role", lambda rows, _at: users.set_role(rows, name, wanted), f"ok: {wanted.value}")
    told(row, f"{row.name} is {row.role.value}", json)
