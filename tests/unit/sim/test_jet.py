"""The powder jet against a direct sum over the Gaussian."""

from __future__ import annotations

import numpy as np
import pytest

from sim.process.jet import jet_radius_mm, share_in_pool


def test_the_share_in_a_round_pool_is_the_gaussian_summed_over_it() -> None:
    x, y = np.meshgrid(*[np.linspace(-6.0, 6.0, 1201)] * 2)
    radius, half = 1.1, 1.3
    flux = np.exp(-2.0 * (x * x + y * y) / radius**2)
    assert share_in_pool(2.0 * half, radius, 1.0) == pytest.approx(
        flux[np.hypot(x, y) <= half].sum() / flux.sum(), rel=2e-3
    )


def test_a_tilted_pool_catches_nearly_what_its_ellipse_does() -> None:
    x, y = np.meshgrid(*[np.linspace(-6.0, 6.0, 1201)] * 2)
    radius, half, cosine = 1.0, 1.3, np.cos(np.radians(40.0))
    flux = np.exp(-2.0 * (x * x + y * y) / radius**2)
    inside = np.hypot(x, y / cosine) <= half
    assert share_in_pool(2.0 * half, radius, float(cosine)) == pytest.approx(flux[inside].sum() / flux.sum(), rel=0.03)


def test_off_focus_and_off_axis_less_is_caught() -> None:
    def caught(defocus: float, cosine: float) -> float:
        return share_in_pool(2.6, jet_radius_mm(0.8, 0.3, defocus), cosine)

    off_focus = [caught(d, 1.0) for d in (0.0, 1.0, 2.0, 5.0, 20.0)]
    off_axis = [caught(0.0, c) for c in (1.0, 0.8, 0.5, 0.1, 0.0, -0.5)]
    assert off_focus == sorted(off_focus, reverse=True) and off_focus[0] > 0.9 and off_focus[-1] < 0.1
    assert off_axis == sorted(off_axis, reverse=True) and off_axis[-2:] == [0.0, 0.0]
    assert caught(-2.0, 1.0) == caught(2.0, 1.0)


def test_far_from_its_focus_the_jet_is_a_cone() -> None:
    assert jet_radius_mm(0.8, 0.25, 400.0) == pytest.approx(100.0, rel=1e-4)
    assert jet_radius_mm(0.8, 0.25, 0.0) == pytest.approx(0.8)
