"""Lists in pages: newest first, from a cursor that stays valid while rows are added."""

from __future__ import annotations

import base64
import binascii
from typing import Any

from sqlalchemy import Connection, RowMapping, Select, Table


class CursorError(Exception):
    """A cursor that this service did not give out."""


def cursor_of(seq: int) -> str:
    """Opaque text for "what is older than row `seq`"."""
    return base64.urlsafe_b64encode(f"before:{seq}".encode()).decode().rstrip("=")


def seq_of(cursor: str) -> int:
    """The row number in a cursor. Raises CursorError."""
    try:
        text = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode("ascii")
        word, _, number = text.partition(":")
        if word != "before" or not number.isdigit() or len(number) > 18:
            raise ValueError(text)
        return int(number)
    except (binascii.Error, ValueError):
        raise CursorError(f"{cursor[:40]!r} is no cursor of this list") from None


def page(
    connection: Connection, table: Table, query: Select[Any], cursor: str | None, limit: int
) -> tuple[list[RowMapping], str | None]:
    """Up to `limit` rows of the query, newest first, and the cursor of the rest (None at the end). Raises CursorError."""
    if cursor is not None:
        query = query.where(table.c.seq < seq_of(cursor))
    rows = connection.execute(query.order_by(table.c.seq.desc()).limit(limit + 1)).mappings().all()
    more = len(rows) > limit
    rows = rows[:limit]
    return list(rows), cursor_of(int(rows[-1]["seq"])) if more else None
