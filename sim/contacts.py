"""What met what in a run: bodies of the machine with each other and with the metal, cutters with metal and with the part behind it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.findings import Findings, Place
from sim.machine import Hit, Machine
from sim.plant.io import InputsOutputs
from sim.process.metal import Engagement, Laid, Metal
from sim.process.target import Target
from sim.trace import Trace
from sim.watch import Watch

Floats = NDArray[np.float64]

GONE_CELLS = 0.5  # a place is in metal for certain where the surface is farther above it than this
CUT_COLUMNS = 6  # line, depth below the part's surface, place, tool


class Contacts:
    """Stands between the World and its metal: `apply` gets every trace, `step` tells what it brought.

    What must not touch is looked at after beads are laid, but before a cutter cuts: metal that it takes away within the step is still
    there. Only where something touches (or comes nearer than ever) the step is gone through again, piece by piece, each looked at before
    its own cut: what a cutter has cleared for its shank in the pieces before is then gone.

    gouge_mm : how deep a cut may go below the part's surface. A layer that is faced before the next one is laid is cut below it too:
        what counts is what still lacks metal at the end.
    clearance_mm : a warning where bodies come nearer without touching
    """

    def __init__(
        self, machine: Machine, io: InputsOutputs, metal: Metal, target: Target, watch: Watch, findings: Findings,
        gouge_mm: float, clearance_mm: float,
    ) -> None:  # fmt: skip
        self._machine, self._io, self._metal, self._target, self._watch, self._findings = machine, io, metal, target, watch, findings
        self._gouge_mm, self._limit_mm = gouge_mm, clearance_mm
        self._deep: list[Floats] = []
        self._cuts_told: list[Engagement] = []
        self._hits: list[Hit] = []

    @property
    def clearance_mm(self) -> float | None:
        """Least gap between bodies that must not touch, mm; None when the cell states no bodies."""
        return self._machine.clearance_mm if self._machine.is_drawn else None

    def apply(self, trace: Trace) -> None:
        """Add and cut metal along a trace, and keep what met what for `step`."""
        metal, machine = self._metal, self._machine
        if metal.lays(trace.tool) or not machine.is_drawn:
            metal.apply(trace)
            self._cuts_told += metal.engaged
            self._hits += machine.check(trace, metal.stock, self._io.slide)
            return
        if machine.mounted != trace.tool:
            metal.apply(trace.part(0, 0))  # the last bead's end stands before another tool moves
            self._cuts_told += metal.engaged
        before, clearance = machine.snapshot(), machine.clearance_mm
        hits = machine.check(trace, metal.stock, self._io.slide)
        if len(trace) and (hits or machine.clearance_mm < clearance):
            machine.restore(before)
            self._piece_by_piece(trace)
            return
        self._hits += hits
        metal.apply(trace)
        self._cuts_told += metal.engaged

    def _piece_by_piece(self, trace: Trace) -> None:
        """The same for a cutter, each piece looked at before its own cut."""
        metal, machine = self._metal, self._machine
        passed = np.cumsum(trace.dt)
        begin, end = machine.slide, self._io.slide
        laid = []
        for n in range(len(trace)):
            piece = trace.part(n, n + 1)
            slide = begin + (end - begin) * float(passed[n] / passed[-1]) if n < len(trace) - 1 else end
            self._hits += machine.check(piece, metal.stock, slide)
            metal.apply(piece)
            self._cuts_told += metal.engaged
            laid.append(metal.laid)
        metal.laid = Laid(*(np.concatenate(columns) for columns in zip(*laid, strict=True)))

    def step(self) -> None:
        """Tell what the last step of the World brought; after the Watch has seen it."""
        cuts, hits = self._cuts_told, self._hits
        self._cuts_told, self._hits = [], []
        for cut in cuts:
            self._note_cut(cut)
        for hit in hits:
            text = f"{hit.moving} and {hit.other} overlap by {hit.depth_mm:.2f} mm"
            self._findings.add("collision", text, hit.line, at_mm=_place(hit.at_mm), depth_mm=hit.depth_mm)

    def _note_cut(self, cut: Engagement) -> None:
        depth, at = cut.depth_mm, _place(cut.at_mm)
        if depth > 0.0 and self._watch.is_rapid(cut.line):
            text = f"T{cut.tool} goes {depth:.2f} mm deep into metal at rapid speed"
            self._findings.add("rapid in metal", text, cut.line, at_mm=at, depth_mm=depth)
        if depth > 0.0 and self._watch.spindle_rpm(cut.line) == 0.0:
            text = f"T{cut.tool} meets metal {depth:.2f} mm deep with the spindle standing"
            self._findings.add("spindle off", text, cut.line, at_mm=at, depth_mm=depth)
        if cut.gouge_mm > self._gouge_mm:
            self._deep.append(np.array([[cut.line, cut.gouge_mm, *cut.at_mm, cut.tool]]))

    def finish(self) -> None:
        """The last cuts, the gouges that stayed, and how near bodies came."""
        for cut in self._metal.engaged:
            self._note_cut(cut)
        for line, depth, x, y, z, tool in self._gouges().tolist():
            text = f"T{int(tool)} cuts {depth:.2f} mm below the part's surface, allowed {self._gouge_mm:g} mm"
            self._findings.add("gouge", text, int(line), at_mm=(x, y, z), depth_mm=depth)
        near = self._machine.nearest
        if near is not None and 0.0 < near.gap_mm < self._limit_mm:
            text = f"{near.moving} comes within {near.gap_mm:.2f} mm of {near.other}, less than {self._limit_mm:g} mm"
            self._findings.add("clearance", text, near.line, at_mm=_place(near.at_mm), severity="warning")

    def _gouges(self) -> Floats:
        """Cuts below the part's surface where metal is missing at the end, with their places moved below that surface."""
        stock = self._metal.stock
        gone_mm = GONE_CELLS * stock.cell_mm
        deep = self._cuts()
        if not len(deep):
            return deep
        below = self._target.signed_distance(deep[:, 2:5])
        open_mm = np.minimum(deep[:, 1] + below, stock.band_mm)  # from the place to the cut; negative: it lies in metal below the gouge
        is_open = stock.distance(deep[:, 2:5]) > open_mm - gone_mm
        deep, below = deep[is_open], below[is_open]
        places = deep[:, 2:5]
        normal = np.empty_like(places)
        for d in range(3):
            step = np.zeros(3)
            step[d] = gone_mm
            normal[:, d] = self._target.signed_distance(places + step) - self._target.signed_distance(places - step)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
        deep[:, 2:5] = places - normal * (below + 0.5 * deep[:, 1])[:, None]  # halfway down the gouge
        missing: Floats = deep[stock.distance(deep[:, 2:5]) > 0.0]
        return missing

    def state(self) -> dict[str, Any]:
        """What is carried on from step to step."""
        return {"deep": self._cuts(), "machine": self._machine.snapshot()}

    def begin_with(self, cuts: Floats) -> None:
        """Deep cuts, (n, CUT_COLUMNS), of a run that this one goes on from; their lines are not this Program's."""
        self._deep = [np.array(cuts)]
        self._deep[0][:, 0] = 0.0

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a state. Raises KeyError or ValueError when it does not fit."""
        self._deep = [np.array(state["deep"])]
        self._machine.restore(state["machine"])

    def _cuts(self) -> Floats:
        return np.concatenate(self._deep) if self._deep else np.zeros((0, CUT_COLUMNS))


def _place(point: Floats) -> Place:
    x, y, z = point.tolist()
    return x, y, z
