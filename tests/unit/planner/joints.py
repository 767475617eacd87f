"""Interrupted and resumed in the twin: what the joint looks like beside the same part made in one go, for tests and benches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

import planner
import sim
from config import Cell, load_material
from planner.plan import Plan
from planner.program import Program
from planner.resume import ResumePoint
from sim.dryrun import DryRun
from sim.proof import Proof
from sim.standing import Standing

Floats = NDArray[np.float64]

BEAD_MM = 2.5  # about the width of a bead: so far from the place a joint reaches, beside its overlap


@dataclass(frozen=True)
class Made:
    """A run and its proof."""

    run: DryRun
    proof: Proof

    @property
    def surface(self) -> Floats:
        """(n, 3) points of the as-built surface, mm."""
        assert self.proof.built is not None
        return self.proof.built[0]


@dataclass(frozen=True)
class Joint:
    """Differences of the resumed part's surface from the uninterrupted one, mm, metal more > 0, near the place and elsewhere.

    start : the stock when it was resumed   volume_mm3 : of metal deposited more   overlap_mm : run again
    extra_s : that interrupting and resuming took longer
    """

    made: Made
    resumed: Program
    start: Standing
    high_mm: float
    low_mm: float
    far_high_mm: float
    far_low_mm: float
    volume_mm3: float
    overlap_mm: float
    extra_s: float


def made_of(program: Program, cell: Cell, mesh: planner.Mesh, cell_mm: float, start: Standing | None = None) -> Made:
    """The Program run to its end."""
    run = DryRun(program, cell, mesh, load_material(program.material), None, cell_mm, start)
    run.execute()
    return Made(run, run.conclude())


def joint_at(
    program: Program, cell: Cell, mesh: planner.Mesh, whole: Made, line: int, fraction: float, plan: Plan | None = None
) -> Joint:
    """Stopped at a share of a line, cooled, resumed, and compared with what was made in one go."""
    cell_mm = whole.run.stock.cell_mm
    start = sim.stock_after(program, cell, mesh, line, fraction, cell_mm=cell_mm)
    resumed = planner.resume(program, cell, ResumePoint.at(line, fraction), plan=plan, program_sha256="0" * 64)
    made = made_of(resumed, cell, mesh, cell_mm, start)
    assert resumed.continues is not None
    points = np.vstack([made.surface, whole.surface])
    more = np.concatenate([more_metal(made, whole), -more_metal(whole, made)])
    is_near = np.linalg.norm(points - place_of(resumed), axis=1) < resumed.continues.overlap_mm + BEAD_MM
    near, far = more[is_near], more[~is_near]
    return Joint(
        made, resumed, start,
        float(near.max(initial=0.0)), float(near.min(initial=0.0)), float(far.max(initial=0.0)), float(far.min(initial=0.0)),
        made.proof.deposited_mm3 - whole.proof.deposited_mm3, resumed.continues.overlap_mm,
        start.time_s + made.proof.duration_s - whole.proof.duration_s,
    )  # fmt: skip


def tip_at(program: Program, line: int, fraction: float) -> Floats:
    """(3,) mm, build frame, on the chord of a line."""
    tips = program.table["tip_end"]
    before = tips[max(line - 1, 0)]
    return np.asarray(before + fraction * (tips[line] - before))


def more_metal(one: Made, other: Made) -> Floats:
    """(n,) mm: how far each point of one surface stands out of the other, by the fields or by the nearest point, whichever is less.

    The fields of beads are steeper than distances beside flanks; points are no nearer than their pitch where surfaces are the same.
    """
    points = one.surface
    by_field = other.run.stock.distance(points) - one.run.stock.distance(points)
    assert other.proof.built is not None
    vertices, facets, _ = other.proof.built
    nearest = KDTree(np.vstack([vertices, vertices[facets].mean(axis=1)])).query(points)[0]
    return np.asarray(np.sign(by_field) * np.minimum(np.abs(by_field), nearest))


def place_of(resumed: Program) -> Floats:
    """(3,) mm, build frame: the tip where the metal or the cut that was there ends."""
    note, table = resumed.continues, resumed.table
    assert note is not None
    rows = np.flatnonzero((table["operation"] == note.operation) & (table["pass_"] == note.pass_))
    end = note.arc_mm + note.lead_in_mm + note.overlap_mm
    return np.asarray(table["tip_end"][rows[np.argmin(np.abs(table["arc_end_mm"][rows] - end))]])
