"""Answers to commands by their id: as many as a restart would find again, the oldest forgotten first."""

from __future__ import annotations

from cellctl.cell.journal_rows import KEPT_COMMANDS
from cellctl.domain.messages import Reply


class Answers(dict[str, Reply]):
    """A dict of at most `kept` entries. A repeated id keeps its place."""

    def __init__(self, kept: int = KEPT_COMMANDS) -> None:
        super().__init__()
        self._kept = kept

    def __setitem__(self, ident: str, reply: Reply) -> None:
        super().__setitem__(ident, reply)
        if len(self) > self._kept:
            del self[next(iter(self))]
