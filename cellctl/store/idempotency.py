"""Requests that name themselves by an Idempotency-Key: the second one gets the first one's answer."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from sqlalchemy import Connection, insert, select, text

from cellctl.store.schema import idempotency

KEPT_S = 30 * 86_400.0  # a request is not sent a second time after so long
FORGOTTEN_AT_ONCE = 20  # keys looked at, the oldest first, with every one that comes: faster than they come
FORGET = text(
    "DELETE FROM idempotency WHERE created_at < :before "
    "AND (who, key) IN (SELECT who, key FROM idempotency ORDER BY created_at LIMIT :count)"
)


class KeyReusedError(Exception):
    """The same key came with another request."""


def request_digest(*parts: Any) -> str:
    """Hash (hex) of what a request asks for, whatever the order of its fields."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def answered(connection: Connection, who: str, key: str | None, request_sha256: str) -> dict[str, Any] | None:
    """The first answer to this key, None if there was none. Raises KeyReusedError if it was for another request."""
    if key is None:
        return None
    query = select(idempotency).where(idempotency.c.who == who, idempotency.c.key == key)
    row = connection.execute(query).mappings().first()
    if row is None:
        return None
    if row["request_sha256"] != request_sha256:
        raise KeyReusedError(f"Idempotency-Key {key[:60]!r} was used for another request")
    answer: dict[str, Any] = json.loads(row["answer"])
    return answer


def remember(
    connection: Connection, who: str, key: str | None, request_sha256: str, answer: dict[str, Any], at: float
) -> None:
    """Keep an answer, in the transaction that made what it tells of; the oldest beyond KEPT_S are forgotten."""
    if key is not None:
        connection.execute(FORGET, {"before": at - KEPT_S, "count": FORGOTTEN_AT_ONCE})
        values = {"request_sha256": request_sha256, "answer": json.dumps(answer), "created_at": at}
        connection.execute(insert(idempotency).values(who=who, key=key, **values))
