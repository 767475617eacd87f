"""Matching under random outlines: the rulings of any leaning cylinder run along it, those of any cone meet in its apex."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.planner.matching_shapes import Floats, loft, walls_between

U = np.linspace(0.0, 1.0, 301)
shares = st.floats(-0.06, 0.06)


def outline(waves: tuple[float, float, float]) -> Floats:
    """(120, 2): a smooth closed curve around the origin, bulging and denting by three waves."""
    angle = 2.0 * np.pi * np.arange(120) / 120
    radius = 10.0 * (1.0 + sum(wave * np.cos((k + 2) * angle + k) for k, wave in enumerate(waves)))
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


@settings(max_examples=12, deadline=None)
@given(st.tuples(shares, shares, shares), st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
def test_the_rulings_of_a_leaning_cylinder_run_along_it(
    waves: tuple[float, float, float], lean_x: float, lean_y: float
) -> None:
    base = outline(waves)
    body = loft(lambda z: base + z * np.array([lean_x, lean_y]), np.array([0.0, 6.0]))
    walls = walls_between(body, 1.0, 5.0)
    assert not walls.notes
    along = np.array([lean_x, lean_y, 1.0]) / np.sqrt(lean_x**2 + lean_y**2 + 1.0)
    assert (walls.walls[0].surface.rulings(U) @ along).min() > np.cos(0.02)


@settings(max_examples=12, deadline=None)
@given(st.tuples(shares, shares, shares), st.floats(20.0, 60.0))
def test_the_rulings_of_a_cone_over_any_outline_meet_in_its_apex(waves: tuple[float, float, float], apex: float) -> None:
    base = outline(waves)
    body = loft(lambda z: base * (1.0 - z / apex), np.array([0.0, 0.5 * apex]))
    walls = walls_between(body, 0.1 * apex, 0.4 * apex)
    assert not walls.notes
    surface = walls.walls[0].surface
    away = np.array([0.0, 0.0, apex]) - surface.curve0.evaluate(U)
    assert np.linalg.norm(np.cross(away, surface.rulings(U)), axis=1).max() < 0.3
