"""The proof: a Program's own text through the twin's firmware, kinematics, process and stock in simulated time, without wires."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from config import Cell, Material, load_device, load_material
from sim import job as facts
from sim.compare import compare
from sim.findings import Findings
from sim.job import Job
from sim.picture import picture
from sim.process.clamping import SAMPLE_MM, TriangleMesh, clamp_block, clamp_mesh, in_build, inverse, metal_for
from sim.process.target import Target
from sim.proof import Proof, allowed_deviation_mm, program_digest, verdict
from sim.schedule import IdealController
from sim.world import World

Array = NDArray[np.float64]

STEP_S = 0.2  # of process time; motion inside a step is exact, and the metal does not depend on it
WAIT_STEP_S = 0.05  # while a barrier waits for the plant
FINE_STEP_S = 0.005  # while set-points change with the lines
STANDSTILL_S = 0.02  # the laser may be on at a standing tip for two ticks of the cell
STARVED_SHARE = 0.8  # powder below this share of its set-point starves the bead
LOW_EMISSION_W = 1.0
CELL_LEAST_MM, CELL_MOST_MM = 0.2, 0.5
CELLS_PER_TOLERANCE = 2.0
OFFSET_TOLERANCE = 1e-3  # mm or deg

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
) -> Proof:
    """Run the Program in the twin and measure what stands on the table.

    mesh : the part, mm, in the frame of its file
    stock : metal on the plate before the first line, mm, frame of the part's file; default: none, for process "mill" the part's box
        grown by the Program's stock_allowance_mm sideways and upwards. A Program that is milled from a given stock does not pass without it.
    cell_mm : grid of the stock; default: twice the tolerance, between 0.2 and 0.5 mm (surfaces are resolved to a fraction of it)
    progress : called with the share of lines executed (0 to 1) and a word

    The same Program, cell and mesh give the same Proof, byte for byte.
    """
    run = DryRun(program, cell, mesh, material or load_material(program.material), stock, cell_mm)
    run.execute(progress)
    return run.conclude()


class DryRun:
    """One Program in one simulated cell. `execute` runs it to its end or its first fatal finding, `conclude` gives the verdict."""

    def __init__(
        self, program: Job, cell: Cell, mesh: TriangleMesh, material: Material, stock: TriangleMesh | None, cell_mm: float | None
    ) -> None:
        self.program, self.cell, self.material = program, cell, material
        self.target = Target(in_build(mesh, program.build_from_part), np.asarray(mesh.facets), SAMPLE_MM)
        grid = cell_mm or float(np.clip(program.tolerance_mm * CELLS_PER_TOLERANCE, CELL_LEAST_MM, CELL_MOST_MM))
        self.metal = metal_for(cell, self._bounds(stock), grid, self.material, inverse(program.machine_from_build))
        self.stock = self.metal.stock
        self._has_stock = stock is not None or program.process != "mill" or program.stock_allowance_mm is not None
        if stock is not None:
            clamp_mesh(self.stock, stock, program.build_from_part)
        elif program.process == "mill" and program.stock_allowance_mm is not None:
            clamp_block(self.stock, self.target.bounds, program.stock_allowance_mm)
        devices = {role: load_device(link.device) for role, link in cell.links.items()}
        self.world = World(cell, devices, metal=self.metal, dead_man=False)
        self.controller = IdealController(program, self.world)
        self.world.cnc.supply = self.controller.supply
        self.findings = Findings(program)
        self._is_rapid = rapid_lines(program)
        self._standing_s = 0.0
        self._emitted_mm = 0.0

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

    def execute(self, progress: Progress | None = None) -> None:
        """Run all lines; stops early at an error or alarm of the firmware."""
        self._check_before()
        total = len(self.program.lines)
        said = -1
        while not self.controller.is_done and not self.findings.is_fatal:
            self.world.step(self._step_s())
            self._watch()
            for text in self.world.cnc.transmit().decode("latin-1").splitlines():
                self.controller.hear(text)
                self._hear(text)
            problem = self.controller.step()
            if problem:
                self.findings.add("process", problem, self.controller.next_line, fatal=True)
            percent = 100 * self.controller.acknowledged // max(1, total)
            if progress is not None and percent != said:
                said = percent
                progress(percent / 100.0, f"line {self.controller.acknowledged} of {total}")
        self.metal.finish()
        self._check_after()

    def _step_s(self) -> float:
        if self.controller.changes_near:
            return FINE_STEP_S
        return WAIT_STEP_S if self.controller.is_waiting else STEP_S

    def _check_before(self) -> None:
        if not self._has_stock:
            self.findings.add("no stock", "the Program mills a given stock: the proof needs its mesh", 0, fatal=True)
        offset = np.array([self.cell.placement.work_offset.get(letter, 0.0) for letter in self.cell.letters])
        if np.abs(offset - self.program.work_offset).max() > OFFSET_TOLERANCE:
            self.findings.add("work offset", f"the controller's G54 is {offset.tolist()}, the Program wants {self.program.work_offset.tolist()}", 0)
        longest = self.cell.cnc.line_length_max
        for index, line in enumerate(self.program.lines):
            if len(line) > longest:
                self.findings.add("line length", f"{len(line)} characters, the firmware takes {longest}", index + 1)

    def _check_after(self) -> None:
        deposits = self.program.process in ("hybrid", "deposit")
        if deposits and not self.findings.is_fatal and self._emitted_mm <= 0.0:
            self.findings.add("no emission", "the Program deposits, but the laser was never on", 0)

    def _hear(self, text: str) -> None:
        """Answers of the firmware that are no `ok`."""
        if text.startswith(("error:", "ALARM:")):
            line = self.controller.acknowledged if text.startswith("error:") else max(1, self.controller.executing)
            shown = self.program.lines[line - 1] if 0 < line <= len(self.program.lines) else ""
            self.findings.add("firmware", f"{text} at `{shown}`", line, fatal=True)

    def _watch(self) -> None:
        """Look at the last step: what the laser, the powder and the cutter did where."""
        trace = self.world.trace
        for line, depth in self.metal.engaged:
            if 0 < line <= len(self._is_rapid) and self._is_rapid[line - 1]:
                self.findings.add("rapid in metal", f"the cutter goes {depth:.2f} mm deep into metal at rapid speed", line)
            elif self.world.cnc.machine.spindle_rpm == 0.0:
                self.findings.add("spindle off", f"the cutter meets metal {depth:.2f} mm deep with the spindle standing", line)
        lit = trace.emission_w > LOW_EMISSION_W
        if not lit.any():
            self._standing_s = 0.0
            return
        step = np.linalg.norm(trace.tip1 - trace.tip0, axis=1)
        line = int(trace.line[lit][0])
        self._emitted_mm += float(step[lit].sum())
        standing = float(trace.dt[lit & (step < 1e-6)].sum())
        self._standing_s = self._standing_s + standing if standing else 0.0
        if self._standing_s > STANDSTILL_S:
            self.findings.add("standstill", "the laser is on while the tip stands", line)
        wanted = self.controller.powder_setpoint
        beads = lit & (trace.emission_w >= self.material.bead.min_power_w)
        if beads.any() and float(trace.powder_g_min[beads].min()) < STARVED_SHARE * wanted:
            self.findings.add("starved", f"powder {float(trace.powder_g_min[beads].min()):.1f} of {wanted:.1f} g/min while the laser is on", line)
        if not trace.head_deployed:
            self.findings.add("head parked", "the laser is on with the deposition head parked", line)
        kinds = self.program.table["kind"]
        known = trace.line[lit & (step > 1e-6) & (trace.line > 0) & (trace.line <= len(kinds))]
        stray = known[kinds[known - 1] != facts.PROCESS_LINE]
        if len(stray) > 1 or (len(stray) == 1 and float(trace.dt[lit].sum()) > STANDSTILL_S):
            self._stray(stray, trace.emission_w[lit].max())

    def _stray(self, lines: NDArray[np.int64], power: float) -> None:
        """Light on a line that deposits nothing, beyond the laser's own ramp."""
        ramp = 5.0 * self.cell.simulation.laser_ramp_s
        duration = float(self.world.trace.dt[np.isin(self.world.trace.line, lines) & (self.world.trace.emission_w > 0.1 * power)].sum())
        if duration > ramp + FINE_STEP_S:
            self.findings.add("stray light", f"the laser is on for {duration * 1e3:.0f} ms on a line that deposits nothing", int(lines[0]))

    def conclude(self) -> Proof:
        """Measure, judge and draw."""
        deviation = compare(self.stock, self.target)
        duration = self.world.time_s
        findings = self.findings.all()
        passed, reasons = verdict(self.program, self.material, deviation, findings)
        drawn = picture(self.stock, self.target, deviation, self.program.tolerance_mm, self.program.part_name)
        return Proof(
            passed=passed,
            program_sha256=program_digest(self.program),
            reasons=reasons,
            findings=findings,
            deviation=deviation,
            tolerance_mm=self.program.tolerance_mm,
            allowed_mm=round(allowed_deviation_mm(self.program, self.material), 4),
            duration_s=round(duration, 3),
            lines=len(self.program.lines),
            lines_executed=self.controller.acknowledged,
            deposited_mm3=round(self.stock.deposited_mm3, 1),
            lost_powder_mm3=round(self.stock.lost_powder_mm3, 1),
            picture=drawn,
        )


def rapid_lines(program: Job) -> NDArray[np.bool_]:
    """Which lines move at rapid speed: G0 is modal. -> (lines,) bool"""
    rapid = np.zeros(len(program.lines), dtype=bool)
    is_rapid = False
    pattern = re.compile(r"G0*([0123])(?![0-9.])")
    for index, line in enumerate(program.lines):
        for match in pattern.finditer(line):
            is_rapid = match.group(1) == "0"
        rapid[index] = is_rapid
    return rapid
