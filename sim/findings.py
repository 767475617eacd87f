"""What a proof finds wrong: each kind once per operation, with its first line, its worst place and how often it happened."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from sim.job import Job
from sim.remedies import HELP

Severity = Literal["error", "warning"]
Place = tuple[float, float, float]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong; an "error" fails the proof, a "warning" does not.

    line : N-word of the worst case (0: the whole Program); first_line : of the first
    layer, operation : as in the Program's table (-1: none)
    count : how often it was seen in this operation
    at_mm : worst place, build frame, or None   depth_mm : how deep, how far beyond, over what length; 0 where that says nothing
    help : what would help, one sentence
    """

    kind: str
    text: str
    line: int
    layer: int
    operation: int
    count: int = 1
    severity: Severity = "error"
    at_mm: Place | None = None
    depth_mm: float = 0.0
    help: str = ""
    first_line: int = 0

    def to_dict(self) -> dict[str, object]:
        """Plain data; lengths rounded to 1 um."""
        place = None if self.at_mm is None else [round(value, 3) for value in self.at_mm]
        return {**asdict(self), "at_mm": place, "depth_mm": round(self.depth_mm, 3)}


class Findings:
    """Collects findings; `is_fatal` once one says that the run cannot go on."""

    def __init__(self, program: Job) -> None:
        self._table = program.table
        self._found: dict[tuple[str, int], Finding] = {}
        self._rank: dict[tuple[str, int], float] = {}
        self.is_fatal = False

    def add(
        self, kind: str, text: str, line: int, fatal: bool = False, *, at_mm: Place | None = None, depth_mm: float = 0.0,
        severity: Severity = "error", help: str = "", rank: float | None = None,
    ) -> None:  # fmt: skip
        """Note one finding at a line. Of one kind in one operation the one with the greatest rank (default: depth) stands, the first of equals."""
        known = 0 < line <= len(self._table)
        row = self._table[line - 1] if known else None
        layer, operation = (int(row["layer"]), int(row["operation"])) if row is not None else (-1, -1)
        key = (kind, operation)
        rank = depth_mm if rank is None else rank
        new = Finding(kind, text, line, layer, operation, 1, severity, at_mm, depth_mm, help or HELP.get(kind, ""), line)
        old = self._found.get(key)
        if old is not None:
            worse = new if rank > self._rank[key] else old
            new = replace(worse, count=old.count + 1, first_line=old.first_line, severity=_graver(old.severity, severity))
            rank = max(rank, self._rank[key])
        self._found[key], self._rank[key] = new, rank
        self.is_fatal |= fatal

    def state(self) -> list[Any]:
        """What was found so far, as plain data: fields of each Finding and its rank."""
        return [[asdict(finding), self._rank[key]] for key, finding in self._found.items()]

    def restore(self, state: list[Any]) -> None:
        """Go back to a state. Raises TypeError when it does not fit."""
        self._found, self._rank = {}, {}
        for plain, rank in state:
            finding = Finding(**{**plain, "at_mm": None if plain["at_mm"] is None else tuple(plain["at_mm"])})
            key = (finding.kind, finding.operation)
            self._found[key], self._rank[key] = finding, float(rank)

    def all(self) -> tuple[Finding, ...]:
        """In the order in which they were first seen."""
        return tuple(self._found.values())


def _graver(one: Severity, other: Severity) -> Severity:
    return "error" if "error" in (one, other) else "warning"
