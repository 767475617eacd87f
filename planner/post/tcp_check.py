"""A reading of a program in workpiece coordinates compared with the Plan as posted: every motion, in place, direction, speed and outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from config.material import load_material
from planner.kinematics.chain import Chain
from planner.plan import Operation, Pass
from planner.post.linearise import angle_between_deg
from planner.post.pass_curve import PassCurve
from planner.post.per_length import is_off, powder_slack_s, power_slack_s
from planner.post.reading import How, Reading
from planner.post.reread import RereadReport
from planner.post.tools import tools_for
from planner.program import Channel, LineKind, Program

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SHARES = np.array((0.25, 0.5, 0.75, 1.0))
_PER_SPAN = 8  # places within each span: more than a rational cubic has coefficients
_SAME_ARC_MM = 1e-6
_FEED_SLACK = 1e-4  # relative: digits of the feed
_MEAN_SLACK = 2e-3  # relative: how far the mean speed of a stretch may be above its feed through rounding
_ROUNDING_MM = 2e-4  # how near positions said twice have to be
_LEVEL_SLACK = 1e-3
_MOST_FAULTS = 20


@dataclass
class _Worst:
    """Largest differences so far, and what is wrong."""

    tip_mm: float = 0.0
    axis_deg: float = 0.0
    feed_ratio: float = 0.0
    faults: list[str] = field(default_factory=list)

    def note(self, line: int, because: str) -> None:
        self.faults.append(f"line {line + 1}: {because}")


class _Checker:
    def __init__(
        self, reading: Reading, program: Program, posted: Mapping[int, Operation], cell: Cell, chain: Chain
    ) -> None:
        self._reading, self._program, self._posted, self._cell, self._chain = reading, program, posted, cell, chain
        self._matrix = program.machine_from_build.copy()
        linear = [k for k, axis in enumerate(cell.axes) if axis.kind == "linear"]
        self._offset = np.zeros(3)
        for k in linear:
            self._offset["XYZ".index(cell.axes[k].letter)] = program.work_offset[k]
        self._matrix[:3, 3] -= self._offset
        self._motions = reading.motions()
        self._worst = _Worst()
        self._polylines: list[tuple[Ints, Pass]] = []  # motions of passes that are compared all at once
        self._bounds = _bounds(program, posted, cell)
        self._scheduled = _scheduled(program)
        self._starts, self._start_axes = self._begins()

    def report(self) -> RereadReport:
        motions, table = self._motions, self._program.table
        rows = table[motions["line"]]
        key = np.where(rows["pass_"] >= 0, rows["operation"].astype(np.int64) << 32 | rows["pass_"], -1)
        edges = np.flatnonzero(np.append(True, np.diff(key) != 0)) if len(key) else np.zeros(0, dtype=np.int64)
        seen = set()
        for begin, end in zip(edges.tolist(), [*edges[1:].tolist(), len(key)], strict=True):
            if key[begin] >= 0:
                seen.add((int(key[begin]) >> 32, int(key[begin]) & 0xFFFFFFFF))
                self._pass(np.arange(begin, end), int(key[begin]) >> 32, int(key[begin]) & 0xFFFFFFFF)
            else:
                self._positioning(np.arange(begin, end))
        if self._polylines:
            self._straight_lines()
        for number, operation in self._posted.items():
            for index in range(len(operation.passes)):
                if (number, index) not in seen and operation.passes[index].tip.length > self._cell.chord_tolerance_mm:
                    self._worst.faults.append(f"pass {index} of operation {number} is missing")
        worst = self._worst
        faults = tuple(worst.faults[:_MOST_FAULTS])
        return RereadReport(worst.tip_mm, worst.axis_deg, worst.feed_ratio, not faults, faults)

    def _begins(self) -> tuple[Floats, Floats]:
        """Where each motion begins: tips and axes, workpiece; machine moves by the forward kinematics."""
        motions = self._motions
        tips, axes = motions["tip"].copy(), motions["axis"].copy()
        lengths = {tool.number: np.array(tool.tip_mm) for tool in self._cell.tools}
        told = np.isfinite(motions["rotary"]).all(axis=1) & (motions["how"] != How.MACHINE)
        axes[told] = self._axes_of(motions["rotary"][told])
        named: set[str] = set()
        for index, words in self._reading.joints.items():
            line = int(motions["line"][index])
            planned = self._program.table["joints_end"][line]
            joints = np.array([[words.get(letter, planned[k]) for k, letter in enumerate(self._cell.letters)]])
            named |= words.keys()
            if (
                index + 1 < len(motions)
                and motions["how"][index + 1] != How.MACHINE
                and named != set(self._cell.letters)
            ):
                self._worst.note(line, "an axis has not been told where to go")
            after = int(motions["tool"][index : index + 2][-1])  # a change of tool moves nothing but the tip
            tip, axis = self._chain.forward(joints, lengths.get(after, np.zeros(3)))
            tips[index], axes[index] = tip[0] - self._offset, axis[0]
            if np.abs(joints[0] - planned).max() > _ROUNDING_MM:
                self._worst.note(line, "the axes go elsewhere than planned")
        known = np.isfinite(axes[:, 0])
        last = np.maximum.accumulate(np.where(known, np.arange(len(known)), 0))
        axes = axes[last]
        self._ends = axes
        return np.vstack([tips[:1], tips[:-1]]), np.vstack([axes[:1], axes[:-1]])

    def _positioning(self, group: Ints) -> None:
        """Moves that belong to no pass: dark, and where the line table says."""
        motions = self._motions[group]
        self._fault(motions, motions["gate"] > 0.0, "the laser's gate is open while positioning")
        rows = self._program.table[motions["line"]]
        tips = rows["tip_end"] @ self._matrix[:3, :3].T + self._matrix[:3, 3]
        off = np.linalg.norm(motions["tip"] - tips, axis=1)
        turned = angle_between_deg(self._ends[group], rows["axis_end"] @ self._matrix[:3, :3].T)
        follows = motions["how"] != How.MACHINE
        wrong = follows & ~((off <= _ROUNDING_MM) & (turned <= self._cell.axis_tolerance_deg))
        self._fault(motions, wrong, "the tip goes elsewhere than planned")

    def _axes_of(self, rotary: Floats) -> Floats:
        """(n, 3) axes of rotary positions (n, 2), deg."""
        joints = np.zeros((len(rotary), len(self._cell.axes)))
        joints[:, [k for k, axis in enumerate(self._cell.axes) if axis.kind == "rotary"]] = rotary
        return self._chain.forward(joints, np.zeros(3))[1]

    def _between(self, group: Ints, share: Floats) -> Floats:
        """(n, 3) axes at a share of the motions: rotary axes go evenly where the control is told them, else the axis turns in a plane."""
        axis = self._start_axes[group] + share * (self._ends[group] - self._start_axes[group])
        axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12)
        rotary = self._motions["rotary"]
        before = rotary[np.maximum(group - 1, 0)]
        told = np.isfinite(before).all(axis=1) & np.isfinite(rotary[group]).all(axis=1)
        if told.any():
            axis[told] = self._axes_of(before[told] + share[told] * (rotary[group][told] - before[told]))
        return axis

    def _pass(self, group: Ints, number: int, index: int) -> None:
        operation = self._posted[number]
        item = operation.passes[index]
        place = f"pass {index} of operation {number}"
        curve = PassCurve(item, self._matrix, place)
        motions = self._motions[group]
        straight = group[(motions["how"] == How.LINE) | (motions["how"] == How.RAPID)]
        if straight.size and item.tip.degree == 1 and item.tip.weights is None and curve.has_constant_axis:
            self._polylines.append((straight, item))
        elif straight.size:
            self._straight(straight, curve)
        for k in group[motions["how"] == How.CURVE].tolist():
            self._curve(k, curve)
        end = curve.tips(np.array([item.tip.domain[1]]))[0]
        begin = curve.tips(np.array([item.tip.domain[0]]))[0]
        for tip, wanted, line in ((self._starts[group[0]], begin, group[0]), (motions["tip"][-1], end, group[-1])):
            if not np.linalg.norm(tip - wanted) <= self._cell.chord_tolerance_mm:
                self._worst.note(
                    int(self._motions["line"][line]), f"{place} does not run from its beginning to its end"
                )
        self._outputs(group, operation, item, curve)

    def _rows(self, group: Ints) -> tuple[Floats, Floats]:
        """Arc lengths at which motions begin and end."""
        table = self._program.table
        lines, firsts = self._motions["line"][group], self._motions["first_line"][group]
        return table["arc_start_mm"][firsts], table["arc_end_mm"][lines]

    def _straight_lines(self) -> None:
        """Motions along polylines whose axis stands, of all passes: arc lengths of one pass begin far behind those of the one before."""
        rotation, shift = self._matrix[:3, :3], self._matrix[:3, 3]
        passes = [item for _, item in self._polylines]
        sizes = [len(item.tip.control_points) for item in passes]
        corners = np.concatenate([item.tip.control_points for item in passes]) @ rotation.T + shift
        corner_of = np.repeat(np.arange(len(passes)), sizes)
        reached = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
        last = np.cumsum(sizes) - 1
        begin = reached[np.append(0, last[:-1] + 1)]
        length, reached = reached[last] - begin, reached - begin[corner_of]
        far = 1.0 + float(length.max())
        place = far * corner_of + reached
        group = np.concatenate([motions for motions, _ in self._polylines])
        of = np.tile(np.repeat(np.arange(len(passes)), [len(motions) for motions, _ in self._polylines]), len(_SHARES))

        def tips(arc: Floats) -> Floats:
            at = far * of + np.clip(arc, 0.0, length[of])
            return np.column_stack([np.interp(at, place, corners[:, k]) for k in range(3)])

        axes = np.array([item.axis for item in passes], dtype=np.float64).reshape(-1, 3) @ rotation.T
        planned = (axes / np.linalg.norm(axes, axis=1, keepdims=True))[of]
        every, arc, tip, axis, along = self._written(group, tips)
        off = np.minimum(np.linalg.norm(tip - tips(arc), axis=1), np.linalg.norm(tip - tips(arc + along), axis=1))
        self._take(group[every], off, angle_between_deg(axis, planned))

    def _written(self, group: Ints, tips: Callable[[Floats], Floats]) -> tuple[Ints, Floats, Floats, Floats, Floats]:
        """At shares of straight motions: which motion, arc length, tip, axis, and how far along the motion the tip is ahead of the pass."""
        starts, ends = self._rows(group)
        tip0, tip1 = self._starts[group], self._motions["tip"][group]
        way = np.linalg.norm(tip1 - tip0, axis=1)
        share = np.repeat(_SHARES, len(group))
        every = np.tile(np.arange(len(group)), len(_SHARES))
        chord = (tip1 - tip0)[every]
        tip = tip0[every] + share[:, None] * chord
        arc = starts[every] + share * (ends - starts)[every]
        along = np.einsum("ij,ij->i", tip - tips(arc), chord) / np.maximum(way[every], 1e-9)
        axis = self._between(group[every], share[:, None])
        return every, arc, tip, axis, np.where((way > _ROUNDING_MM)[every], along, 0.0)

    def _straight(self, group: Ints, curve: PassCurve) -> None:
        every, arc, tip, axis, along = self._written(group, lambda arc: curve.tips(curve.at_arc_length(arc)))
        at = curve.at_arc_length(arc)
        nearer = curve.at_arc_length(np.clip(arc + along, 0.0, curve.length_mm))
        off = np.minimum(np.linalg.norm(tip - curve.tips(at), axis=1), np.linalg.norm(tip - curve.tips(nearer), axis=1))
        turned = np.minimum(angle_between_deg(axis, curve.axes(at)), angle_between_deg(axis, curve.axes(nearer)))
        self._take(group[every], off, turned)

    def _curve(self, k: int, curve: PassCurve) -> None:
        """A NURBS at places that fix all its polynomial pieces, each compared with the pass at the same parameter."""
        read = self._reading.curves[int(self._motions["curve"][k])]
        starts, ends = self._rows(np.array([k]))
        low, high = curve.source.tip.domain
        begin, end = curve.at_arc_length(np.concatenate([starts, ends])).tolist()
        begin = low if starts[0] <= _SAME_ARC_MM else begin
        end = high if curve.length_mm - ends[0] <= _SAME_ARC_MM else end
        shares = read.shares(_PER_SPAN)
        tips, second = read.points(shares)
        at = np.clip(begin + shares * (end - begin), low, high)
        if second is None:
            axes = np.tile(self._start_axes[k], (len(at), 1))
        else:
            axes = (second - tips) / np.linalg.norm(second - tips, axis=1, keepdims=True)
        off = np.linalg.norm(tips - curve.tips(at), axis=1)
        if np.linalg.norm(tips[0] - self._starts[k]) > _ROUNDING_MM:
            self._worst.note(int(self._motions["line"][k]), "a NURBS does not begin where the tool stands")
        self._take(np.array([k]), off[None, :].max(axis=1), angle_between_deg(axes, curve.axes(at)).max(keepdims=True))

    def _take(self, group: Ints, off: Floats, turned: Floats) -> None:
        off, turned = np.nan_to_num(off, nan=1e9), np.nan_to_num(turned, nan=180.0)
        self._worst.tip_mm = max(self._worst.tip_mm, float(off.max()))
        self._worst.axis_deg = max(self._worst.axis_deg, float(turned.max()))
        wide = np.flatnonzero((off > self._cell.chord_tolerance_mm) | (turned > self._cell.axis_tolerance_deg))
        for k in wide[:1]:
            line = int(self._motions["line"][group[k]])
            self._worst.note(line, f"{off[k]:.4f} mm and {turned[k]:.4f} deg off the pass")

    def _outputs(self, group: Ints, operation: Operation, item: Pass, curve: PassCurve) -> None:
        motions = self._motions[group]
        starts, ends = self._rows(group)
        middle = 0.5 * (starts + ends)
        row = np.searchsorted(curve.set_point_arcs, middle + _SAME_ARC_MM, side="right") - 1
        planned = item.setpoints[row]
        moves = ends - starts > _SAME_ARC_MM
        if not item.rapid:
            ratio = motions["feed_mm_min"] / (60.0 * planned[:, 1])
            self._worst.feed_ratio = max(self._worst.feed_ratio, float(np.max(ratio[moves], initial=0.0)))
            self._fault(motions, moves & (ratio > 1.0 + _FEED_SLACK), "the feed is higher than the plan's")
            self._lowered(motions, planned[:, 1], starts, ends)
            self._fault(motions, moves & (motions["how"] == How.RAPID), "a pass at feed goes at rapid")
        is_deposit = operation.process.is_deposit
        emits = (planned[:, 2] > 0.0) & (not item.is_link) & is_deposit
        self._fault(motions, moves & ((motions["gate"] > 0.0) != emits), "the laser's gate is not as planned")
        wrong = np.abs(motions["levels"][:, 3] - planned[:, 4]) > _LEVEL_SLACK
        self._fault(motions, moves & emits & wrong, "the shield gas is not as planned")
        if emits.any():
            off = np.abs(motions["levels"][:, :2] - self._scheduled[motions["first_line"]]).max(axis=1)
            self._fault(motions, moves & emits & (off > _LEVEL_SLACK), "laser or powder are not as scheduled")
            self._per_length(group, item, curve)
        self._fault(motions, moves & emits & (motions["mode"] != 1.0), "not in the mode that deposits")
        if not is_deposit:
            self._fault(motions, motions["rpm"] != round(operation.spindle_rpm), "the spindle does not turn as planned")
        self._fault(
            motions,
            ~np.isin(motions["tool"], [tool.number for tool in tools_for(operation, self._cell)]),
            "another tool is in",
        )
        kind = LineKind.LINK if item.is_link else LineKind.PROCESS
        self._fault(motions, self._program.table["kind"][motions["line"]] != kind, "the line table calls it otherwise")

    def _lowered(self, motions: NDArray[np.void], planned_mm_s: Floats, starts: Floats, ends: Floats) -> None:
        """A feed below the plan's has to be the speed that the line table predicts, or more, over the stretch for which it holds."""
        table, feed = self._program.table, motions["feed_mm_min"]
        time_s = table["time_end_s"][motions["line"]] - table["time_start_s"][motions["first_line"]]
        first = np.flatnonzero(np.append(True, np.diff(feed) != 0.0))
        mean = 60.0 * np.add.reduceat(ends - starts, first) / np.maximum(np.add.reduceat(time_s, first), 1e-9)
        wrong = (feed[first] < 60.0 * planned_mm_s[first] * (1.0 - _FEED_SLACK)) & (
            mean > (1.0 + _MEAN_SLACK) * feed[first]
        )
        self._fault(motions[first], wrong, "the feed is lower than the plan's, and no axis needs it")

    def _per_length(self, group: Ints, item: Pass, curve: PassCurve) -> None:
        """Laser and powder over time against the plan's over the way, line by line."""
        motions = self._motions
        lines = np.arange(motions["first_line"][group[0]], motions["line"][group[-1]] + 1)
        rows = self._program.table[lines]
        levels = motions["levels"][group[np.searchsorted(motions["line"][group], lines).clip(0, len(group) - 1)]]
        row = np.searchsorted(curve.set_point_arcs, rows["arc_start_mm"] + _SAME_ARC_MM, side="right") - 1
        planned = item.setpoints[row]
        time_s = rows["time_end_s"] - rows["time_start_s"]
        share = (rows["arc_end_mm"] - rows["arc_start_mm"]) / np.maximum(time_s * planned[:, 1], 1e-12)
        emits = planned[:, 2] > 0.0
        for column, level, floor, slack_s, word in self._bounds:
            given = np.where(emits, levels[:, level], 0.0)
            off = is_off(given, np.where(emits, planned[:, column], 0.0), share, time_s, floor, slack_s)
            for k in np.flatnonzero(off)[:1]:
                self._worst.note(int(lines[k]), f"{word} per length is not the plan's")

    def _fault(self, motions: NDArray[np.void], wrong: NDArray[np.bool_], because: str) -> None:
        for k in np.flatnonzero(wrong)[:1]:
            self._worst.note(int(motions["line"][k]), because)


def _scheduled(program: Program) -> Floats:
    """(lines, 2) W and g/min that the schedule has at each line."""
    numbers = np.arange(1, len(program.lines) + 1)
    levels = np.zeros((len(numbers), 2))
    for column, channel in enumerate((Channel.LASER_W, Channel.POWDER_G_MIN)):
        rows = program.schedule[program.schedule["channel"] == channel]
        levels[:, column] = np.append(0.0, rows["value"])[np.searchsorted(rows["n"], numbers, side="right")]
    return levels


def _bounds(
    program: Program, posted: Mapping[int, Operation], cell: Cell
) -> tuple[tuple[int, int, float, float, str], ...]:
    """Column of the set-points, level, least one, slack and word of what is compared per length."""
    if not any(operation.process.is_deposit for operation in posted.values()):
        return ()
    window = load_material(program.material).deposition
    return (
        (2, 0, window.laser_w.min, power_slack_s(cell), "laser energy"),
        (3, 1, window.powder_g_min.min, powder_slack_s(cell), "powder"),
    )


def compare(
    reading: Reading, program: Program, posted: Mapping[int, Operation], cell: Cell, chain: Chain
) -> RereadReport:
    """How far a program's motions are from the Plan as posted, at quarters of straight moves and densely along NURBS.

    posted : operations by number, with the axes that they are run with   chain : that of the placement
    """
    return _Checker(reading, program, posted, cell, chain).report()
