"""The compiled kernel of fitting against its numpy twin."""

from __future__ import annotations

import numpy as np
import pytest

from planner.nurbs.fit import fit_table
from planner.nurbs.fit_kernel import LONGEST
from planner.nurbs.segments import contour_table
from planner.nurbs.tangents import STRAIGHT, UNEVEN
from tests.unit.planner.fit_shapes import fourier_shape, known_shapes
from tests.unit.planner.fit_twin import bezier_net

SIZE_MM = 50.0


@pytest.mark.parametrize("matched", [False, True], ids=["speed", "curvature"])
@pytest.mark.parametrize("closed", [True, False], ids=["closed", "open"])
def test_kernel_and_twin_agree_on_random_contours(closed: bool, matched: bool) -> None:
    rng = np.random.default_rng(7)
    for seed, count in enumerate((12, 13, 24, 90, LONGEST - 1, LONGEST, LONGEST + 1, 2 * LONGEST + 3, 700)):
        for spacing in ("even", "1 % off", "30 % off"):
            shape = fourier_shape(seed)
            points = shape.at(shape.nodes(spacing, count, rng))
            sides = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
            is_curved = np.abs(np.log(sides / np.roll(sides, 1))).max() < np.log(STRAIGHT if closed else UNEVEN)
            if not is_curved:
                continue  # far longer sides are flat, and at free ends give way to the parabola
            table = contour_table([points], closed, None, None, None)
            net = fit_table(table, matched, True)[0].control_points
            np.testing.assert_allclose(net, bezier_net(points, closed, matched), rtol=0.0, atol=1e-12 * SIZE_MM)


def test_curvature_handles_are_taken_on_an_even_ellipse_and_not_on_an_uneven_one() -> None:
    shape, rng = known_shapes()[1], np.random.default_rng(7)
    for spacing, taken in (("even", 1.0), ("30 % off", 0.0)):
        points = shape.at(shape.nodes(spacing, 200, rng))
        speed, curvature = (bezier_net(points, True, matched) for matched in (False, True))
        assert np.any(speed != curvature, axis=1)[1::3].mean() == taken


def test_a_contour_is_fitted_alike_from_whichever_point_it_begins() -> None:
    shape, rng = fourier_shape(5), np.random.default_rng(7)
    points = shape.at(shape.nodes("even", 400, rng))
    nets = [
        fit_table(contour_table([np.roll(points, -turn, axis=0)], True, None, None, None), True, True)[0].control_points
        for turn in (0, 137)
    ]
    np.testing.assert_allclose(np.roll(nets[0][:-1], -3 * 137, axis=0), nets[1][:-1], rtol=0.0, atol=1e-10)
