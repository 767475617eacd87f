"""The written text read back by a parser of its own, moved by the forward kinematics and compared with the Plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from config.material import load_material
from planner.errors import PostError
from planner.kinematics.chain import Chain, Floats
from planner.plan import Operation, Pass, Plan
from planner.post.dialect import check_dialect, joint_dialect
from planner.post.pass_curve import PassCurve
from planner.post.per_length import is_off, powder_slack_s, power_slack_s
from planner.post.read_blocks import Reading
from planner.post.tools import tools_for
from planner.program import Channel, LineKind, Program

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Bounds = tuple[tuple[int, Channel, float, float, str], ...]

_PROBES = (0.25, 0.5, 0.75, 1.0)
_FEED_SLACK = 0.005  # relative: the tip's speed varies a little within a move whose rotary joints turn
_ROUNDING_SHARE = 0.4  # of the chord tolerance: what rounding of all words may add to a move
_SAME_ARC_MM = 1e-6
_FAR_MM = 0.05  # along the pass: what one projection on the chord is good for
_NEWTON_STEPS = 3


@dataclass(frozen=True)
class RereadReport:
    """Largest differences between text and Plan.

    max_tip_mm, max_axis_deg : over all passes   max_feed_ratio : speed of the tip over the planned feed, 1 at most but for rounding
    setpoints_ok : gate, laser level, powder and gas of every process line are those of the Plan; faults says where not
    """

    max_tip_mm: float
    max_axis_deg: float
    max_feed_ratio: float
    setpoints_ok: bool
    faults: tuple[str, ...]


def read(program: Program) -> Reading:
    """Parse the text of a program in joint coordinates. Raises PostError with the line where it is not what its dialect writes."""
    check_dialect(program.dialect)
    return joint_dialect(program.dialect).read(program)


def check(
    program: Program,
    plan: Plan,
    cell: Cell,
    chain: Chain | None = None,
    posted: Mapping[int, Operation] | None = None,
) -> RereadReport:
    """Compare the Program's text with the Plan it was posted from, at quarters of every move.

    cell : fitted to the dialect   chain : that of the placement (default: of the cell's own)
    posted : the operations as they are run, by number (default: as planned). Raises PostError if the text cannot be read.
    """
    chain = chain or Chain.from_cell(cell)
    reading = read(program)
    rounding_mm = _ROUNDING_SHARE * cell.chord_tolerance_mm
    table = program.table
    levels = _levels(program, reading)
    worst, bounds = np.zeros(3), _bounds(plan, cell)
    faults: list[str] = []
    moving = np.flatnonzero(reading.is_motion & (table["pass_"] >= 0))
    key = table["operation"][moving].astype(np.int64) * (1 << 31) + table["pass_"][moving]
    groups = np.split(np.arange(len(moving)), np.flatnonzero(np.diff(key)) + 1) if moving.size else []
    paths = _paths(chain, reading, moving, {tool.number: np.array(tool.tip_mm) for tool in cell.tools})
    operations = dict(enumerate(plan.operations)) | dict(posted or {})
    for group in groups:
        lines = moving[group]
        number, index = int(table["operation"][lines[0]]), int(table["pass_"][lines[0]])
        item = operations[number].passes[index]
        place = f"pass {index} of operation {number}"
        curve = PassCurve(item, program.machine_from_build, place)
        fit = [tool.number for tool in tools_for(operations[number], cell)]
        tools = reading.tool[lines]
        if tools[0] not in fit or np.any(tools != tools[0]):
            faults.append(f"{place}: another tool is in")
        errors = _geometry(paths[0][:, group], paths[1][:, group], table, lines, curve)
        ratio = _feed_ratio(paths[0][:, group], reading, table, lines, item, curve, rounding_mm)
        worst = np.maximum(worst, [*errors, ratio])
        if operations[number].process.is_deposit:
            faults += _set_point_faults(program.gate, reading, table, levels, lines, item, curve)
            faults += _per_length_faults(table, levels, lines, item, curve, bounds)
        elif np.any(reading.spindle_rpm[lines] != round(operations[number].spindle_rpm)):
            faults.append(f"{place}: the spindle does not turn as planned")
        elif reading.gate[lines].any() or levels[lines, Channel.EMISSION].any():
            faults.append(f"{place}: the laser's gate is open while milling")
    return RereadReport(float(worst[0]), float(worst[1]), float(worst[2]), not faults, tuple(faults[:20]))


def _paths(chain: Chain, reading: Reading, moving: Ints, tool_tips: dict[int, Floats]) -> tuple[Floats, Floats]:
    """True tips and axes, (5, k, 3) each, at the start and the quarters of the moving lines (k,), table frame."""
    shares = np.array((0.0, *_PROBES))
    joints = np.stack([reading.at(moving, share) for share in shares.tolist()])
    tips, axes = np.empty((len(shares), len(moving), 3)), np.empty((len(shares), len(moving), 3))
    for number in np.unique(reading.tool[moving]):
        of_tool, tool_tip = np.flatnonzero(reading.tool[moving] == number), tool_tips[int(number)]
        tip, axis = chain.forward(joints[:, of_tool].reshape(-1, joints.shape[2]), tool_tip)
        tips[:, of_tool], axes[:, of_tool] = tip.reshape(-1, len(of_tool), 3), axis.reshape(-1, len(of_tool), 3)
    return tips, axes


def _geometry(
    tips: Floats, axes: Floats, table: NDArray[np.void], lines: Ints, curve: PassCurve
) -> tuple[float, float]:
    """Largest distance of the true tip (5, k, 3) from the pass, mm, and of the axis, deg."""
    start, span = table["arc_start_mm"][lines], table["arc_end_mm"][lines] - table["arc_start_mm"][lines]
    arcs = (start + np.array(_PROBES)[:, None] * span).ravel()
    tip, axis = tips[1:].reshape(-1, 3), axes[1:].reshape(-1, 3)
    chord = np.tile(tips[-1] - tips[0], (len(_PROBES), 1))
    u = curve.at_arc_length(arcs)
    off = tip - curve.tips(u)
    length = np.linalg.norm(chord, axis=1)
    along = np.divide(np.einsum("ij,ij->i", off, chord), length, out=np.zeros(len(off)), where=length > 0.0)
    nearer = curve.at_arc_length(np.clip(arcs + along, 0.0, curve.length_mm))
    if np.abs(along).max() > _FAR_MM:  # the text goes along the pass in another rhythm than its arc length
        for _ in range(_NEWTON_STEPS):
            nearer = curve.nearest(tip, nearer)
    distance = np.minimum(np.linalg.norm(off, axis=1), np.linalg.norm(tip - curve.tips(nearer), axis=1))
    apart = [np.linalg.norm(axis - curve.axes(at), axis=1) for at in (u, nearer)]
    half = 0.5 * np.minimum(apart[0], apart[1])
    return float(distance.max()), float(np.rad2deg(2.0 * np.arcsin(np.clip(half, 0.0, 1.0)).max()))


def _feed_ratio(
    tips: Floats,
    reading: Reading,
    table: NDArray[np.void],
    lines: Ints,
    item: Pass,
    curve: PassCurve,
    rounding_mm: float,
) -> float:
    """Largest speed of the true tip (5, k, 3), but for rounding, over the planned feed; 0 for rapids."""
    if item.rapid:
        return 0.0
    row = np.searchsorted(curve.set_point_arcs, table["arc_start_mm"][lines] + _SAME_ARC_MM, side="right") - 1
    way = np.linalg.norm(np.diff(tips, axis=0), axis=2).sum(axis=0)
    return float(np.max((way - rounding_mm) / (np.maximum(reading.time_s[lines], 1e-9) * item.setpoints[row, 1])))


def _levels(program: Program, reading: Reading) -> Floats:
    """(n, channels) float: what the schedule, and for the power the stream, has set when each line begins."""
    levels = np.zeros((len(program.lines), len(Channel)))
    for channel in Channel:
        of_channel = program.schedule[program.schedule["channel"] == channel]
        place = np.searchsorted(of_channel["n"], np.arange(1, len(program.lines) + 1), side="right")
        levels[:, channel] = np.append(0.0, of_channel["value"])[place]
    said = ~np.isnan(reading.power_w)
    levels[said, Channel.LASER_W] = reading.power_w[said]
    return levels


def _set_point_faults(
    gate: str, reading: Reading, table: NDArray[np.void], levels: Floats, lines: Ints, item: Pass, curve: PassCurve
) -> list[str]:
    row = np.searchsorted(curve.set_point_arcs, table["arc_start_mm"][lines] + _SAME_ARC_MM, side="right") - 1
    planned = item.setpoints[row]
    emits = (planned[:, 2] > 0.0) & (not item.is_link)
    is_open = reading.gate[lines] if gate == "stream" else levels[lines, Channel.EMISSION] > 0.0
    wrong = is_open != emits
    wrong = wrong | (emits & (np.abs(levels[lines, Channel.SHIELD_GAS_L_MIN] - planned[:, 4]) > 1e-9))
    wrong = wrong | (emits & (levels[lines, Channel.MODE] != 1.0))
    process = table["kind"][lines] == (LineKind.LINK if item.is_link else LineKind.PROCESS)
    return [f"line {int(line) + 1}: set-points differ from {curve.place}" for line in lines[wrong | ~process]]


def _per_length_faults(
    table: NDArray[np.void], levels: Floats, lines: Ints, item: Pass, curve: PassCurve, bounds: Bounds
) -> list[str]:
    """Where power or powder over time is not that of the plan over the way."""
    row = np.searchsorted(curve.set_point_arcs, table["arc_start_mm"][lines] + _SAME_ARC_MM, side="right") - 1
    planned = item.setpoints[row]
    time_s = table["time_end_s"][lines] - table["time_start_s"][lines]
    share = (table["arc_end_mm"][lines] - table["arc_start_mm"][lines]) / np.maximum(time_s * planned[:, 1], 1e-12)
    emits = (planned[:, 2] > 0.0) & (not item.is_link)
    found = []
    for column, channel, floor, slack_s, word in bounds:
        level = np.where(emits, levels[lines, channel], 0.0)
        off = is_off(level, np.where(emits, planned[:, column], 0.0), share, time_s, floor, slack_s)
        found += [f"line {int(line) + 1}: {word} per length differs from {curve.place}" for line in lines[off]]
    return found


def _bounds(plan: Plan, cell: Cell) -> Bounds:
    """Column of the set-points, channel, least level, slack and word of what is compared per length."""
    if not any(operation.process.is_deposit for operation in plan.operations):
        return ()
    window = load_material(plan.material).deposition
    return (
        (2, Channel.LASER_W, window.laser_w.min, power_slack_s(cell), "laser energy"),
        (3, Channel.POWDER_G_MIN, window.powder_g_min.min, powder_slack_s(cell), "powder"),
    )


def verify(report: RereadReport, cell: Cell) -> None:
    """Raise PostError if the text leaves the cell's tolerances or the Plan's set-points."""
    if report.max_tip_mm > cell.chord_tolerance_mm or report.max_axis_deg > cell.axis_tolerance_deg:
        raise PostError(
            f"the written program is {report.max_tip_mm:.4f} mm and {report.max_axis_deg:.4f} deg off the plan "
            f"(tolerance {cell.chord_tolerance_mm:g} mm, {cell.axis_tolerance_deg:g} deg)",
            "raise chord_tolerance_mm or axis_tolerance_deg of the cell file",
        )
    if report.max_feed_ratio > 1.0 + _FEED_SLACK:
        raise PostError(
            f"the written program is {report.max_feed_ratio:.4f} times as fast as the plan", "report this program"
        )
    if not report.setpoints_ok:
        raise PostError(f"the written program breaks the plan's set-points: {report.faults[0]}", "report this program")
