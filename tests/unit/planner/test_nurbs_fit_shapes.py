"""Curvature handles against equal speed over a wide family of shapes, spacings and noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.nurbs.fit import fit_table
from planner.nurbs.segments import contour_table
from tests.unit.planner.fit_shapes import NOISES_MM, SPACINGS, Shape, fourier_shape, known_shapes

Floats = NDArray[np.float64]
NOTHING_MM = 1e-12  # rounding of coordinates of some 10 mm
SAME = 1.0 + 1e-9


def errors(shape: Shape, nodes: Floats, points: Floats) -> tuple[float, float]:
    """Largest distance from the shape with equal speed and with curvature handles, mm."""
    table = contour_table([points], shape.closed, None, None, None)
    nets = [fit_table(table, matched, True)[0].control_points for matched in (False, True)]
    speed, curvature = (float(shape.distances(nodes, net).max()) for net in nets)
    return speed, curvature


def ratio(shape: Shape, spacing: str, count: int, noise_mm: float, rng: np.random.Generator) -> float:
    """Error of curvature handles over that of equal speed."""
    nodes = shape.nodes(spacing, count, rng)
    exact = shape.at(nodes)
    if np.linalg.norm(np.diff(exact, axis=0), axis=1).min() < max(20.0 * noise_mm, 1e-6):
        return 1.0
    speed, curvature = errors(shape, nodes, exact + noise_mm * rng.normal(size=exact.shape))
    return curvature / max(speed, NOTHING_MM)


@pytest.mark.parametrize("shape", known_shapes(), ids=lambda shape: shape.name)
def test_curvature_handles_are_never_worse_than_equal_speed(shape: Shape) -> None:
    rng = np.random.default_rng(11)
    for spacing in SPACINGS:
        for count, noise_mm in ((20, 0.0), (50, 1e-6), (100, 0.0), (100, 1e-5), (200, 1e-4)):
            found = ratio(shape, spacing, count, noise_mm, rng)
            assert found <= SAME, f"{spacing}, {count} points, noise {noise_mm} mm: {found:.3f} times"


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    spacing=st.sampled_from(SPACINGS),
    count=st.integers(24, 1000),
    noise_mm=st.sampled_from(NOISES_MM),
)
def test_curvature_handles_are_never_worse_on_random_curves(
    seed: int, spacing: str, count: int, noise_mm: float
) -> None:
    assert ratio(fourier_shape(seed), spacing, count, noise_mm, np.random.default_rng(seed)) <= SAME


@pytest.mark.parametrize(("a", "b"), [(23.0, 23.0), (30.0, 20.0), (30.0, 10.0)])
def test_curvature_handles_are_of_sixth_order_and_equal_speed_of_fourth(a: float, b: float) -> None:
    shape = Shape("ellipse", lambda t: np.stack([a * np.cos(t), b * np.sin(t)], -1), True, 0.0, 2.0 * np.pi)
    rng = np.random.default_rng(0)
    coarse, fine = (
        errors(shape, nodes, shape.at(nodes)) for nodes in (shape.nodes("even", n, rng) for n in (100, 200))
    )
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(4.0, abs=0.2)
    assert np.log2(coarse[1] / fine[1]) == pytest.approx(6.0, abs=0.4)
    assert coarse[1] <= 0.06 * coarse[0]
