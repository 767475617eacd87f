"""The follower against the simulated control on posted programs: where it says that the machine is, between reports at 10 Hz."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

import planner
from cellctl.domain.sync import Follower, Timeline
from config.cell import load_cell
from planner.post import post
from planner.program import LineKind, Program
from tests.bench.following import Ride, changed
from tests.bench.part_run import part_of
from tests.bench.table import Table

SECONDS = 150.0
SPEED_MM_S = 20.0  # errors are told for this speed
EVERY = 3  # status periods of which one is compared finely
SLOWEST_MM_S = 1.0

CASES: list[tuple[str, str, dict[str, Any]]] = [
    ("contours, arcs, as predicted", "pipe", {}),
    ("five axes, hatches, as predicted", "bearing", {}),
    ("without Ln, contours", "pipe", {"with_lines": False}),
    ("without Ln, hatches", "bearing", {"with_lines": False}),
    ("half the acceleration, told by $$", "bearing", {"acceleration": 0.5, "is_known": True}),
    ("half the acceleration, learnt", "bearing", {"acceleration": 0.5}),
    ("twice the acceleration, 5x junction deviation, told", "bearing", {"acceleration": 2.0, "deviation": 5.0, "is_known": True}),
    ("twice the acceleration, 5x junction deviation, learnt", "bearing", {"acceleration": 2.0, "deviation": 5.0}),
    ("half the acceleration, 1/5 deviation, learnt, no Ln", "bearing", {"acceleration": 0.5, "deviation": 0.2, "with_lines": False}),
    ("time stamps unsure by +-1 ms", "pipe", {"jitter_s": 0.002}),
    ("time stamps unsure by +-5 ms", "pipe", {"jitter_s": 0.01}),
    ("override 50, 133, 90 %, commanded by us", "pipe", {"overrides": ((20.0, 50), (40.0, 133), (70.0, 90))}),
    ("override 50, 133, 90 %, by another hand", "pipe", {"overrides": ((20.0, 50), (40.0, 133), (70.0, 90)), "tells_override": False}),
    ("holds, commanded by us", "pipe", {"holds": ((20.0, 1.0), (45.0, 0.3), (70.0, 2.0))}),
    ("holds, by another hand", "pipe", {"holds": ((20.0, 1.0), (45.0, 0.3), (70.0, 2.0)), "tells_override": False}),
]  # fmt: skip


def programs() -> dict[str, Program]:
    """Posted for the shipped trunnion cell."""
    cell, found = load_cell("trunnion_tcp"), {}
    for name in ("pipe", "bearing"):
        mesh, recipe = part_of(name)
        found[name] = post(planner.plan(mesh, recipe, part_name=name), cell)
    return found


def ride(program: Program, seconds: float = SECONDS, *, acceleration: float = 1.0, deviation: float = 1.0, **how: Any) -> Ride:
    """Run a Program on a control that may accelerate otherwise than the cell file says."""
    model = load_cell("trunnion_tcp")
    given = Ride(program, changed(model, acceleration=acceleration, deviation=deviation), model, every=EVERY, **how)
    given.run(seconds)
    return given


def row(name: str, given: Ride) -> list[str | float | int]:
    """Errors on process lines, as they would be at 20 mm/s: a time is what they are made of."""
    speeds = np.array(given.speeds)
    kind = given.program.table["kind"][[line for _, line, _ in given.where]]
    chosen = (kind == LineKind.PROCESS) & (speeds > SLOWEST_MM_S)
    errors, tips = np.abs(np.array(given.errors_mm))[chosen], np.array(given.tips_mm)[chosen]
    scaled = errors * SPEED_MM_S / np.maximum(np.median(speeds[chosen]), SLOWEST_MM_S)
    p50, p99 = np.quantile(scaled, [0.5, 0.99])
    claimed = np.array(given.claims_mm)[chosen]
    honest = float(np.mean(errors <= claimed + 0.002))
    return [
        name, given.follower.source, int(chosen.sum()), float(np.median(speeds[chosen])),
        float(p50), float(p99), float(scaled.max()), float(np.quantile(tips, 0.99)), 100.0 * honest,
    ]  # fmt: skip


def costs(program: Program) -> list[list[str | float | int]]:
    """CPU time of a report and of a prediction, on the part's own table and on one of 5 million lines."""
    rows: list[list[str | float | int]] = []
    for name, given in (("bearing", program), ("5 million lines", repeated(program, 5_000_000))):
        started = time.process_time()
        timeline = timeline_of_table(given)
        made_s = time.process_time() - started
        follower = Follower(timeline, 0.1)
        reports, predictions = [], []
        start = len(timeline) // 2
        for k in range(4000):
            at = float(timeline.time_start_s[start]) + 0.1 * k
            line = timeline.line_at(at)
            span = float(timeline.time_end_s[line] - timeline.time_start_s[line])
            share = (at - float(timeline.time_start_s[line])) / span if span > 0 else 0.0
            joints = timeline.joints_end[line - 1] + share * (timeline.joints_end[line] - timeline.joints_end[line - 1])
            begun = time.process_time_ns()
            follower.report(line, joints, at, is_run=True, feed=600.0)
            reports.append((time.process_time_ns() - begun) / 1e3)
            begun = time.process_time_ns()
            for ahead in (0.0, 0.01, 0.02, 0.03, 0.04):
                follower.predicted_arc(at + ahead)
            predictions.append((time.process_time_ns() - begun) / 5e3)
        quantiles = np.quantile(reports, [0.5, 0.99])
        rows.append([name, made_s, *map(float, quantiles), max(reports), float(np.mean(reports)), *map(float, np.quantile(predictions, [0.5, 0.99]))])
    return rows


def repeated(program: Program, lines: int) -> Program:
    """The Program's table over and over, one after the other in time."""
    table = program.table
    count = math.ceil(lines / len(table))
    whole = np.tile(table, count)[:lines]
    shift = np.repeat(np.arange(count), len(table))[:lines] * float(table["time_end_s"][-1])
    whole["time_start_s"] += shift
    whole["time_end_s"] += shift
    return replace(program, table=whole)


def timeline_of_table(program: Program) -> Timeline:
    """Without the gate and the arcs' bows, which cost elsewhere."""
    return Timeline.from_table(program.table, np.zeros(len(program.table), dtype=np.bool_), np.zeros((len(program.table), 3)))


def run() -> list[Table]:
    """Cases and costs."""
    posted = programs()
    rows = [row(name, ride(posted[part], **how)) for name, part, how in CASES]
    columns = [
        "case", "source", "samples", "median mm/s", "p50 mm at 20 mm/s", "p99", "max", "tip off by, p99 mm", "within error_mm %",
    ]  # fmt: skip
    note = (
        f"{SECONDS:g} s of each program on the simulated control, reports at 10 Hz with three decimals, compared every 2 ms between them, process "
        "lines. A hand or override at the machine is known only when the next report tells it: that is the maximum of those rows."
    )
    cost = ["table", "made, CPU s", "report p50 us", "p99", "max", "mean", "predicted_arc p50 us", "p99"]
    return [
        Table("Follower: arc length between reports", columns, rows, note),
        Table("Follower: cost", cost, costs(posted["bearing"]), "CPU time on one core, others busy."),
    ]
