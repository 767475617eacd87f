"""Posting: moves per second, bytes per mm, errors against the plan, and the rates of the kinematics."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from config.cell import load_cell
from planner.kinematics.chain import Chain
from planner.kinematics.inverse import both_branches
from planner.plan import Plan
from planner.post import post_with_report
from planner.post.reread import check
from planner.program import LineKind
from tests.bench.table import Table
from tests.unit.planner.hand_plan import circle, cone_axis, cone_operation, contour_operation, fill_operation, plan_of

CELLS = ("trunnion_tcp", "head_head", "head_table")
LAYERS = 40
POSES = 100_000
REPEATS = 3


def run() -> list[Table]:
    """Both tables."""
    return [posting(), kinematics()]


def bench_plan() -> Plan:
    """Layers with a contour and hatch ways; on every fifth an ellipse is milled with a leaning, turning axis."""
    layers = []
    for layer in range(LAYERS):
        operations = [contour_operation(layer), fill_operation(layer)]
        if layer % 5 == 4:
            cone = cone_operation(layer)
            tip = circle(24.0, 0.0)
            stretched = tip.transformed(np.diag([1.0, 0.8, 1.0, 1.0]))
            passes = tuple(
                replace(item, tip=stretched, axis=cone_axis(tip, 20.0)) if not item.is_link else item
                for item in cone.passes
            )
            operations.append(replace(cone, passes=passes))
        layers.append(operations)
    return plan_of(*layers)


def best_of(work: Callable[[], object]) -> float:
    """Least time of several runs, s."""
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def posting() -> Table:
    """Post of the bench plan on each kind of machine, reread included."""
    plan = bench_plan()
    rows = []
    for name in CELLS:
        cell = load_cell(name)
        program, report = post_with_report(plan, cell)
        seconds = best_of(lambda cell=cell: post_with_report(plan, cell))
        reread_s = best_of(lambda cell=cell, program=program: check(program, plan, cell))
        process = program.table[program.table["kind"] == LineKind.PROCESS]
        length = float((process["arc_end_mm"] - process["arc_start_mm"]).sum())
        size = sum(len(program.lines[n - 1]) + 1 for n in process["n"])
        rows.append(
            [name, len(program.lines), seconds, len(program.lines) / seconds, reread_s, size / length,
             report.reread.max_tip_mm, report.reread.max_axis_deg, program.duration_s]
        )  # fmt: skip
    columns = ["cell", "lines", "post s", "lines/s", "of it reread s", "bytes/mm", "tip mm", "axis deg", "runs s"]
    note = f"{LAYERS} layers by hand; tolerance 0.01 mm and 0.05 deg; best of {REPEATS}. bytes/mm: of process lines."
    return Table("Post", columns, rows, note)


def kinematics() -> Table:
    """Forward and inverse kinematics of many poses at once."""
    rows = []
    for name in CELLS:
        cell = load_cell(name)
        chain, tool = Chain.from_cell(cell), np.array(cell.tools[0].tip_mm)
        draw = np.random.default_rng(3)
        joints = draw.uniform([-200.0, -200.0, -200.0, -100.0, -170.0], [200.0, 200.0, 0.0, 100.0, 170.0], (POSES, 5))
        tip, axis = chain.forward(joints, tool)
        found, _ = both_branches(chain, tip, axis, tool)
        back = [chain.forward(found[:, branch], tool) for branch in range(2)]
        error = max(float(np.abs(again[0] - tip).max()) for again in back)
        lean = max(float(np.abs(again[1] - axis).max()) for again in back)
        forward_s = best_of(lambda chain=chain, joints=joints, tool=tool: chain.forward(joints, tool))
        inverse_s = best_of(lambda chain=chain, tip=tip, axis=axis, tool=tool: both_branches(chain, tip, axis, tool))
        rows.append([name, POSES / forward_s, POSES / inverse_s, error, lean])
    columns = ["cell", "forward 1/s", "inverse, both branches 1/s", "tip there and back mm", "axis there and back"]
    return Table("Kinematics", columns, rows, f"{POSES} random poses at once, best of {REPEATS}.")
