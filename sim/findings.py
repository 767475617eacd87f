"""What a proof finds wrong: each kind once per operation, with its first line and how often it happened."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sim.job import Job


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong; an "error" fails the proof, a "warning" does not.

    line is the N-word (0: the whole Program), layer and operation as in the Program's table (-1: none), count how often it was seen.
    """

    kind: str
    text: str
    line: int
    layer: int
    operation: int
    count: int = 1
    severity: str = "error"


class Findings:
    """Collects findings; `is_fatal` once one says that the run cannot go on."""

    def __init__(self, program: Job) -> None:
        self._table = program.table
        self._found: dict[tuple[str, int], Finding] = {}
        self.is_fatal = False

    def add(self, kind: str, text: str, line: int, fatal: bool = False) -> None:
        """Note one finding at a line."""
        known = 0 < line <= len(self._table)
        row = self._table[line - 1] if known else None
        layer, operation = (int(row["layer"]), int(row["operation"])) if row is not None else (-1, -1)
        key = (kind, operation)
        old = self._found.get(key)
        self._found[key] = replace(old, count=old.count + 1) if old else Finding(kind, text, line, layer, operation)
        self.is_fatal |= fatal

    def all(self) -> tuple[Finding, ...]:
        """In the order in which they were first seen."""
        return tuple(self._found.values())
