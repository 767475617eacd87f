"""A wall whose bottom stands still for a piece, because a speck of the top faces one point of it, can be followed."""

from __future__ import annotations

import numpy as np

from planner.nurbs.curve import Curve
from planner.plan import Wall
from planner.process import Settings
from planner.recipe import Recipe
from planner.toolpath.axis import ruled_motions

SPECK_MM = 2e-4


def ring(radius_mm: float, z: float, turns: np.ndarray) -> Curve:
    """A circle as straight pieces of degree 3 between angles that may repeat, rad."""
    ends = np.column_stack([radius_mm * np.cos(turns), radius_mm * np.sin(turns), np.full(len(turns), z)])
    third = np.diff(ends, axis=0) / 3.0
    net = np.stack([ends[:-1], ends[:-1] + third, ends[1:] - third], axis=1).reshape(-1, 3)
    breaks = np.linspace(0.0, 1.0, len(turns))
    return Curve(3, np.concatenate([[0.0], np.repeat(breaks, 3), [1.0]]), np.vstack([net, ends[-1:]]))


def test_a_flank_pass_along_a_wall_whose_bottom_stands_still_has_finite_tips_and_axes() -> None:
    even = np.linspace(0.0, 2.0 * np.pi, 97)
    low = np.insert(even, 40, even[40])
    high = np.insert(even, 40, even[40] - SPECK_MM / 19.0)
    wall = Wall(ring(20.0, 0.0, low), ring(19.0, 2.0, high))
    motions = ruled_motions(wall, 0.2, 0.0, None, Settings.from_recipe(Recipe()))
    assert motions
    for motion in motions:
        u = np.linspace(0.0, 1.0, 500)
        assert np.isfinite(motion.tip.evaluate(u)).all() and np.isfinite(motion.axis.evaluate(u)).all()


def test_a_bore_as_wide_as_the_cutter_gives_no_flank_pass_instead_of_one_that_stands_still() -> None:
    settings = Settings.from_recipe(Recipe())
    back = np.linspace(2.0 * np.pi, 0.0, 97)
    bore = Wall(ring(settings.cutter_radius_mm, 0.0, back), ring(settings.cutter_radius_mm, 2.0, back))
    assert ruled_motions(bore, 0.0, 0.0, None, settings) == []
