"""The stock as it stands where a Program was interrupted: everything up to a share of a line is laid and cut, from there on the laser is dark."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from config import Cell, Material, load_material
from sim.checkpoint import Checkpoints
from sim.dryrun import DryRun, Progress, ProofCancelled
from sim.job import Job
from sim.process.clamping import TriangleMesh
from sim.process.heat import heat_law, heat_step
from sim.trace import Trace

Floats = NDArray[np.float64]
State = dict[str, NDArray[np.generic]]

REST_S = 1e6  # after which any part is as cold as its surroundings


@dataclass(frozen=True, eq=False)
class Standing:
    """Metal on the table, to be proved on: `prove(program, cell, mesh, start=…)`.

    line, fraction : where the Program was left, index of the line and share of it   layer, operation : of that line
    metal : state of stock and part's heat   cell_mm, bounds : its grid, and the (2, 3) box, mm, build frame, that it was made for
    cuts : (k, 6) deep cuts so far   path : (m, 5) points of beads and cuts so far   emitted_mm : way with the laser on
    joints : (n,) where the machine stood, mm or deg   tool : number that was in   time_s : that the Program had run, waits included
    """

    line: int
    fraction: float
    layer: int
    operation: int
    metal: State
    cell_mm: float
    bounds: Floats
    cuts: Floats
    path: Floats
    emitted_mm: float
    joints: Floats
    tool: int
    time_s: float

    @property
    def sha256(self) -> bytes:
        """Hash of everything that a proof on it depends on."""
        digest = hashlib.sha256(repr((self.cell_mm, self.emitted_mm, self.tool)).encode())
        for name in sorted(self.metal):
            digest.update(name.encode() + np.ascontiguousarray(self.metal[name]).tobytes())
        for array in (self.bounds, self.cuts, self.path, self.joints):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.digest()


class Below(Protocol):
    """What gets every trace of a World."""

    def apply(self, trace: Trace) -> None:
        """Take one trace."""


class Until:
    """Hands traces on until a share of a line is done; the piece in which it is done is cut there, what comes later is left out.

    line : N-word   way : mm and deg alike, of the joints on that line until the point   `is_there` once it is reached; `joints`, `tool` there
    """

    def __init__(self, below: Below, line: int, way: float, joints: Floats) -> None:
        self._below, self._line, self._left = below, line, way
        self.is_there = False
        self.joints, self.tool = joints, 0

    def apply(self, trace: Trace) -> None:
        """Hand on what is before the point."""
        if self.is_there:
            return
        moved = np.linalg.norm(trace.joints1 - trace.joints0, axis=1)
        mine = np.where(trace.line == self._line, moved, 0.0)
        done = np.cumsum(mine)
        over = ((trace.line > self._line) & (moved > 0.0)) | (done > self._left)
        if not over.any():
            self._left -= float(done[-1]) if len(done) else 0.0
            self._hand_on(trace)
            return
        last = int(np.argmax(over))
        self.is_there = True
        before = float(done[last] - mine[last])
        share = (self._left - before) / mine[last] if mine[last] > 0.0 else 0.0
        self._hand_on(_cut(trace, last, share))

    def _hand_on(self, trace: Trace) -> None:
        self._below.apply(trace)
        if len(trace):
            self.joints, self.tool = trace.joints1[-1].copy(), trace.tool


def _cut(trace: Trace, last: int, share: float) -> Trace:
    """The pieces before one, and a share of that one."""
    part = trace.part(0, last + 1 if share > 0.0 else last)
    if share <= 0.0:
        return part
    names = {field.name for field in fields(part)}
    changed: dict[str, Any] = {}
    for end, begin in (("tip1", "tip0"), ("axis1", "axis0"), ("joints1", "joints0")):
        assert end in names and begin in names
        values = getattr(part, end).copy()
        start = getattr(part, begin)[-1]
        values[-1] = start + share * (values[-1] - start)
        if end == "axis1":
            values[-1] /= np.linalg.norm(values[-1])
        changed[end] = values
    dt = part.dt.copy()
    dt[-1] *= share
    return replace(part, dt=dt, **changed)


def stock_after(
    program: Job,
    cell: Cell,
    mesh: TriangleMesh,
    line: int,
    fraction: float,
    *,
    material: Material | None = None,
    stock: TriangleMesh | None = None,
    cell_mm: float | None = None,
    start: Standing | None = None,
    cooled_s: float = REST_S,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    checkpoints: Path | None = None,
) -> Standing:
    """The stock after a share of a line of a Program, as the twin makes it, the laser dark from there on.

    line : index (N-word less 1)   fraction : of its motion, 0 to 1   mesh, material, stock, cell_mm, checkpoints : as for `prove`
    start : the stock that the Program itself began with, if it was a resumed one   cooled_s : how long the part has cooled since

    Raises ValueError for a point that the Program has not, or one that the run does not reach; ProofCancelled.
    """
    if not (0 <= line < len(program.lines) and 0.0 <= fraction <= 1.0):
        raise ValueError(f"line {line}, fraction {fraction:g}: the program has lines 0 to {len(program.lines) - 1}")
    powder = material or load_material(program.material)
    run = DryRun(program, cell, mesh, powder, stock, cell_mm, start)
    if checkpoints is not None:
        run.resume(Checkpoints(checkpoints, lambda text: None), mesh, stock, before_line=line + 1)
    until = Until(run.contacts, line + 1, fraction * _way_of(program, line), run.world.cnc.machine.joints)
    run.world.metal = until
    said = -1
    while not (until.is_there or run.controller.is_done or run.is_over):
        if cancelled is not None and cancelled():
            raise ProofCancelled(f"cancelled at line {run.controller.acknowledged} of {line + 1}")
        run.advance()
        percent = 100 * run.controller.executing // (line + 1)
        if progress is not None and percent != said:
            said = percent
            progress(min(percent / 100.0, 1.0), f"line {run.controller.executing} of {line + 1}")
    if not until.is_there and run.is_over:
        raise ValueError(f"line {line} is not reached: {run.found[-1].text}")
    run.metal.finish()
    heat_step(heat_law(powder), run.metal.heat, 0.0, cooled_s)
    row = program.table[line]
    watched = run.watch.state()
    return Standing(
        line, fraction, int(row["layer"]), int(row["operation"]), run.metal.snapshot(), run.stock.cell_mm, run.bounds,
        run.contacts.state()["deep"], watched["path"], run.watch.emitted_mm, until.joints, until.tool, run.world.time_s,
    )  # fmt: skip


def _way_of(program: Job, line: int) -> float:
    """Length of a line's motion in the norm of all joints, mm and deg alike; 0 for the first."""
    if line == 0:
        return 0.0
    ends = program.table["joints_end"]
    chord = float(np.linalg.norm(ends[line] - ends[line - 1]))
    half = 2.0 * float(np.arctan(program.table["bulge"][line]))
    return chord * half / float(np.sin(half)) if abs(half) > 1e-9 else chord
