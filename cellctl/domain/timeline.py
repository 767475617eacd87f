"""The line table of a Program as arrays that can be searched: from a line and a fraction of it to time, arc length and tip, and back."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.arcs import along_and_across, arc_over_chord, fraction_of_arc

Floats = NDArray[np.float64]

STANDSTILL = 1e-3  # mm or deg: a joint that moved less between two reports did not move (firmware prints 3 decimals)


@dataclass(frozen=True)
class MotionLimits:
    """How the control accelerates, as far as it is known: from the cell file, or from the controller's own settings.

    acceleration : (axes,) float, mm/s2 or deg/s2     junction_deviation : mm (deg), how far a corner may be cut
    """

    acceleration: Floats
    junction_deviation: float


@dataclass(frozen=True)
class Timeline:
    """The line table of a Program as arrays that can be searched.

    time_start_s, time_end_s : (n,) float, predicted, from the start of the Program
    arc_mm : (n + 1,) float, path length of the tip in the build frame up to the start of each line, and at the end
    tip_end, axis_end : (n, 3) float; joints_end : (n, axes) float, machine coordinates
    is_emitting : (n,) bool, whether the gate is open on this line by the Program's own words
    bulge : (n,) float, tan(sweep / 4) of lines that are arcs of the joints of `plane`, 0: straight; none: all are
    bow : (n, 3) float, build frame, from the middle of the chord of the tip's way to the middle of the arc
    limits : how the control accelerates that the times were predicted for; none: at once
    actual : how it does accelerate, where it tells so itself; none: as in `limits`
    stops : (n,) bool, lines before which the machine stands for certain (barriers); none: only where the table has a pause
    """

    time_start_s: Floats
    time_end_s: Floats
    arc_mm: Floats
    tip_end: Floats
    axis_end: Floats
    joints_end: Floats
    is_emitting: NDArray[np.bool_]
    bulge: Floats = field(default_factory=lambda: np.zeros(0))
    bow: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    plane: tuple[int, int] = (0, 1)
    limits: MotionLimits | None = None
    actual: MotionLimits | None = None
    stops: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))

    @classmethod
    def from_table(
        cls,
        table: NDArray[Any],
        is_emitting: NDArray[np.bool_],
        bow: Floats | None = None,
        plane: tuple[int, int] = (0, 1),
        limits: MotionLimits | None = None,
        barriers: NDArray[np.int64] | None = None,
        actual: MotionLimits | None = None,
    ) -> Timeline:
        """From a Program's table, (n,) of planner.program.LINE_DTYPE, and the gate of each line.

        bow, plane : of its arcs    barriers : indices of lines before which the stream waits
        """
        tip = np.ascontiguousarray(table["tip_end"], dtype=np.float64)
        bulge = np.ascontiguousarray(table["bulge"], dtype=np.float64)
        steps = np.linalg.norm(np.diff(tip, axis=0), axis=1) if len(tip) > 1 else np.zeros(0)
        steps *= arc_over_chord(bulge[1:])
        first = np.zeros(2 if len(tip) else 1)
        stops = np.zeros(len(tip), dtype=np.bool_)
        if barriers is not None:
            stops[barriers] = True
        return cls(
            np.ascontiguousarray(table["time_start_s"], dtype=np.float64),
            np.ascontiguousarray(table["time_end_s"], dtype=np.float64),
            np.concatenate([first, np.cumsum(steps)]),
            tip,
            np.ascontiguousarray(table["axis_end"], dtype=np.float64),
            np.ascontiguousarray(table["joints_end"], dtype=np.float64),
            is_emitting,
            bulge,
            np.zeros((len(tip), 3)) if bow is None else bow,
            plane,
            limits,
            actual,
            stops,
        )

    def __len__(self) -> int:
        return len(self.time_start_s)

    def fraction(self, line: int, joints: Floats) -> float:
        """How much of the line is behind reported joints (axes,): projection on its chord or its arc, 0..1. A line without motion gives 0."""
        if line <= 0 or line >= len(self):
            return 0.0
        start = self.joints_end[line - 1]
        chord = self.joints_end[line] - start
        square = float(chord @ chord)
        if square < STANDSTILL**2:
            return 0.0
        if len(self.bulge) and self.bulge[line] != 0.0:
            xy = list(self.plane)
            return fraction_of_arc(start[xy], self.joints_end[line][xy], float(self.bulge[line]), joints[xy])
        return min(max(float((joints - start) @ chord) / square, 0.0), 1.0)

    def time_at(self, line: int, fraction: float) -> float:
        """Program time (s) at a fraction of a line."""
        if not len(self):
            return 0.0
        line = min(max(line, 0), len(self) - 1)
        return float(self.time_start_s[line] + fraction * (self.time_end_s[line] - self.time_start_s[line]))

    def arc_at(self, line: int, fraction: float) -> float:
        """Path length of the tip (mm) at a fraction of a line."""
        if not len(self):
            return 0.0
        line = min(max(line, 0), len(self) - 1)
        return float(self.arc_mm[line] + fraction * (self.arc_mm[line + 1] - self.arc_mm[line]))

    def tip_at(self, line: int, fraction: float) -> tuple[Floats, Floats]:
        """Tip (3,) mm and tool axis (3,) in the build frame at a fraction of a line."""
        line = min(max(line, 0), len(self) - 1)
        before = max(line - 1, 0)
        bulge = float(self.bulge[line]) if len(self.bulge) else 0.0
        along, across = along_and_across(bulge, fraction)
        tip = self.tip_end[before] + along * (self.tip_end[line] - self.tip_end[before])
        if bulge != 0.0:
            tip += across * 2.0 / abs(bulge) * self.bow[line]
        axis = self.axis_end[before] + fraction * (self.axis_end[line] - self.axis_end[before])
        length = float(np.linalg.norm(axis))
        return tip, axis / length if length > 0 else self.axis_end[line]

    def line_at(self, time_s: float) -> int:
        """Index of the line that is executing at a program time."""
        return int(min(max(int(np.searchsorted(self.time_end_s, time_s, side="right")), 0), max(len(self) - 1, 0)))
