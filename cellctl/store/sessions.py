"""Sessions of a browser, opened by a password or a token: a random secret in its cookie, of which only the SHA-256 is kept."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass

from sqlalchemy import ColumnElement, Connection, RowMapping, delete, insert, select, update

from cellctl.store import tokens, users
from cellctl.store.schema import sessions
from cellctl.store.schema import tokens as token_table
from cellctl.store.tokens import ALL_SCOPES, Role, Scope, TokenRow
from cellctl.store.users import UserRow

SESSION_S = 12 * 3600.0  # one shift: whoever stays longer signs in again
IDLE_S = 2 * 3600.0  # without a request or a page that follows the cell


@dataclass(frozen=True)
class Account:
    """Who was let in, by a token or as a user. session : SHA-256 of the session, "" for a token that was sent itself"""

    name: str
    role: Role
    scopes: tuple[Scope, ...]
    id: str
    is_user: bool
    session: str = ""


def of_token(row: TokenRow, session: str = "") -> Account:
    """What a token stands for."""
    return Account(row.name, row.role, row.scopes, row.id, False, session)


def of_user(row: UserRow, session: str = "") -> Account:
    """What a user stands for."""
    return Account(row.name, row.role, ALL_SCOPES, row.id, True, session)


def csrf_of(secret: str) -> str:
    """What a page of the session has to send with everything that changes something. Nobody can tell the secret from it."""
    return hmac.new(secret.encode("utf-8", "replace"), b"csrf", hashlib.sha256).hexdigest()


def open_for(connection: Connection, account: Account, at: float) -> str:
    """A new session's secret, for the cookie."""
    secret = secrets.token_urlsafe(32)
    connection.execute(delete(sessions).where((sessions.c.expires_at <= at) | (sessions.c.seen_at <= at - IDLE_S)))
    holder = {"user_id": account.id} if account.is_user else {"token_id": account.id}
    times = {"created_at": at, "seen_at": at, "expires_at": at + SESSION_S}
    connection.execute(insert(sessions).values(sha256=tokens.digest(secret), **holder, **times))
    return secret


def find(connection: Connection, secret: str, at: float, heard_at: float | None = None) -> Account | None:
    """Who an open session is of. heard_at : when it was last heard, where that is not written down yet"""
    key = tokens.digest(secret)
    row = connection.execute(select(sessions).where(sessions.c.sha256 == key)).mappings().first()
    if row is None or not hmac.compare_digest(row["sha256"], key) or row["expires_at"] <= at:
        return None
    if max(row["seen_at"], heard_at or 0.0) <= at - IDLE_S:
        return None
    if row["user_id"] is not None:
        user = users.find(connection, user_id=row["user_id"])
        return of_user(user, key) if user is not None and user.disabled_at is None else None
    token = tokens.valid(_token_row(connection, row["token_id"]), at)
    return of_token(token, key) if token is not None else None


def _token_row(connection: Connection, token_id: str) -> RowMapping | None:
    return connection.execute(select(token_table).where(token_table.c.id == token_id)).mappings().first()


def heard(connection: Connection, seen_at: dict[str, float]) -> None:
    """Write down when sessions, by their SHA-256, were last heard."""
    for sha256, at in seen_at.items():
        connection.execute(update(sessions).where(sessions.c.sha256 == sha256, sessions.c.seen_at < at).values(seen_at=at))


def close(connection: Connection, secret: str) -> None:
    """End a session; twice is harmless."""
    connection.execute(delete(sessions).where(sessions.c.sha256 == tokens.digest(secret)))


def close_all(connection: Connection, account: Account, but: str = "") -> None:
    """End every session of a user or token. but : SHA-256 of one that stays"""
    mine: ColumnElement[bool] = (sessions.c.user_id if account.is_user else sessions.c.token_id) == account.id
    connection.execute(delete(sessions).where(mine, sessions.c.sha256 != but))
