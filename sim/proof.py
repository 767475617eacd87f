"""The Proof: verdict, reasons, figures and picture of one dry run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from config import Cell, Material
from sim.deviation import Deviation, Histogram, LayerDeviation
from sim.findings import Finding
from sim.job import Job
from sim.process.melt import bead_section
from sim.timeline import Timeline
from sim.watch import SLOW_SHARE, SLOW_SPOTS

MISSING_SHARE = 0.005  # of the part's volume: what a polisher would not notice, and a lost bead exceeds
PROOF_SCHEMA = 2


@dataclass(frozen=True)
class Proof:
    """What the twin says of a Program. `reasons` are the lines that an engineer reads first; empty when passed.

    thresholds : what the verdict was measured by, name (with its unit) -> value
    layers : deviation per layer   milled : deviation of surfaces that a cutter left, None without such   histogram : of the deviation
    clearance_mm : least distance seen between bodies that must not touch; None when it was not watched
    timeline, built : for the report; built is (vertices (n, 3) mm, facets (m, 3), deviation of each vertex mm) of the as-built surface
    """

    passed: bool
    program_sha256: str
    reasons: tuple[str, ...]
    findings: tuple[Finding, ...]
    deviation: Deviation
    tolerance_mm: float
    allowed_mm: float
    duration_s: float
    lines: int
    lines_executed: int
    deposited_mm3: float
    lost_powder_mm3: float
    picture: bytes = field(repr=False, default=b"")
    removed_mm3: float = 0.0
    clearance_mm: float | None = None
    thresholds: Mapping[str, float] = field(default_factory=dict)
    layers: tuple[LayerDeviation, ...] = ()
    milled: Deviation | None = None
    histogram: Histogram | None = None
    timeline: Timeline = field(repr=False, default_factory=Timeline.empty)
    built: tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]] | None = field(repr=False, default=None)

    def to_dict(self) -> dict[str, object]:
        """Plain data without picture, timeline and surface."""
        return {
            "schema": PROOF_SCHEMA,
            "passed": self.passed,
            "program_sha256": self.program_sha256,
            "cell_mm": self.deviation.cell_mm,
            "reasons": list(self.reasons),
            "findings": [finding.to_dict() for finding in self.findings],
            "deviation": self.deviation.as_dict(),
            "tolerance_mm": self.tolerance_mm,
            "allowed_mm": self.allowed_mm,
            "allowed_missing_share": self.thresholds.get("missing_share", MISSING_SHARE),
            "duration_s": self.duration_s,
            "lines": self.lines,
            "lines_executed": self.lines_executed,
            "deposited_mm3": self.deposited_mm3,
            "lost_powder_mm3": self.lost_powder_mm3,
            "removed_mm3": self.removed_mm3,
            "clearance_mm": self.clearance_mm,
            "thresholds": dict(self.thresholds),
            "layers": [layer.as_dict() for layer in self.layers],
            "milled": None if self.milled is None else self.milled.as_dict(),
            "histogram": None if self.histogram is None else self.histogram.as_dict(),
        }

    def to_json(self) -> str:
        """The same as JSON, keys sorted: equal proofs give equal text."""
        return json.dumps(self.to_dict(), sort_keys=True, indent=1)


def program_digest(program: Job) -> str:
    """SHA-256 (hex) of what runs: the text and the schedule."""
    digest = hashlib.sha256("\n".join(program.lines).encode())
    digest.update(np.ascontiguousarray(program.schedule).tobytes())
    return digest.hexdigest()


def is_within(deviation: Deviation, allowed_mm: float, missing_share: float = MISSING_SHARE) -> bool:
    """Whether the surface keeps to its bound and no more than that share of the part is missing."""
    return deviation.p99_mm <= allowed_mm and deviation.missing_mm3 <= missing_share * deviation.part_mm3


def allowed_deviation_mm(program: Job, material: Material) -> float:
    """Bound on the 99th percentile: the tolerance; a part that is only deposited may stand out by one bead's height more."""
    if program.process != "deposit":
        return program.tolerance_mm
    window = material.deposition
    bead = bead_section(material, window.laser_w.usual, window.powder_g_min.usual, window.speed_mm_s.usual)
    return program.tolerance_mm + bead.height_mm


def thresholds_of(program: Job, cell: Cell, material: Material) -> dict[str, float]:
    """What a Program is judged by: limits of the cell's facts, the job's tolerance, and what a slow bead is."""
    limits = cell.proof
    return {
        "allowed_mm": allowed_deviation_mm(program, material),
        "tolerance_mm": program.tolerance_mm,
        "missing_share": limits.missing_share,
        "gouge_mm": program.tolerance_mm if limits.gouge_mm is None else limits.gouge_mm,
        "clearance_mm": limits.clearance_mm,
        "starved_share": limits.starved_share,
        "standstill_s": limits.standstill_s,
        "stray_s": limits.stray_s,
        "slow_share": SLOW_SHARE,
        "slow_mm": SLOW_SPOTS * max(tool.diameter_mm for tool in cell.tools if tool.kind == "deposition"),
    }


def verdict(
    whole: Deviation, milled: Deviation | None, findings: tuple[Finding, ...], thresholds: Mapping[str, float]
) -> tuple[bool, tuple[str, ...]]:
    """Whether the Program may run, and if not, why: one line each. thresholds : of `thresholds_of`"""
    reasons = [f"{f.kind}: {f.text}" + (f" (line N{f.line}, layer {f.layer})" if f.line else "") for f in findings if f.severity == "error"]
    allowed, share = thresholds["allowed_mm"], thresholds["missing_share"]
    if whole.p99_mm > allowed:
        reasons.append(f"surface: 99 % lies within {whole.p99_mm:.3f} mm, allowed {allowed:.3f} mm")
    if milled is not None and milled.p99_mm > allowed:
        reasons.append(f"milled surface: 99 % lies within {milled.p99_mm:.3f} mm, allowed {allowed:.3f} mm")
    if whole.missing_mm3 > share * whole.part_mm3:
        missing = 100.0 * whole.missing_mm3 / whole.part_mm3
        reasons.append(f"missing metal: {whole.missing_mm3:.1f} mm3 ({missing:.2f} % of the part), allowed {100 * share:.1f} %")
    return not reasons, tuple(reasons)
