"""The closed forms for a layer's thickness against circles measured point by point."""

from __future__ import annotations

import numpy as np
import pytest

from planner.errors import RecipeError
from planner.slicing.thickness import allowed_thickness

CASES = 100_000


def random_circles(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Signed slope n·b at the bottom plane, radius, whether convex, allowed cusp."""
    draw = np.random.default_rng(seed)
    rho = np.exp(draw.uniform(np.log(0.5), np.log(500.0), CASES))
    return draw.uniform(-1.0, 1.0, CASES), rho, draw.random(CASES) < 0.5, rho * np.exp(draw.uniform(-9.0, -1.5, CASES))


def bottom_and_top(
    sigma: np.ndarray, rho: np.ndarray, convex: np.ndarray, thickness: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Half-widths and heights, from the circle's centre, of the surface at both planes of a layer."""
    low = np.where(convex, rho * sigma, -rho * sigma)
    high = np.clip(low + thickness, -rho, rho)
    return np.sqrt(np.maximum(rho**2 - low**2, 0.0)), low, np.sqrt(np.maximum(rho**2 - high**2, 0.0)), high


def corner_error(rho: np.ndarray, width: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Distance outward of the circle of a wall's corner."""
    return np.asarray(np.hypot(width, height) - rho)


@pytest.mark.parametrize("side", ["outside", "inside"])
def test_an_extruded_wall_uses_its_cusp_up_unless_pole_or_equator_end_it(side: str) -> None:
    sigma, rho, convex, delta = random_circles(1)
    thickness = allowed_thickness(sigma, rho, convex, delta, "extruded", side)  # type: ignore[arg-type]
    wide_low, low, wide_high, high = bottom_and_top(sigma, rho, convex, thickness)
    away_low, away_high = corner_error(rho, wide_high, low), corner_error(rho, wide_low, high)
    wanted_out = (side == "outside") == convex  # whether the wall lies on the circle's outer side
    error = np.where(wanted_out, np.maximum(away_low, away_high), np.maximum(-away_low, -away_high))
    assert (error <= delta * (1.0 + 1e-9)).all()
    towards_pole = (sigma >= 0.0) == convex
    end = np.where(towards_pole, rho * (1.0 - np.abs(sigma)), rho * np.abs(sigma))
    free = thickness < end * (1.0 - 1e-9)
    assert free.mean() > 0.2
    np.testing.assert_allclose(error[free], delta[free], rtol=1e-6)


def test_an_extruded_wall_for_both_sides_keeps_the_cusp_on_both() -> None:
    sigma, rho, convex, delta = random_circles(2)
    thickness = allowed_thickness(sigma, rho, convex, delta, "extruded", "both")
    wide_low, low, wide_high, high = bottom_and_top(sigma, rho, convex, thickness)
    error = np.maximum(np.abs(corner_error(rho, wide_high, low)), np.abs(corner_error(rho, wide_low, high)))
    assert (error <= delta * (1.0 + 1e-9)).all()


def test_a_ruled_wall_is_a_chord_whose_sagitta_is_the_cusp() -> None:
    sigma, rho, convex, delta = random_circles(3)
    thickness = allowed_thickness(sigma, rho, convex, delta, "ruled")
    wide_low, low, wide_high, high = bottom_and_top(sigma, rho, convex, thickness)
    sagitta = rho - np.hypot(0.5 * (wide_low + wide_high), 0.5 * (low + high))
    assert (sagitta <= delta * (1.0 + 1e-6)).all()
    free = high < rho * (1.0 - 1e-9)
    np.testing.assert_allclose(sagitta[free], delta[free], rtol=1e-5)


def test_a_flat_facet_allows_its_cusp_over_its_slope() -> None:
    for rule in ("facet", "extruded"):
        found = allowed_thickness([0.5, -0.5, 1.0, 0.0], np.inf, True, 0.04, rule)
        np.testing.assert_allclose(found, [0.08, 0.08, 0.04, np.inf])
    assert allowed_thickness(0.5, np.inf, True, 0.04, "ruled") == np.inf


@pytest.mark.parametrize(("rho", "delta", "extruded", "ruled"), [(23.0, 0.04, 576, 27), (20.0, 0.08, 252, 18)])
def test_layers_of_an_exact_sphere_count_as_published(rho: float, delta: float, extruded: int, ruled: int) -> None:
    for rule, side, count in (("extruded", "both", extruded), ("ruled", "both", ruled)):
        z, layers = -rho, 0
        while z < rho * (1.0 - 1e-9):
            z += float(allowed_thickness(z / rho, rho, True, delta, rule, side))  # type: ignore[arg-type]
            layers += 1
        assert abs(layers - count) <= 2


def test_an_unknown_rule_or_side_is_refused() -> None:
    with pytest.raises(RecipeError, match="layer rule 'thick'"):
        allowed_thickness(0.5, 1.0, True, 0.1, "thick")  # type: ignore[arg-type]
