"""The course of the run over time: set-points beside what came of them, speed, gap, temperature, layers and findings; and its figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim.job import Job
from sim.report.chart import BOTTOM, LEFT, Frame, Scale, legend, number, spanning, svg
from sim.report.markup import Node, tag

if TYPE_CHECKING:
    from sim.proof import Proof
    from sim.timeline import Timeline

Array = NDArray[np.float64]

HEAD = 30.0  # room above the first frame for legend and findings
STEP = 80.0  # from one frame to the next
HEIGHT = 68.0
RAPID_PERCENTILE = 90.0  # of the speeds: what is much faster is a rapid
MARK_STEP = 17.0  # least distance of two numbers above the charts
MARKS_MAX = 24  # findings marked


def section(proof: Proof, program: Job) -> list[Node]:
    """Charts over time, then times and volumes."""
    return [tag("h2", "Course of the run"), *_charts(proof), _volumes(proof, program)]


def _volumes(proof: Proof, program: Job) -> Node:
    """Time, metal and powder."""
    cubic = "mm\N{SUPERSCRIPT THREE}"
    pairs = [
        ("Machine time", f"{proof.duration_s:.0f} s"),
        ("Deposited", f"{proof.deposited_mm3:.0f} {cubic}"),
        ("Powder lost", f"{proof.lost_powder_mm3:.0f} {cubic} of solid metal"),
        ("Removed by cutters", f"{proof.removed_mm3:.0f} {cubic}"),
        ("Volume of the part", f"{proof.deviation.part_mm3:.0f} {cubic}"),
    ]
    return tag("dl", *(tag("div", tag("dt", name), tag("dd", value)) for name, value in pairs), class_="pairs")


def _charts(proof: Proof) -> list[Node]:
    """All charts below each other on one scale of time."""
    course = proof.timeline
    if len(course) < 2:
        return [tag("p", "The run was too short for a chart.")]
    unit, per = ("min", 60.0) if course.time_s[-1] > 600.0 else ("s", 1.0)
    time = course.time_s / per
    x = Scale(0.0, float(time[-1] + (time[-1] - time[-2])), f"time, {unit}")
    rows = _rows(course)
    drawn: list[Node | None] = [legend((("set", "set-point"), ("is", "what came of it"), ("key-range", "least to greatest")), LEFT + 4, 9.0)]
    for index, (scale, setpoint, value, extremes) in enumerate(rows):
        frame = Frame(x, scale, HEIGHT, HEAD + STEP * index)
        drawn.append(frame.axes(with_x=index == len(rows) - 1))
        drawn.append(_layer_lines(course, frame, time))
        if extremes is not None:
            drawn.append(_range(frame, time, *extremes))
        if setpoint is not None:
            drawn.append(frame.line(time, setpoint, "set"))
        drawn.append(frame.line(time, value, "is"))
    bottom = HEAD + STEP * (len(rows) - 1) + HEIGHT
    drawn.append(_findings(proof, x, per, bottom))
    words = (
        "Laser, powder, speed of the tip over the table, height of the focus above the metal, and temperature of the part below the bead over time."
        " Faster moves than those of the process are cut off. Grey lines: begin of a layer. Numbers above: findings."
    )
    return [tag("figure", svg(bottom + BOTTOM, words, *drawn), tag("figcaption", words))]


Row = tuple[Scale, Array | None, Array, tuple[Array, Array] | None]


def _rows(course: Timeline) -> list[Row]:
    """Scale, set-point, value and extremes of each chart; gap and temperature only where something was deposited."""
    rows: list[Row] = [
        (
            spanning(np.append(course.emission_max_w, course.power_setpoint_w), "laser, W"),
            course.power_setpoint_w,
            course.emission_w,
            (course.emission_min_w, course.emission_max_w),
        ),
        (
            spanning(np.append(course.powder_max_g_min, course.powder_setpoint_g_min), "powder, g/min"),
            course.powder_setpoint_g_min,
            course.powder_nozzle_g_min,
            (course.powder_min_g_min, course.powder_max_g_min),
        ),
        (
            spanning(_process_speeds(course), "speed, mm/s"),
            course.speed_programmed_mm_s,
            course.speed_mm_s,
            (course.speed_min_mm_s, course.speed_max_mm_s),
        ),
    ]
    if np.isfinite(course.gap_mm).any():
        extremes = np.append(course.gap_min_mm, course.gap_max_mm)
        rows.append((spanning(extremes, "gap, mm", 0.2), None, course.gap_mm, (course.gap_min_mm, course.gap_max_mm)))
    if np.isfinite(course.base_k).any() and float(np.nanmax(course.base_k)) > 0.0:
        rows.append((spanning(course.base_k - 273.15, "part, °C", 20.0), None, course.base_k - 273.15, None))
    return rows


def _process_speeds(course: Timeline) -> Array:
    """Speed that the scale has to hold: that of nine spans in ten, of those with laser if there are any; rapids would flatten all others."""
    lit = course.emission_w > 0.0
    return np.array([1.3 * np.percentile((course.speed_mm_s[lit] if lit.any() else course.speed_mm_s), RAPID_PERCENTILE)])


def _range(frame: Frame, time: Array, low: Array, high: Array) -> Node:
    """A band from least to greatest, one bar per row of the timeline."""
    good = np.isfinite(low) & np.isfinite(high) & (high > low)
    wide = np.append(np.diff(time), time[-1] - time[-2])
    return frame.bars(time[good], (time + wide)[good], low[good], high[good], "range")


def _layer_lines(course: Timeline, frame: Frame, time: Array) -> Node:
    """Where each layer begins."""
    begins = np.flatnonzero(np.diff(course.layer) > 0) + 1
    at = frame.px(time[begins])
    return tag("path", d="".join(f"M{value:.1f} {frame.at_y:g}v{frame.height:g}" for value in at), class_="layer")


def _findings(proof: Proof, x: Scale, per: float, bottom: float) -> Node:
    """The number of each finding that has a line, where the run reaches that line."""
    course = proof.timeline
    frame = Frame(x, Scale(0.0, 1.0), 0.0, HEAD)
    ranked = sorted(proof.findings, key=lambda finding: finding.severity != "error")
    marks: list[tuple[float, int]] = []
    for index, finding in list(enumerate(ranked, 1))[:MARKS_MAX]:
        reached = np.flatnonzero(course.line >= finding.line)
        if finding.line > 0 and len(reached):
            marks.append((float(frame.px(float(course.time_s[reached[0]]) / per)), index))
    drawn: list[Node] = []
    free = 0.0
    for at, index in sorted(marks):
        sign = max(at, free)
        free = sign + MARK_STEP
        drawn.append(tag("path", d=f"M{at:.1f} {bottom:g}V{HEAD:g}L{sign:.1f} {HEAD - 4:g}", class_="limit"))
        drawn.append(tag("path", d=f"M{sign - 8:.1f} {HEAD - 16:g}h16v9l-8 4l-8 -4Z", class_="fault"))
        drawn.append(tag("text", number(index), x=round(sign, 1), y=HEAD - 8, class_="fault-text middle"))
    return tag("g", *drawn)
