"""A refused command: one line, what to do, and of what kind the reason is."""

from __future__ import annotations

READINESS = "readiness"  # the cell was not ready; nothing has moved, and the same command may do a moment later
CONTROL = "control"  # another client has control
TABLE = "table"  # nobody knows any more that the table is clear
STORE = "store"  # the journal cannot be written


class Refused(Exception):
    """A command that cannot be carried out; nothing was changed. kind : READINESS, CONTROL, TABLE or "" """

    def __init__(self, message: str, hint: str = "", kind: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.kind = kind
