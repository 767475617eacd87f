"""Bound against measured value, one row for each thing that the verdict looks at; the verdict itself is the proof's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim.machine.machine import CLEARANCE_CAP_MM
from sim.report.markup import Node, tag

if TYPE_CHECKING:
    from sim.findings import Finding
    from sim.proof import Proof

KINDS = (
    ("collision", "Collision of a body with another or with the metal"),
    ("travel", "Axis beyond its travel"),
    ("speed", "Speed: axis beyond its limit, or tip slower than programmed"),
    ("acceleration", "Axis beyond its acceleration"),
    ("rapid in metal", "Cutting at rapid speed"),
    ("spindle off", "Cutter in metal with the spindle standing"),
    ("standstill", "Laser on while the tip stands"),
    ("stray light", "Laser on where nothing is deposited"),
    ("head parked", "Laser on with the head parked"),
    ("starved", "Bead starved of powder"),
    ("waste", "Powder without laser"),
    ("line length", "Line longer than the firmware takes"),
    ("firmware", "Error or alarm of the firmware"),
)
"""Kinds of findings that have a row even when there is none; gouge and clearance have rows of their own."""
BOUNDS = {
    "speed": ("slow_share", "tip at least {:.0%}", 1.0),
    "starved": ("starved_share", "at least {:.0%} of the set-point", 1.0),
    "standstill": ("standstill_s", "at most {:.0f} ms", 1e3),
    "stray light": ("stray_s", "at most {:.0f} ms beyond the ramp", 1e3),
}
NEVER = "none"


@dataclass(frozen=True)
class Check:
    """One row. is_kept: None where it was not looked at; is_warning: breaking it does not fail the proof."""

    what: str
    measured: str
    allowed: str
    is_kept: bool | None
    is_warning: bool = False

    @property
    def result(self) -> Node:
        """In words with a sign, so that it can be told without colours."""
        if self.is_kept is None:
            return tag("span", "\N{EN DASH} not checked", class_="warning")
        if self.is_kept:
            return tag("span", "\N{CHECK MARK} kept", class_="ok")
        if self.is_warning:
            return tag("span", "\N{WARNING SIGN}\N{VARIATION SELECTOR-15} warning", class_="warning")
        return tag("span", "\N{BALLOT X} broken", class_="not-ok")


def checks_of(proof: Proof) -> list[Check]:
    """All rows, in the order in which they are read."""
    of_kind: dict[str, list[Finding]] = {}
    for finding in proof.findings:
        of_kind.setdefault(finding.kind, []).append(finding)
    named = {kind for kind, _ in KINDS} | {"gouge", "clearance", "unchecked"}
    rest = [(kind, kind[:1].upper() + kind[1:]) for kind in of_kind if kind not in named]
    is_watched = not any(finding.kind == "unchecked" for finding in proof.findings)
    return [
        Check("Lines executed", f"{proof.lines_executed}", f"all {proof.lines}", proof.lines_executed == proof.lines),
        *_surface(proof),
        _gouge(proof, of_kind.get("gouge", [])),
        _clearance(proof, bool(of_kind.get("clearance"))),
        *(_absent(proof, kind, what, of_kind.get(kind, []), is_watched) for kind, what in (*KINDS, *rest)),
    ]


def _surface(proof: Proof) -> list[Check]:
    whole = proof.deviation
    share = whole.missing_mm3 / whole.part_mm3 if whole.part_mm3 > 0.0 else 0.0
    bound = proof.thresholds.get("missing_share")
    missing = f"{whole.missing_mm3:.1f} mm\N{SUPERSCRIPT THREE} = {share:.2%}"
    return [
        Check("Surface: 99 % of it within", f"{whole.p99_mm:.3f} mm", f"{proof.allowed_mm:.3f} mm", whole.p99_mm <= proof.allowed_mm),
        Check("Missing metal, of the part's volume", missing, "\N{EN DASH}" if bound is None else f"{bound:.2%}", bound is None or share <= bound),
    ]


def _gouge(proof: Proof, seen: list[Finding]) -> Check:
    bound = proof.thresholds.get("gouge_mm", proof.tolerance_mm)
    deepest = max((finding.depth_mm for finding in seen), default=0.0)
    measured = f"{deepest:.3f} mm" if seen else NEVER
    return Check("Gouge: cut below the part's surface", measured, f"{bound:.3f} mm", not seen, _is_warning(seen))


def _clearance(proof: Proof, is_close: bool) -> Check:
    bound = proof.thresholds.get("clearance_mm")
    allowed = "\N{EN DASH}" if bound is None else f"{bound:.1f} mm"
    if proof.clearance_mm is None:
        return Check("Least clearance between bodies", "not watched", allowed, None)
    kept = not is_close and (bound is None or proof.clearance_mm >= bound)
    more = "\N{GREATER-THAN OR EQUAL TO} " if proof.clearance_mm >= max(CLEARANCE_CAP_MM, 2.0 * (bound or 0.0)) else ""
    return Check("Least clearance between bodies", f"{more}{proof.clearance_mm:.2f} mm", allowed, kept, is_warning=True)


def _is_warning(seen: list[Finding]) -> bool:
    return bool(seen) and all(finding.severity != "error" for finding in seen)


def _absent(proof: Proof, kind: str, what: str, seen: list[Finding], is_watched: bool) -> Check:
    """Something that must not happen at all, or not beyond a bound."""
    name, words, factor = BOUNDS.get(kind, ("", NEVER, 1.0))
    allowed = words.format(proof.thresholds[name] * factor) if name in proof.thresholds else NEVER
    if kind == "collision" and not is_watched and not seen:
        return Check(what, "not watched", allowed, None)
    times = sum(finding.count for finding in seen)
    return Check(what, f"{times} \N{MULTIPLICATION SIGN}" if seen else NEVER, allowed, not seen, _is_warning(seen))
