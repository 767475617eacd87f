"""Axes given at points along a ring: the kinks between them are evened out of the rotary joints, the ring's tilt stays."""

from __future__ import annotations

import numpy as np

from config.cell import load_cell
from planner.kinematics.chain import Chain
from planner.nurbs.curve import Curve
from planner.plan import Pass
from planner.post.linearise import LinearOperation, linearise
from planner.post.pass_curve import PassCurve
from planner.post.poses import PoseSolver
from planner.post.room import table_from_build
from planner.post.smooth_pass import CONE_SHARE, rotary_share, smoothed
from tests.unit.planner.hand_plan import bead, circle

CONE_DEG, LEAN_DEG, RADIUS_MM = 15.0, 50.0, 8.0


def test_kinks_between_the_axes_of_a_ring_no_longer_slow_the_rotary_joints() -> None:
    cell = load_cell("trunnion_tcp")
    tool = cell.tools[0]
    solver = PoseSolver(Chain.from_cell(cell), cell, np.array(tool.tip_mm))
    placed = table_from_build(cell.placement.part_origin_mm, 0.0)
    tip, lean = circle(RADIUS_MM, 5.0, 36), np.deg2rad(LEAN_DEG)
    points = tip.evaluate(tip.breaks) / RADIUS_MM
    vectors = np.column_stack([np.sin(lean) * points[:, :2], np.full(len(points), np.cos(lean))])
    knots = np.concatenate([tip.breaks[:1], tip.breaks, tip.breaks[-1:]])
    planned = PassCurve(Pass(tip, Curve(1, knots, vectors), bead(tip).setpoints), placed, "ring")

    def moves_of(curve: PassCurve) -> LinearOperation:
        return linearise([curve], solver, np.zeros(5), cell.chord_tolerance_mm, cell.axis_tolerance_deg)

    before = moves_of(planned)
    held = rotary_share([planned], before, solver).held[0]
    even = smoothed([planned], np.array([True]), before, solver, placed, tool, CONE_DEG)[0]
    after = rotary_share([even], moves_of(even), solver).held[0]
    assert held < 0.7 and after > 0.95
    at = np.linspace(*tip.domain, 400)
    tilt = np.rad2deg(np.arccos(even.axes(at)[:, 2]))
    assert np.ptp(tilt) < 0.1 and np.abs(tilt - LEAN_DEG).max() < 0.5
    assert np.rad2deg(np.arccos(np.clip((even.axes(at) * planned.axes(at)).sum(axis=1), -1.0, 1.0))).max() < CONE_SHARE * CONE_DEG
    assert np.abs(even.axes(at[[0, -1]]) - planned.axes(at[[0, -1]])).max() < 1e-9 and np.abs(even.tips(at) - planned.tips(at)).max() == 0.0
