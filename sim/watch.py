"""The watch over a run: what laser, powder, tip and cutter do in each step against what they should, as findings, timeline and paths."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from config import Cell, Material
from sim import watch_kernels as wk
from sim.cnc import lookahead as la
from sim.findings import Findings, Place
from sim.job import PROCESS_LINE, Job
from sim.schedule import IdealController
from sim.timeline import Recorder, Timeline
from sim.trace import Trace
from sim.world import World

Floats = NDArray[np.float64]

LOW_EMISSION_W = 1.0
DRY_G_MIN = 0.05
RAMPS = 5.0  # time constants after which the laser has followed its gate
SLOW_SHARE = 0.6  # of the speed that belongs to the power: below it the bead gets two thirds more energy than planned
SLOW_SPOTS = 1.0  # over more than one spot's diameter: a shorter slow stretch is inside one melt pool and evens out
CLAMP_SHARE = 0.98  # a feed that an axis limit takes less than this of is not rounding
PATH_SPACING_MM = 0.5  # of the process paths that layers are told by
EVENTS_MAX = 4096


class Laid(Protocol):
    """What the metal tells of the pieces of its last trace."""

    @property
    def defocus_mm(self) -> Floats:
        """(k,) height of the focus above the surface, NaN where nothing was laid."""

    @property
    def base_k(self) -> Floats:
        """(k,) temperature of the part."""


class Watch:
    """Looks at every step of a run. `step` after each step of the World, `finish` at the end."""

    def __init__(self, program: Job, cell: Cell, material: Material, build_from_table: Floats, findings: Findings) -> None:
        self._cell, self._findings, self._frame = cell, findings, build_from_table
        table = program.table
        self._kinds = np.concatenate((np.zeros(1, np.uint8), table["kind"].astype(np.uint8)))
        self.layer_of_line = np.concatenate((np.array([-1]), table["layer"].astype(np.int64)))
        self._limits = np.zeros(wk.LIMITS)
        limits, ramp = cell.proof, RAMPS * cell.simulation.laser_ramp_s
        heads = [tool.diameter_mm for tool in cell.tools if tool.kind == "deposition"]
        for place, value in (
            (wk.LOW_W, LOW_EMISSION_W), (wk.MELTS_W, material.bead.min_power_w), (wk.MOVING_MM_S, cell.limits.moving_mm_s),
            (wk.STANDSTILL_S, limits.standstill_s), (wk.STRAY_S, limits.stray_s + ramp), (wk.STARVED_SHARE, limits.starved_share),
            (wk.DRY_G_MIN, DRY_G_MIN), (wk.SLOW_SHARE, SLOW_SHARE), (wk.SLOW_MM, SLOW_SPOTS * max(heads)), (wk.CLAMP_SHARE, CLAMP_SHARE),
            (wk.WASTE_MM, material.deposition.lead_in_mm + material.deposition.lead_out_mm + max(heads)),
        ):  # fmt: skip
            self._limits[place] = value
        self._fastest = np.array([axis.max_velocity for axis in cell.axes])
        self._episodes = np.zeros((wk.EPISODES, wk.KIND))
        self._events = np.zeros((EVENTS_MAX, wk.KIND + 1))
        self._lines = np.zeros((len(table) + 1, 2))  # by line: rapid, greatest spindle speed
        self._last_point = np.full(4, np.inf)
        self._last_line = 0
        self._path: list[Floats] = []
        self._recorder = Recorder()
        self.emitted_mm = 0.0

    def step(self, world: World, controller: IdealController, laid: Laid | None = None) -> None:
        """Look at the last step of the World: its pieces of motion and its trace belong together."""
        pieces, trace = world.cnc.machine.motion.pieces, world.trace
        count = len(trace)
        speeds = np.empty((count, 2))
        events, lit_mm = wk.scan(
            pieces, trace.tip0, trace.tip1, trace.emission_w, trace.powder_g_min, self._kinds, self._limits, self._fastest, controller.power_setpoint,
            controller.powder_setpoint, trace.head_deployed, self._episodes, self._lines, speeds, self._events,
        )  # fmt: skip
        self.emitted_mm += lit_mm
        if events:
            self._tell(self._events[:events], world)
        moved = pieces[:, la.PIECE_LINE]
        moved = moved[moved > 0.0]
        if len(moved):  # after the telling: an idle wait ends where a step begins
            self._last_line = int(moved[-1])
        self._note_path(pieces, trace)
        values = np.empty((count, 8))
        values[:, 0], values[:, 1] = controller.power_setpoint, trace.emission_w
        values[:, 2], values[:, 3] = controller.powder_setpoint, trace.powder_g_min
        values[:, 4], values[:, 5] = speeds[:, wk.TIP_PROGRAMMED], speeds[:, wk.TIP_SPEED]
        known = laid is not None and len(laid.defocus_mm) == count
        values[:, 6] = laid.defocus_mm if laid is not None and known else np.nan
        values[:, 7] = laid.base_k if laid is not None and known else np.nan
        self._recorder.add(pieces[:, la.DURATION], pieces[:, la.PIECE_LINE], values)

    def finish(self, world: World) -> None:
        """End what is still going on."""
        events = wk.close_all(self._episodes, self._limits, self._events)
        self._tell(self._events[:events], world)

    def state(self) -> dict[str, Any]:
        """What a run carries on from step to step, as plain data and arrays."""
        path = np.concatenate(self._path) if self._path else np.zeros((0, 5))
        return {
            "episodes": self._episodes.copy(), "lines": self._lines[: 1 + int(np.flatnonzero(self._lines.any(axis=1)).max(initial=0))].copy(),
            "last_point": self._last_point.copy(), "path": path, "recorder": self._recorder.state(), "emitted_mm": self.emitted_mm,
            "last_line": self._last_line,
        }  # fmt: skip

    def begin_with(self, path: Floats, emitted_mm: float) -> None:
        """Paths of the process, (n, 5), and way with the laser on, of a run that this one goes on from."""
        self._path, self.emitted_mm = [np.array(path)], emitted_mm

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a state. Raises ValueError or KeyError when it does not fit."""
        self._episodes[...] = state["episodes"]
        self._lines[:] = 0.0
        self._lines[: len(state["lines"])] = state["lines"]
        self._last_point[...] = state["last_point"]
        self._path = [np.array(state["path"])]
        self._recorder.restore(state["recorder"])
        self.emitted_mm = float(state["emitted_mm"])
        self._last_line = int(state["last_line"])

    def timeline(self) -> Timeline:
        """The course of the run so far."""
        return self._recorder.timeline(self.layer_of_line)

    def layer_paths(self) -> tuple[Floats, NDArray[np.int64]]:
        """Points of the process paths, (n, 3) float, mm, build frame, and the layer of each; of beads, or of cuts if nothing was deposited."""
        path = np.concatenate(self._path) if self._path else np.zeros((0, 5))
        if path[:, 4].any():
            path = path[path[:, 4] > 0.0]
        points = path[:, :3] @ self._frame[:3, :3].T + self._frame[:3, 3]
        return points, path[:, 3].astype(np.int64)

    def is_rapid(self, line: int) -> bool:
        """Whether a line moved at rapid speed."""
        return bool(0 < line < len(self._lines) and self._lines[line, 0])

    def spindle_rpm(self, line: int) -> float:
        """Greatest speed of the spindle during a line."""
        return float(self._lines[line, 1]) if 0 < line < len(self._lines) else 0.0

    def is_process(self, line: int) -> bool:
        """Whether a line is there to deposit or to cut."""
        return bool(0 < line < len(self._kinds) and self._kinds[line] == PROCESS_LINE)

    def place(self, point: Floats) -> Place:
        """A point of the table frame in the build frame, mm."""
        x, y, z = (self._frame[:3, :3] @ point + self._frame[:3, 3]).tolist()
        return x, y, z

    def _note_path(self, pieces: Floats, trace: Trace) -> None:
        out = np.empty((len(trace), 5))
        count = wk.thin_path(
            pieces, trace.tip1, trace.emission_w, LOW_EMISSION_W, self._kinds, self.layer_of_line, PATH_SPACING_MM, self._last_point, out
        )
        if count:
            self._path.append(out[:count].copy())

    def _tell(self, events: Floats, world: World) -> None:
        for event in events:
            kind, line = int(event[wk.KIND]), int(event[wk.LINE]) or self._last_line  # idle: after the last line that moved
            name, text, warns = self._words(kind, event, world)
            depth = float(event[wk.LENGTH]) if kind in (wk.STRAY, wk.STARVED, wk.WASTE, wk.SLOW, wk.SPEED) else 0.0
            self._findings.add(
                name, text, line, at_mm=self.place(event[wk.X : wk.Z + 1]), depth_mm=depth, severity="warning" if warns else "error",
                rank=float(event[wk.WORST] if kind in (wk.STARVED, wk.SPEED) else event[wk.SECONDS]),
            )  # fmt: skip

    def _words(self, kind: int, event: Floats, world: World) -> tuple[str, str, bool]:
        """Kind, text and whether it is only a warning."""
        seconds, length, worst = float(event[wk.SECONDS]), float(event[wk.LENGTH]), float(event[wk.WORST])
        if kind == wk.STANDSTILL:
            return "standstill", f"the laser is on for {seconds * 1e3:.0f} ms while the tip stands", False
        if kind == wk.STRAY:
            return "stray light", f"the laser is on for {seconds * 1e3:.0f} ms and {length:.2f} mm on a line that deposits nothing", False
        if kind == wk.PARKED:
            return "head parked", "the laser is on with the deposition head parked", False
        if kind == wk.STARVED:
            cause = " (the hopper is empty)" if world.feeder.hopper_g <= 0.0 else ""
            return "starved", f"the laser melts with {100.0 * (1.0 - worst):.0f} % of its powder over {length:.2f} mm{cause}", False
        if kind == wk.WASTE:
            return "waste", f"powder at {worst:.1f} g/min flows for {length:.1f} mm over the part without laser", True
        if kind == wk.SLOW:
            return "acceleration", f"the tip moves at {100.0 / worst:.0f} % of the speed that belongs to its power, over {length:.2f} mm", False
        letter = f"axis {self._cell.letters[int(event[wk.AXIS])]}"
        lit = float(event[wk.POWER]) > LOW_EMISSION_W
        effect = "the bead becomes so much heavier" if lit else "it cuts slower than planned"
        return "speed", f"{letter} would have to move {worst:.2f} times as fast as it can: {effect}, over {length:.2f} mm", not lit
