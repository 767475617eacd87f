"""The swept flank against ruled walls whose deviation has a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from planner.nurbs.curve import Curve
from planner.plan import Wall
from planner.toolpath.flank import flank_deviation
from planner.toolpath.motion import process_pass, turning

RADIUS_MM = 4.0
ROW = [0.0, 10.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("off", [-0.05, 0.0, 0.08])
def test_flank_beside_a_flat_wall_deviates_by_its_distance_less_its_radius(off: float) -> None:
    wall = Wall(Curve.from_polyline([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]]), Curve.from_polyline([[0.0, 0.0, 5.0], [20.0, 0.0, 5.0]]))
    y = RADIUS_MM + off
    step = process_pass(turning([[-1.0, y, -1.0], [21.0, y, -1.0]], [[0.0, 0.0, 1.0]] * 2), ROW)
    into, left = flank_deviation(wall, [step], RADIUS_MM)
    assert into == pytest.approx(max(-off, 0.0), abs=5e-3)
    assert left == pytest.approx(max(off, 0.0), abs=5e-3)


def test_flank_turned_off_a_wall_at_its_top_leaves_the_wedge() -> None:
    wall = Wall(Curve.from_polyline([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]]), Curve.from_polyline([[0.0, 0.0, 5.0], [20.0, 0.0, 5.0]]))
    lean = np.radians(2.0)
    axis = np.array([0.0, np.sin(lean), np.cos(lean)])
    start = np.array([-1.0, RADIUS_MM / np.cos(lean), 0.0]) - axis
    step = process_pass(turning([start, start + np.array([22.0, 0.0, 0.0])], [axis] * 2), ROW)
    _, left = flank_deviation(wall, [step], RADIUS_MM)
    assert left == pytest.approx(5.0 * np.sin(lean), rel=0.02)
