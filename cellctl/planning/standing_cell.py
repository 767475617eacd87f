"""The cell as it stands: the file's facts with what was measured at the machine, and a file of it for the workers."""

from __future__ import annotations

import os
from pathlib import Path

import tomli_w

from cellctl.domain.measured import Measured, standing_of
from cellctl.store import Store, measured
from config import Cell, load_cell

KEPT = "cells"


class StandingCell:
    """filed : the cell file's   cell : as it stands   file : where the workers read it"""

    def __init__(self, given: Path, store: Store) -> None:
        """Raises ConfigError."""
        self.given = given
        self.filed = load_cell(given)
        self.cell, self.file = self.filed, given
        self._store = store
        self.read()

    def read(self) -> Measured:
        """Take the newest version of what was measured over. Raises ConfigError."""
        with self._store.read_cell() as rows:
            newest = measured.newest(rows, self.filed.name)
        if newest is None:
            self.cell, self.file = self.filed, self.given
            return Measured()
        self.cell = standing_of(self.filed, newest.document)
        self.file = self._written(self.cell)
        return newest.document

    def _written(self, cell: Cell) -> Path:
        """A file of the cell, named after what is in it; whole or not there."""
        folder = self._store.folder / KEPT
        folder.mkdir(exist_ok=True)
        text = tomli_w.dumps(cell.model_dump(mode="json", exclude_none=True))
        path = folder / f"{cell.sha256[:24]}-{cell.twin_sha256[:12]}.toml"
        part = path.with_suffix(f".{os.getpid()}.part")
        part.write_text(text, encoding="utf-8")
        part.replace(path)
        return path
