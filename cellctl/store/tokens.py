"""Tokens and sessions: 256 random bits each, kept as SHA-256 only. Such secrets cannot be guessed, so no slow hash is needed."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update

from cellctl.store.ids import new_id
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import sessions, tokens

PREFIX = "cell_"
SESSION_S = 12 * 3600.0  # one shift


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


@dataclass(frozen=True)
class TokenRow:
    """One token, without its secret."""

    id: str
    name: str
    role: Role
    created_at: float
    expires_at: float | None
    revoked_at: float | None


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def _row(values: RowMapping) -> TokenRow:
    fields = {name: values[name] for name in TokenRow.__dataclass_fields__}
    return TokenRow(**{**fields, "role": Role(fields["role"])})


def create(
    connection: Connection, name: str, role: Role, at: float, lifetime_s: float | None = None
) -> tuple[TokenRow, str]:
    """A new token and its secret, which is nowhere else."""
    secret = PREFIX + secrets.token_urlsafe(32)
    row = TokenRow(new_id("token", at), name, role, at, at + lifetime_s if lifetime_s is not None else None, None)
    connection.execute(insert(tokens).values(**{**row.__dict__, "role": role.value}, sha256=_digest(secret)))
    return row, secret


def every(connection: Connection) -> list[TokenRow]:
    """All tokens, oldest first, revoked ones too."""
    return [
        _row(row) for row in connection.execute(select(tokens).order_by(tokens.c.created_at, tokens.c.id)).mappings()
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
    return _row(row)


def _valid(row: RowMapping | None, at: float) -> TokenRow | None:
    if row is None or row["revoked_at"] is not None or (row["expires_at"] is not None and row["expires_at"] <= at):
        return None
    return _row(row)


def find(connection: Connection, secret: str, at: float) -> TokenRow | None:
    """The valid token with this secret. Looked up by hash, so timing tells nothing of the secret."""
    return _valid(connection.execute(select(tokens).where(tokens.c.sha256 == _digest(secret))).mappings().first(), at)


def open_session(connection: Connection, token: TokenRow, at: float) -> str:
    """A new session's secret, for the cookie."""
    secret = secrets.token_urlsafe(32)
    connection.execute(delete(sessions).where(sessions.c.expires_at <= at))
    connection.execute(
        insert(sessions).values(sha256=_digest(secret), token_id=token.id, created_at=at, expires_at=at + SESSION_S)
    )
    return secret


def find_by_session(connection: Connection, secret: str, at: float) -> TokenRow | None:
    """The valid token behind an open session."""
    query = select(tokens).join(sessions, sessions.c.token_id == tokens.c.id)
    query = query.where(sessions.c.sha256 == _digest(secret), sessions.c.expires_at > at)
    return _valid(connection.execute(query).mappings().first(), at)


def close_session(connection: Connection, secret: str) -> None:
    """End a session; twice is harmless."""
    connection.execute(delete(sessions).where(sessions.c.sha256 == _digest(secret)))


def count_valid(connection: Connection, at: float, role: Role | None = None) -> int:
    """How many valid tokens there are, of one role or any."""
    query = select(func.count()).select_from(tokens).where(tokens.c.revoked_at.is_(None))
    query = query.where((tokens.c.expires_at.is_(None)) | (tokens.c.expires_at > at))
    if role is not None:
        query = query.where(tokens.c.role == role.value)
    return int(connection.execute(query).scalar_one())
