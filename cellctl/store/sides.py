"""Which tables lie where, and that no statement takes one for the other.

What people share lies in one database for the whole house where the store is shared; what the cell process writes, and what is made of it,
stays in the SQLite file of the cell's own host. All databases have all tables, so that one schema holds everywhere: a statement on the
wrong side would find them empty and answer nothing. It is refused instead.
"""

from __future__ import annotations

import re
from enum import Enum
from functools import lru_cache
from typing import Any

from sqlalchemy import Connection

from cellctl.store.schema import metadata

OWN = frozenset({"events", "journal", "cell_runs", "measured", "trend_levels", "hook_places"})
"""Tables of the cell's own."""
WORD = re.compile(r"\w+")


class Side(Enum):
    """Where a transaction works."""

    SHARED = "the shared tables"
    OWN = "the cell's own tables"


class WrongSideError(AssertionError):
    """A statement that asks the shared tables for what the cell wrote, or the other way round."""


@lru_cache(maxsize=2000)
def misplaced(statement: str, side: Side) -> tuple[str, ...]:
    """Tables in a statement that lie on the other side."""
    there = frozenset(metadata.tables) - OWN if side is Side.OWN else OWN
    return tuple(sorted(there & set(WORD.findall(statement))))


def check_side(connection: Connection, _cursor: Any, statement: str, _parameters: Any, _context: Any, _many: bool) -> None:
    """Listens to `before_cursor_execute`. Raises WrongSideError."""
    side = connection.get_execution_options().get("cellctl_side")
    if side is not None and (wrong := misplaced(statement, side)):
        raise WrongSideError(f"{', '.join(wrong)}: not among {side.value}")
