"""Ruled walls: straight lines between curves, on a common basis."""

from __future__ import annotations

import numpy as np
import pytest

from planner.errors import FitError
from planner.nurbs.construct import circle, line
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.ruled import RuledSurface, on_common_basis


def ring(radius: float, z: float, count: int, lead: float = 0.0) -> Curve:
    t = lead + 2.0 * np.pi * np.arange(count) / count
    points = np.column_stack([radius * np.cos(t), radius * np.sin(t), np.full(count, z)])
    return interpolate(points, closed=True)


def test_common_basis_keeps_both_shapes() -> None:
    first, second = ring(10.0, 0.0, 30), circle((0.0, 0.0, 5.0), 8.0)
    one, other = on_common_basis(first, second)
    np.testing.assert_array_equal(one.knots, other.knots)
    assert one.degree == other.degree == 3
    u = np.linspace(0.0, 1.0, 999)
    np.testing.assert_allclose(one.evaluate(u), first.evaluate(u), atol=1e-12)
    np.testing.assert_allclose(other.evaluate(u), second.evaluate(u), atol=1e-12)


def test_wall_of_a_cone_is_developable_and_its_rulings_have_the_cones_slope() -> None:
    wall = RuledSurface(ring(10.0, 0.0, 60), ring(8.0, 4.0, 60))
    u = np.linspace(0.0, 1.0, 500)
    assert wall.twist(u).max() <= 1e-6
    directions = wall.rulings(u)
    np.testing.assert_allclose(directions[:, 2], 4.0 / np.hypot(4.0, 2.0), atol=1e-5)
    middle = wall.evaluate(u, 0.5)
    np.testing.assert_allclose(np.linalg.norm(middle[:, :2], axis=1), 9.0, atol=1e-4)
    np.testing.assert_allclose(np.einsum("ij,ij->i", wall.normals(u, 0.3), directions), 0.0, atol=1e-12)


def test_twisted_wall_reports_the_angle_by_which_it_twists() -> None:
    wall = RuledSurface(line((0, 0, 0), (10, 0, 0)), line((0, 0, 5), (10 * np.cos(0.3), 10 * np.sin(0.3), 5)))
    assert wall.twist([0.0])[0] == pytest.approx(0.3, abs=1e-9)


def test_directrices_that_meet_have_no_ruling_there() -> None:
    wall = RuledSurface(line((0, 0, 0), (1, 0, 0)), line((0, 0, 0), (1, 0, 1)))
    with pytest.raises(FitError, match="meet at u = 0"):
        wall.rulings([0.0, 0.5])
    with pytest.raises(FitError, match="in space"):
        RuledSurface(line((0, 0), (1, 0)), line((0, 1), (1, 1)))
