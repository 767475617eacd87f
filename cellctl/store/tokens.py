"""Tokens: 256 random bits each, kept as SHA-256 only. Such secrets cannot be guessed, so no slow hash is needed."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update

from cellctl.store.ids import new_id
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import sessions, tokens

PREFIX = "cell_"


class Role(StrEnum):
    """What a person or program may do; each may do what those before it may."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    ENGINEER = "engineer"
    ADMIN = "admin"

    def includes(self, other: Role) -> bool:
        """Whether this role may do what `other` may."""
        order = list(Role)
        return order.index(self) >= order.index(other)


class Scope(StrEnum):
    """An area that a token is good for, within its role: look; change parts, jobs and facts; command the cell; people and tokens."""

    READ = "read"
    JOBS = "jobs"
    CELL = "cell"
    ADMIN = "admin"


ALL_SCOPES = tuple(Scope)


@dataclass(frozen=True)
class TokenRow:
    """One token, without its secret. scopes : all of them unless it was made narrower"""

    id: str
    name: str
    role: Role
    created_at: float
    expires_at: float | None
    revoked_at: float | None
    scopes: tuple[Scope, ...] = ALL_SCOPES


def digest(secret: str) -> str:
    """Under which a secret is kept."""
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()


def row_of(values: RowMapping) -> TokenRow:
    """A row of the table."""
    fields = {name: values[name] for name in TokenRow.__dataclass_fields__}
    scopes = tuple(Scope(word) for word in fields["scopes"].split()) or ALL_SCOPES
    return TokenRow(**{**fields, "role": Role(fields["role"]), "scopes": scopes})


def create(
    connection: Connection, name: str, role: Role, at: float, lifetime_s: float | None = None, scopes: Iterable[Scope] = ()
) -> tuple[TokenRow, str]:
    """A new token and its secret, which is nowhere else. scopes : none named means all"""
    secret = PREFIX + secrets.token_urlsafe(32)
    chosen = tuple(scope for scope in Scope if scope in set(scopes)) or ALL_SCOPES
    expires_at = at + lifetime_s if lifetime_s is not None else None
    row = TokenRow(new_id("token", at), name, role, at, expires_at, None, chosen)
    values = {**row.__dict__, "role": role.value, "scopes": "" if chosen == ALL_SCOPES else " ".join(chosen)}
    connection.execute(insert(tokens).values(**values, sha256=digest(secret)))
    return row, secret


def every(connection: Connection) -> list[TokenRow]:
    """All tokens, oldest first, revoked ones too."""
    return [
        row_of(row) for row in connection.execute(select(tokens).order_by(tokens.c.created_at, tokens.c.id)).mappings()
    ]


def revoke(connection: Connection, token_id: str, at: float) -> TokenRow:
    """End a token and its sessions; twice is harmless. Raises NotFoundError."""
    connection.execute(
        update(tokens).where(tokens.c.id == token_id, tokens.c.revoked_at.is_(None)).values(revoked_at=at)
    )
    connection.execute(delete(sessions).where(sessions.c.token_id == token_id))
    row = connection.execute(select(tokens).where(tokens.c.id == token_id)).mappings().first()
    if row is None:
        raise NotFoundError("token", token_id)
    return row_of(row)


def valid(row: RowMapping | None, at: float) -> TokenRow | None:
    """The token, None if there is none or it is revoked or has expired."""
    if row is None or row["revoked_at"] is not None or (row["expires_at"] is not None and row["expires_at"] <= at):
        return None
    return row_of(row)


def find(connection: Connection, secret: str, at: float) -> TokenRow | None:
    """The valid token with this secret. Looked up by hash, so timing tells nothing of the secret."""
    key = digest(secret)
    row = connection.execute(select(tokens).where(tokens.c.sha256 == key)).mappings().first()
    if row is not None and not hmac.compare_digest(row["sha256"], key):
        return None
    return valid(row, at)


def count_valid(connection: Connection, at: float, role: Role | None = None) -> int:
    """How many valid tokens there are, of one role or any."""
    query = select(func.count()).select_from(tokens).where(tokens.c.revoked_at.is_(None))
    query = query.where((tokens.c.expires_at.is_(None)) | (tokens.c.expires_at > at))
    if role is not None:
        query = query.where(tokens.c.role == role.value)
    return int(connection.execute(query).scalar_one())
