"""Ruled walls from outlines alone, against cones and cylinders."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.slicing.even_walls import Lift, even_walls

Floats = NDArray[np.float64]


def _circle(radius_mm: float, corners: int, turn: float = 0.0) -> MultiPolygon:
    """A polygon round a circle."""
    angle = turn + 2.0 * np.pi * np.arange(corners) / corners
    return MultiPolygon([shapely.Polygon(radius_mm * np.column_stack([np.cos(angle), np.sin(angle)]))])


def _level(z: float) -> Lift:
    return lambda xy: np.full(len(xy), z)


@pytest.mark.parametrize("flare_mm", [0.0, 0.3, -0.3])
def test_outlines_whose_corners_do_not_face_each_other_give_the_cone_they_stand_for(flare_mm: float) -> None:
    areas = (_circle(5.0, 97), _circle(5.0 + 0.5 * flare_mm, 113, 0.01), _circle(5.0 + flare_mm, 131, 0.02))
    (wall,) = even_walls(areas, (_level(0.0), _level(0.7)))
    u = np.linspace(0.0, 1.0, 400)
    low, high = wall.bottom.evaluate(u), wall.top.evaluate(u)
    assert np.abs(np.linalg.norm(low[:, :2], axis=1) - 5.0).max() < 5e-3
    assert np.abs(np.linalg.norm(high[:, :2], axis=1) - 5.0 - flare_mm).max() < 5e-3
    ruling = high - low
    sideways = (low[:, 0] * ruling[:, 1] - low[:, 1] * ruling[:, 0]) / np.linalg.norm(low[:, :2], axis=1)
    assert np.abs(sideways / ruling[:, 2]).max() < 0.02  # rulings run straight up the cone
    assert shapely.LinearRing(low[:, :2]).is_ccw


def test_a_leaning_top_is_met_where_it_lies() -> None:
    circle = _circle(5.0, 200)
    (wall,) = even_walls((circle, circle, circle), (_level(0.0), lambda xy: 1.0 + 0.1 * xy[:, 0]))
    top = wall.top.evaluate(np.linspace(0.0, 1.0, 100))
    assert np.abs(top[:, 2] - 1.0 - 0.1 * top[:, 0]).max() < 1e-3


def test_outlines_that_part_give_no_walls() -> None:
    apart = MultiPolygon([shapely.box(-3.0, -1.0, -1.0, 1.0), shapely.box(1.0, -1.0, 3.0, 1.0)])
    whole = MultiPolygon([shapely.box(-3.0, -1.0, 3.0, 1.0)])
    assert even_walls((whole, apart, apart), (_level(0.0), _level(1.0))) == ()
