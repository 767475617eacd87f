"""What was found: one check a line, with what was measured, what it had to be, the verdict and what to do."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Literal

from drivers.errors import DriverError

Verdict = Literal["ok", "FAULT", "warning", "told", "not checked"]
"""told: a fact without a limit. A warning asks for a look, a FAULT for a repair; only a FAULT makes the report a bad one."""


@dataclass(frozen=True)
class Check:
    """One thing that was looked at. section : its heading; found, limit : with units; remedy : what to do about it, or why it was not checked"""

    section: str
    what: str
    verdict: Verdict
    found: str = ""
    limit: str = ""
    remedy: str = ""


@dataclass
class Report:
    """Everything that was looked at. at : Unix time (s); file_sha256 : of the cell file's bytes; facts_sha256 : of what Programs depend on"""

    cell: str
    mode: str
    cell_file: str = ""
    file_sha256: str = ""
    facts_sha256: str = ""
    who: str = ""
    at: float = 0.0
    checks: list[Check] = field(default_factory=list)

    @property
    def is_well(self) -> bool:
        """Whether no check found a fault."""
        return all(check.verdict != "FAULT" for check in self.checks)

    @property
    def faults(self) -> list[Check]:
        """Checks that found a fault."""
        return [check for check in self.checks if check.verdict == "FAULT"]

    def count(self, verdict: Verdict) -> int:
        """How many checks have this verdict."""
        return sum(check.verdict == verdict for check in self.checks)

    def document(self) -> dict[str, object]:
        """For programs."""
        return {**asdict(self), "ok": self.is_well, "checks": [asdict(check) for check in self.checks]}

    def add(self, section: str, what: str, verdict: Verdict, found: str = "", limit: str = "", remedy: str = "") -> None:
        """Note one check."""
        self.checks.append(Check(section, what, verdict, found, limit, remedy))

    def judge(self, section: str, what: str, is_good: bool, found: str, limit: str = "", remedy: str = "") -> None:
        """Note one check that has a limit; the remedy only where it failed."""
        self.add(section, what, "ok" if is_good else "FAULT", found, limit, "" if is_good else remedy)

    def fault(self, section: str, what: str, error: DriverError) -> None:
        """Note what the wire or the device says is wrong."""
        self.add(section, what, "FAULT", error.message, "", error.hint)

    def skip(self, section: str, what: str, why: str) -> None:
        """Note what was not checked, and why."""
        self.add(section, what, "not checked", remedy=why)
