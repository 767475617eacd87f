"""A proof and its Program made by hand, so that every figure in a report is known beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from sim.deviation import Deviation
from sim.findings import Finding
from sim.proof import Proof
from sim.timeline import Timeline

DTYPE = np.dtype([("kind", "u1"), ("layer", "<i4"), ("operation", "<i4"), ("tip_end", "<f8", (3,))])
LINES = 40


def table() -> NDArray[np.void]:
    """Forty lines along x at the top of a block, twenty in each of two layers."""
    rows = np.zeros(LINES, dtype=DTYPE)
    rows["kind"], rows["layer"], rows["operation"] = 2, np.arange(LINES) // 20, np.arange(LINES) // 10
    rows["tip_end"] = np.stack([np.linspace(-5.0, 5.0, LINES), np.zeros(LINES), np.full(LINES, 2.0)], axis=1)
    return rows


@dataclass(frozen=True)
class ByHand:
    """What a report reads of a Program."""

    part_name: str = "block"
    process: str = "hybrid"
    material: str = "316L"
    tolerance_mm: float = 0.2
    lines: tuple[str, ...] = tuple(f"N{index + 1}G1X{index}" for index in range(LINES))
    gate: str = "stream"
    plan_sha256: str = "cd" * 32
    mesh_sha256: str = "ef" * 32
    stock_allowance_mm: float | None = None

    @property
    def table(self) -> NDArray[np.void]:
        return table()

    @property
    def schedule(self) -> NDArray[np.void]:
        dtype = np.dtype([("n", "<i4"), ("channel", "u1"), ("barrier", "u1"), ("value", "<f8")])
        return np.array([(1, 0, 1, 1.0), (21, 0, 1, 2.0)], dtype=dtype)

    @property
    def machine_from_build(self) -> NDArray[np.float64]:
        return np.eye(4)

    @property
    def build_from_part(self) -> NDArray[np.float64]:
        return np.eye(4)

    @property
    def work_offset(self) -> NDArray[np.float64]:
        return np.zeros(5)


def deviation(**changes: float) -> Deviation:
    figures = dict.fromkeys((f.name for f in fields(Deviation)), 0.0)
    known: dict[str, Any] = {
        **figures,
        "p99_mm": 0.0817,
        "missing_mm3": 1.25,
        "excess_mm3": 2.5,
        "part_mm3": 1000.0,
        "samples": 777,
        "cell_mm": 0.25,
    }
    return Deviation(**{**known, **changes})


def timeline(rows: int = 50) -> Timeline:
    """A run of 100 s over all lines in which every quantity rises from 1 to 2, with a gap that is known in its second half only."""
    rising = np.linspace(1.0, 2.0, rows)
    columns: dict[str, Any] = {f.name: rising.copy() for f in fields(Timeline)}
    columns["time_s"] = np.linspace(0.0, 98.0, rows)
    columns["line"] = np.linspace(0, LINES, rows).astype(np.int64)
    columns["layer"] = np.maximum(columns["line"] - 1, 0) // 20
    columns["gap_mm"] = np.where(rising > 1.5, rising, np.nan)
    return Timeline(**columns)


def block() -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """A block of 12 x 8 x 2 mm whose surface lies 0.1 mm too high everywhere."""
    box = trimesh.creation.box((12.0, 8.0, 2.0)).subdivide_to_size(1.0)
    vertices = np.asarray(box.vertices) + np.array([0.0, 0.0, 1.0])
    return vertices, np.asarray(box.faces, dtype=np.int64), np.full(len(vertices), 0.1)


GOUGE = Finding("gouge", "the cutter goes 0.31 mm below the surface", 25, 1, 2, 7, "error", (1.0, 2.0, 2.0), 0.31, "Check the tool's length.", 24)
CLOSE = Finding("clearance", "nozzle passes the clamp", 5, 0, 0, 1, "warning", (-3.0, 0.0, 4.0), 0.0, "Raise the links.", 5)


def proof(findings: tuple[Finding, ...] = (), thresholds: Mapping[str, float] | None = None, **changes: Any) -> Proof:
    reasons = tuple(f"{f.kind}: {f.text}" for f in findings if f.severity == "error")
    figures: dict[str, Any] = {
        "passed": not reasons,
        "program_sha256": "ab" * 32,
        "reasons": reasons,
        "findings": findings,
        "deviation": deviation(),
        "tolerance_mm": 0.2,
        "allowed_mm": 0.2,
        "duration_s": 3723.0,
        "lines": LINES,
        "lines_executed": LINES,
        "deposited_mm3": 1234.5,
        "lost_powder_mm3": 67.8,
        "removed_mm3": 345.6,
        "clearance_mm": 2.5,
        "thresholds": {"missing_share": 0.005, "gouge_mm": 0.2, "clearance_mm": 1.0} if thresholds is None else thresholds,
        "timeline": timeline(),
        "built": block(),
    }
    return Proof(**{**figures, **changes})
