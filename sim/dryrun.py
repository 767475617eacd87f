"""The proof: a Program's own text through the twin's firmware, kinematics, process and stock in simulated time, without wires."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from config import Cell, Material, load_device, load_material
from sim.checkpoint import DAMAGED, Checkpoints, Place, Prefix, facts_of_run
from sim.cnc.codes import LOCKED
from sim.compare import measure
from sim.contacts import Contacts
from sim.findings import Finding, Findings
from sim.job import Job
from sim.limits import check, targets_beyond_travel
from sim.machine import Machine
from sim.picture import picture
from sim.process.clamping import SAMPLE_MM, TriangleMesh, clamp_block, clamp_mesh, in_build, inverse, metal_for
from sim.process.target import Target
from sim.proof import Proof, program_digest, thresholds_of, verdict
from sim.remedies import explain
from sim.schedule import IdealController
from sim.state import freeze, thaw
from sim.watch import Watch
from sim.world import World

if TYPE_CHECKING:
    from sim.standing import Standing

Array = NDArray[np.float64]

STEP_S = 0.4  # of process time; motion inside a step is exact, and the metal does not depend on it
LONG_STEPS = 2.5  # of STEP_S: a step while nothing is due
WAIT_STEP_S = 0.1  # while a barrier waits for the plant
FINE_STEP_S = 0.005  # the least, up to the begin of a line with a set-point
BOUNDARY_STEP_S = 0.1  # while the planner may take the last lines of a layer: it shall not run dry where lines wait for the step's end
SHOWN_MAX = 100  # characters of a line at fault in a finding's text
CELL_LEAST_MM, CELL_MOST_MM = 0.2, 0.5
CELLS_PER_TOLERANCE = 2.0
CELLS_THROUGH = 6.0  # a part is at least so many cells thick, as long as they are not finer than CELL_FINEST_MM
CELL_FINEST_MM = 0.1
SURFACE_CELLS_MAX = 8e6  # stock and part keep about 200 bytes for each cell of their surface: 1.6 GB

Progress = Callable[[float, str], None]


def prove(
    program: Job,
    cell: Cell,
    mesh: TriangleMesh,
    *,
    material: Material | None = None,
    stock: TriangleMesh | None = None,
    cell_mm: float | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    checkpoints: Path | None = None,
    start: Standing | None = None,
) -> Proof:
    """Run the Program in the twin and measure what stands on the table.

    mesh : the part, mm, in the frame of its file
    stock : metal on the plate before the first line, mm, frame of the part's file; default: none, for process "mill" the part's box
        grown by the Program's stock_allowance_mm sideways and upwards. A Program that is milled from a given stock does not pass without it.
    cell_mm : grid of the stock; default: `usual_cell_mm` (surfaces are resolved to a fraction of it)
    progress : called with the share of lines executed (0 to 1) and a word
    cancelled : asked after every step of time; once it says yes, the proof raises ProofCancelled
    checkpoints : folder for states at the begins of layers, made if need be. A Program that was edited goes on from the last layer
        before the edit. What is there is to be trusted like a proof.
    start : the metal that is there before the first line, of `stock_after`: for a Program that makes the rest of a part. The finished part
        is judged; findings are those of this Program.

    The same Program, cell and mesh give the same Proof, byte for byte, with or without checkpoints.
    Raises ProofCancelled; OSError when the folder of checkpoints cannot be made.
    """
    run = DryRun(program, cell, mesh, material or load_material(program.material), stock, cell_mm, start)
    if checkpoints is not None:
        run.resume(Checkpoints(checkpoints, lambda line: progress(0.0, line) if progress is not None else None), mesh, stock)
        if run.resumed_at and progress is not None:
            progress(0.0, f"resumed at layer {program.table['layer'][run.resumed_at - 1]}, line N{run.resumed_at}")
    run.execute(progress, cancelled)
    return run.conclude()


class ProofCancelled(Exception):
    """The run was given up because its caller said so; says how far it came."""


class DryRun:
    """One Program in one simulated cell. `execute` runs it to its end or its first fatal finding, `conclude` gives the verdict."""

    def __init__(
        self, program: Job, cell: Cell, mesh: TriangleMesh, material: Material, stock: TriangleMesh | None, cell_mm: float | None,
        start: Standing | None = None,
    ) -> None:  # fmt: skip
        self.program, self.cell, self.material = program, cell, material
        self.target = Target(in_build(mesh, program.build_from_part), np.asarray(mesh.facets), SAMPLE_MM)
        self._start = start
        grid = start.cell_mm if start is not None else cell_mm or usual_cell_mm(self.target, program.tolerance_mm)
        self.bounds = self._bounds(stock) if start is None else start.bounds
        self.metal = metal_for(cell, self.bounds, grid, self.material, inverse(program.machine_from_build))
        self.stock = self.metal.stock
        self._has_stock = start is not None or stock is not None or program.process != "mill" or program.stock_allowance_mm is not None
        if start is not None:
            self.metal.restore(start.metal)
        elif stock is not None:
            clamp_mesh(self.stock, stock, program.build_from_part)
        elif program.process == "mill" and program.stock_allowance_mm is not None:
            clamp_block(self.stock, self.target.bounds, program.stock_allowance_mm)
        if program.process != "deposit":
            self.stock.guard(self.target)
        self.metal.layer_of_line = np.concatenate((np.zeros(1), program.table["layer"])).astype(np.int16)
        self.devices = {role: load_device(link.device) for role, link in cell.links.items()}
        self.world = World(cell, self.devices, dead_man=False)
        self.controller = IdealController(program, self.world, layer_begins(program))
        self.world.cnc.supply = self.controller.supply
        self.before, self.findings = Findings(program), Findings(program)  # seen without a run; seen in the run
        self.resumed_at = 0
        self._checkpoints: Checkpoints | None = None
        self._places: dict[int, Place] = {}
        build_from_table = inverse(program.machine_from_build)
        self.watch = Watch(program, cell, self.material, build_from_table, self.findings)
        gouge_mm = thresholds_of(program, cell, material)["gouge_mm"]
        machine = Machine(cell, self.world.chain, build_from_table)
        self.contacts = Contacts(
            machine, self.world.io, self.metal, self.target, self.watch, self.findings, gouge_mm, cell.proof.clearance_mm
        )  # fmt: skip
        self.world.metal = self.contacts
        if start is not None:
            self.watch.begin_with(start.path, start.emitted_mm)
            self.contacts.begin_with(start.cuts)
            self.world.cnc.stand_at(start.joints.tolist(), start.tool)

    def _bounds(self, stock: TriangleMesh | None) -> Array:
        """(2, 3) float, mm   Box of the part and of what it is cut from, build frame."""
        low, high = self.target.bounds
        if stock is not None:
            placed = in_build(stock, self.program.build_from_part)
            low, high = np.minimum(low, placed.min(axis=0)), np.maximum(high, placed.max(axis=0))
        elif self.program.process == "mill":
            grow = self.program.stock_allowance_mm or 0.0
            low, high = low - [grow, grow, 0.0], high + grow
        return np.array([low, high])

    @property
    def found(self) -> tuple[Finding, ...]:
        """All findings so far."""
        return self.before.all() + self.findings.all()

    def resume(self, checkpoints: Checkpoints, mesh: TriangleMesh, stock: TriangleMesh | None, before_line: int | None = None) -> None:
        """Keep the state at each layer's begin from now on, and go on from the latest that was kept of the same beginning.

        before_line : N-word; states from there on are not gone on from
        """
        program = self.program
        facts = facts_of_run(program, self.cell, self.devices, self.material, mesh, stock, self.stock.cell_mm)
        prefix = Prefix(facts if self._start is None else [*facts, self._start.sha256])
        places = prefix.places(tuple(program.lines), program.table, program.schedule, layer_begins(program))
        self._checkpoints, self._places = checkpoints, {place.line: place for place in places}
        fresh = self._tree()
        known = places if before_line is None else [place for place in places if place.line <= before_line]
        for place, tree in checkpoints.latest(known):
            try:
                self._restore(tree)
            except DAMAGED:
                self._restore(fresh)
                checkpoints.say(f"checkpoint of layer {place.layer} does not fit and is not used")
                continue
            self.resumed_at = place.line
            return

    def _tree(self) -> dict[str, Any]:
        """Everything that the run carries from step to step."""
        return {
            "world": freeze(self.world), "controller": self.controller.state(), "watch": self.watch.state(), "findings": self.findings.state(),
            "metal": self.metal.snapshot(), "contacts": self.contacts.state(),
        }  # fmt: skip

    def _restore(self, tree: dict[str, Any]) -> None:
        thaw(tree["world"], self.world)
        self.controller.restore(tree["controller"])
        self.watch.restore(tree["watch"])
        self.findings.restore(tree["findings"])
        self.metal.restore(tree["metal"])
        self.contacts.restore(tree["contacts"])

    def _at_boundary(self) -> None:
        """All before a layer is sent and nothing of it: the state depends on what is before."""
        place = self._places.get(self.controller.boundary)
        self.controller.pass_boundary()
        if place is not None and self._checkpoints is not None and not self.findings.is_fatal:
            self._checkpoints.keep(place, self._tree())

    def execute(self, progress: Progress | None = None, cancelled: Callable[[], bool] | None = None) -> None:
        """Run all lines; stops early at an error or alarm of the firmware. Raises ProofCancelled."""
        check(self.program, self.cell, self.world.cnc.build.line_length_max, self.before)
        if not self._has_stock:
            self.before.add("no stock", "the Program mills a given stock: the proof needs its mesh", 0, fatal=True)
        total = len(self.program.lines)
        said = -1
        while not self.controller.is_done and not self.is_over:
            if cancelled is not None and cancelled():
                raise ProofCancelled(f"cancelled at line {self.controller.acknowledged} of {total}")
            self.advance()
            percent = 100 * self.controller.acknowledged // max(1, total)
            if progress is not None and percent != said:
                said = percent
                progress(percent / 100.0, f"line {self.controller.acknowledged} of {total}")
        self.metal.finish()
        self.watch.finish(self.world)
        self.contacts.finish()
        self._check_after()
        if self._checkpoints is not None:
            self._checkpoints.sweep()

    @property
    def is_over(self) -> bool:
        """Whether a finding says that the run cannot go on."""
        return self.before.is_fatal or self.findings.is_fatal

    def advance(self) -> None:
        """One step of time, and what is seen, heard and done after it."""
        step_s = self._step_s()
        self.controller.begin_step(step_s)
        self.world.step(step_s)
        self.watch.step(self.world, self.controller, self.metal.laid)
        self.contacts.step()
        for text in self.world.cnc.transmit().decode("latin-1").splitlines():
            self.controller.hear(text)
            self._hear(text)
        if self.controller.at_boundary:
            self._at_boundary()
        problem = self.controller.step()
        if problem:
            self._fail("process", problem, self.controller.next_line)

    def _step_s(self) -> float:
        if self.controller.is_waiting:
            return WAIT_STEP_S
        usual = min(max(STEP_S, self.controller.quiet_s), LONG_STEPS * STEP_S)
        if self.controller.boundary_near:
            usual = BOUNDARY_STEP_S
        return max(min(usual, self.controller.until_next_s), FINE_STEP_S)

    def _check_after(self) -> None:
        deposits = self.program.process in ("hybrid", "deposit")
        if deposits and not self.is_over and self.watch.emitted_mm <= 0.0:
            self.findings.add("no emission", "the Program deposits, but the laser was never on", 0)

    def _fail(self, kind: str, text: str, line: int, help: str = "") -> None:
        """A finding that ends the run, where the tip stands."""
        self.findings.add(kind, text, line, fatal=True, at_mm=self.watch.place(self.world.tip_position), help=help)

    def _hear(self, text: str) -> None:
        """Answers of the firmware that are no `ok`."""
        word, _, number = text.partition(":")
        if word not in ("error", "ALARM"):
            return
        machine = self.world.cnc.machine
        line = self.controller.acknowledged if word == "error" else max(1, self.controller.executing)
        if word == "ALARM" and machine.refused_target:
            self._tell_travel()
            return
        if word == "error" and int(number) == LOCKED and self.findings.is_fatal:
            return  # what comes after an alarm that is told already
        text_of_line = self.program.lines[line - 1] if 0 < line <= len(self.program.lines) else ""
        shown = text_of_line if len(text_of_line) <= SHOWN_MAX else text_of_line[:SHOWN_MAX] + "..."
        meaning, remedy = explain(word, int(number))
        self._fail("firmware", f"{text} ({meaning}) at `{shown}`", line, help=remedy)

    def _tell_travel(self) -> None:
        """The firmware refuses a target beyond the travel: name this one and all others of the text."""
        for found in targets_beyond_travel(self.program.lines, self.cell):
            tip = self.world.chain.tip_in_table(np.array([found.target]), found.tool)[0]
            depth = abs(found.by) if found.axis.kind == "linear" else 0.0
            self.findings.add(
                "travel", found.text, found.line, fatal=True, at_mm=self.watch.place(tip), depth_mm=depth, rank=abs(found.by)
            )

    def conclude(self) -> Proof:
        """Measure, judge and draw."""
        program, tolerance_mm = self.program, self.program.tolerance_mm
        measured = measure(self.stock, self.target, self.watch.layer_paths(), tolerance_mm=tolerance_mm)
        findings = self.found
        thresholds = thresholds_of(program, self.cell, self.material)
        passed, reasons = verdict(measured.whole, measured.milled, findings, thresholds)
        clearance = self.contacts.clearance_mm
        return Proof(
            passed=passed,
            program_sha256=program_digest(program),
            reasons=reasons,
            findings=findings,
            deviation=measured.whole,
            tolerance_mm=tolerance_mm,
            allowed_mm=round(thresholds["allowed_mm"], 4),
            duration_s=round(self.world.time_s, 3),
            lines=len(program.lines),
            lines_executed=self.controller.acknowledged,
            deposited_mm3=round(self.stock.deposited_mm3, 1),
            lost_powder_mm3=round(self.stock.lost_powder_mm3, 1),
            picture=picture(self.stock, self.target, measured.whole, tolerance_mm, program.part_name, measured.built),
            removed_mm3=round(self.stock.removed_mm3, 1),
            clearance_mm=None if clearance is None else round(clearance, 4),
            thresholds=thresholds,
            layers=measured.layers,
            milled=measured.milled,
            histogram=measured.histogram,
            timeline=self.watch.timeline(),
            built=measured.built,
        )


def usual_cell_mm(target: Target, tolerance_mm: float) -> float:
    """Grid for a part: twice the tolerance between 0.2 and 0.5 mm, finer for a part that is flat, coarser for one too large for memory."""
    usual = float(np.clip(tolerance_mm * CELLS_PER_TOLERANCE, CELL_LEAST_MM, CELL_MOST_MM))
    thin = max(CELL_FINEST_MM, float(np.ptp(target.bounds, axis=0).min()) / CELLS_THROUGH)
    return max(min(usual, thin), float(np.sqrt(target.areas.sum() / SURFACE_CELLS_MAX)))


def layer_begins(program: Job) -> list[int]:
    """N-words of the lines that begin a layer after the first: the first line of each greater layer number."""
    layer = np.maximum.accumulate(program.table["layer"].astype(np.int64))
    return [int(index) + 2 for index in np.flatnonzero(np.diff(layer) > 0) if layer[index] >= 0]
