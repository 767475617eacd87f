"""The error of a store that cannot be used."""

from __future__ import annotations


class StoreError(Exception):
    """The store cannot be opened. `message` is one line, `hint` says what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
