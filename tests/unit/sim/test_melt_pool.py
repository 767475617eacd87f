"""The pool under a moving Gaussian source: the table against direct quadrature, and its limits against Rosenthal's closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from sim.process.moving_source import highest, melted, source_table, temperature

TABLE = source_table()


def by_quadrature(x: float, y: float, z: float, u: float) -> float:
    """The same temperature, integrated over phi = atan(sqrt(2 a t) / sigma) by an adaptive rule."""

    def passing(phi: float) -> float:
        tan = math.tan(phi)
        along = x + u * tan * tan
        return math.exp(-0.5 * (along * along + y * y) * math.cos(phi) ** 2 - 0.5 * z * z / max(tan * tan, 1e-300))

    at = math.atan(math.sqrt(max(-x, 1e-6) / u))  # where the source passed the place
    value, _ = quad(passing, 0.0, 0.5 * math.pi, points=[at], limit=400, epsabs=1e-10)
    return value / (math.pi * math.sqrt(2.0 * math.pi))


@pytest.mark.parametrize("u", [0.1, 0.7, 3.0])
@pytest.mark.parametrize(
    "place", [(0.0, 0.0, 0.0), (-1.0, 0.7, 0.0), (-4.0, 2.0, 0.0), (-2.0, 0.0, 1.5), (1.5, 1.0, 0.3)]
)
def test_the_temperature_is_the_integral_over_the_past_of_the_source(
    place: tuple[float, float, float], u: float
) -> None:
    assert temperature(*place, u) == pytest.approx(by_quadrature(*place, u), rel=1e-4, abs=1e-9)


@pytest.mark.parametrize(("strength", "u"), [(9.0, 0.15), (25.0, 0.4), (40.0, 0.8), (18.0, 1.7), (90.0, 2.5)])
def test_the_table_gives_the_width_and_depth_that_quadrature_gives(strength: float, u: float) -> None:
    def excess(y: float, z: float) -> float:
        hottest = minimize_scalar(
            lambda x: -by_quadrature(x, y, z, u), bounds=(-3.0 - (y * y + z * z) * u, 0.5), method="bounded"
        )
        return float(-hottest.fun * strength - 1.0)

    half, depth = melted(TABLE, strength, u)
    assert half == pytest.approx(brentq(lambda y: excess(y, 0.0), 0.0, 9.0), rel=0.01)
    assert depth == pytest.approx(brentq(lambda z: excess(0.0, z), 1e-3, 9.0), rel=0.01)


def test_a_source_at_rest_has_the_known_temperature_at_its_centre() -> None:
    assert temperature(0.0, 0.0, 0.0, 1e-7) == pytest.approx(1.0 / (2.0 * math.sqrt(2.0 * math.pi)), rel=1e-3)


@pytest.mark.parametrize("u", [0.03, 0.1, 0.3])
def test_far_larger_than_the_spot_the_pool_is_that_of_rosenthals_point_source(u: float) -> None:
    """Rosenthal 1946: T - T0 = q / (2 pi k R) exp(-v (R + x) / 2a); here lengths in sigma, v sigma / 2a = u, x positive ahead."""
    half = 8.0
    hottest = minimize_scalar(
        lambda x: -math.exp(-u * (math.hypot(x, half) + x)) / math.hypot(x, half), bounds=(-40.0, 0.0), method="bounded"
    )
    strength = 2.0 * math.pi / -hottest.fun
    width, depth = melted(TABLE, strength, u)
    assert width == pytest.approx(half, rel=0.03)
    assert depth == pytest.approx(half, rel=0.03)  # a point source melts a half round section


def test_nothing_is_molten_until_the_hottest_point_melts() -> None:
    needed = 1.0 / highest(0.0, 0.0, 0.5)
    assert melted(TABLE, 0.99 * needed, 0.5) == (0.0, 0.0)
    just, _ = melted(TABLE, 1.02 * needed, 0.5)
    more, _ = melted(TABLE, 1.10 * needed, 0.5)
    assert 0.0 < just < more < 1.0


def test_the_table_comes_out_the_same_each_time() -> None:
    source_table.cache_clear()
    again = source_table()
    assert all(np.array_equal(one, other) for one, other in zip(TABLE, again, strict=True))


def test_beyond_its_ends_the_table_holds_its_last_value() -> None:
    assert melted(TABLE, 30.0, 1e-6) == melted(TABLE, 30.0, 0.0)
    assert melted(TABLE, 1e9, 0.5)[0] == TABLE.reach[-1]
    assert melted(TABLE, 0.0, 0.5) == melted(TABLE, -1.0, 0.5) == (0.0, 0.0)
