"""Users: people with a name, a role and a password, of which the argon2 hash is kept."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update

from cellctl.store.ids import new_id
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import sessions, users
from cellctl.store.tokens import Role

NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")


class UserNameError(Exception):
    """A name that is none, or that somebody has. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class LastAdminError(Exception):
    """The change would leave nobody who may make users. `message`, `hint` : one line each"""

    def __init__(self, name: str) -> None:
        self.message = f"{name} is the only admin"
        self.hint = "make another admin first"
        super().__init__(self.message)


@dataclass(frozen=True)
class UserRow:
    """One user. password_at : when the password was set; disabled_at : from when on nobody signs in as this one"""

    id: str
    name: str
    role: Role
    password_hash: str
    created_at: float
    password_at: float
    disabled_at: float | None = None


def plain_name(name: str) -> str:
    """A name as it is kept: small letters, no blanks around it."""
    return name.strip().lower()


def _row(values: RowMapping) -> UserRow:
    return UserRow(**{**{name: values[name] for name in UserRow.__dataclass_fields__}, "role": Role(values["role"])})


def create(connection: Connection, name: str, role: Role, password_hash: str, at: float) -> UserRow:
    """A new user. Raises UserNameError."""
    wanted = plain_name(name)
    if not NAME.fullmatch(wanted):
        raise UserNameError(f"{name[:60]!r} is no name for a user", "letters a-z, digits and . _ -, at most 64, a letter or digit first")
    if find(connection, name=wanted) is not None:
        raise UserNameError(f"there is a user {wanted} already", "take another name, or set that one's password")
    row = UserRow(new_id("user", at), wanted, role, password_hash, at, at)
    connection.execute(insert(users).values(**{**row.__dict__, "role": role.value}))
    return row


def find(connection: Connection, *, name: str | None = None, user_id: str | None = None) -> UserRow | None:
    """The user of this name or id, None if there is none."""
    query = select(users).where(users.c.name == plain_name(name)) if name is not None else select(users).where(users.c.id == user_id)
    row = connection.execute(query).mappings().first()
    return _row(row) if row is not None else None


def get(connection: Connection, name: str) -> UserRow:
    """The user of this name. Raises NotFoundError."""
    row = find(connection, name=name)
    if row is None:
        raise NotFoundError("user", plain_name(name)[:60])
    return row


def every(connection: Connection) -> list[UserRow]:
    """All users by name, disabled ones too."""
    return sorted((_row(row) for row in connection.execute(select(users)).mappings()), key=lambda row: row.name)  # in every locale alike


def count_active(connection: Connection, role: Role | None = None) -> int:
    """How many users can sign in, of one role or any."""
    query = select(func.count()).select_from(users).where(users.c.disabled_at.is_(None))
    if role is not None:
        query = query.where(users.c.role == role.value)
    return int(connection.execute(query).scalar_one())


def _keep_an_admin(connection: Connection, row: UserRow) -> None:
    if row.role is Role.ADMIN and row.disabled_at is None and count_active(connection, Role.ADMIN) == 1:
        raise LastAdminError(row.name)


def set_password(connection: Connection, name: str, password_hash: str, at: float, keep_session: str = "") -> UserRow:
    """A new password: every session of this user ends but one (SHA-256). Raises NotFoundError."""
    row = get(connection, name)
    connection.execute(update(users).where(users.c.id == row.id).values(password_hash=password_hash, password_at=at))
    connection.execute(delete(sessions).where(sessions.c.user_id == row.id, sessions.c.sha256 != keep_session))
    return replace(row, password_hash=password_hash, password_at=at)


def rehash(connection: Connection, row: UserRow, password_hash: str) -> None:
    """The same password by newer parameters, unless it was changed meanwhile."""
    same = (users.c.id == row.id) & (users.c.password_hash == row.password_hash)
    connection.execute(update(users).where(same).values(password_hash=password_hash))


def set_role(connection: Connection, name: str, role: Role) -> UserRow:
    """Another role, at once. Raises NotFoundError, LastAdminError."""
    row = get(connection, name)
    if role is not Role.ADMIN:
        _keep_an_admin(connection, row)
    connection.execute(update(users).where(users.c.id == row.id).values(role=role.value))
    return replace(row, role=role)


def set_disabled(connection: Connection, name: str, disabled: bool, at: float) -> UserRow:
    """Nobody signs in as this user any more and the sessions end, or it may sign in again; twice is harmless.

    Raises NotFoundError, LastAdminError.
    """
    row = get(connection, name)
    if disabled == (row.disabled_at is not None):
        return row
    if disabled:
        _keep_an_admin(connection, row)
        connection.execute(delete(sessions).where(sessions.c.user_id == row.id))
    disabled_at = at if disabled else None
    connection.execute(update(users).where(users.c.id == row.id).values(disabled_at=disabled_at))
    return replace(row, disabled_at=disabled_at)
