"""How thick a layer may be where the surface bends in a circle: closed forms for extruded and ruled walls."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.errors import RecipeError

Floats = NDArray[np.float64]
LayerRule = Literal["facet", "extruded", "ruled"]
ToleranceSide = Literal["both", "outside", "inside"]

RULES: dict[str, int] = {"facet": 0, "extruded": 1, "ruled": 2}
SIDES: dict[str, int] = {"both": 0, "outside": 1, "inside": -1}


def allowed_thickness(
    sigma: ArrayLike,
    rho_mm: ArrayLike,
    convex: ArrayLike,
    delta_mm: ArrayLike,
    rule: LayerRule = "extruded",
    side: ToleranceSide = "both",
) -> Floats:
    """Greatest distance, mm, along the build direction b from a point of the surface to the top of its layer.

    sigma : n·b with its sign, n the outward normal at the layer's bottom plane      rho_mm : radius of curvature, mm,
    in the plane of b and n (inf: flat)      convex : bool, body inside the circle      delta_mm : allowed cusp δ, mm
    (all broadcast)
    rule "facet": flat, d = δ/|n·b| (paper Eq. 14);  "extruded": walls along b (paper Eqs. 15-18);  "ruled": straight
    lines from the bottom to the top section (paper Eq. 20)
    side: where the wall may lie: "outside" never inside the body (positive tolerance), "inside" never outside of it, "both"
    keeps δ whichever of the two sections is extruded. A ruled wall is a chord: side moves it along n, its thickness stays.

    With τ = +1 where the surface comes nearer to level upwards (else -1) and e = ±1 by side:
    extruded d = τ[-ρσ + √(ρ²σ² + 2τρδ + eδ²)], both √(ρ²σ² + τ(2ρδ - δ²)); ruled d = ρ[sin(min(ψ + 2φ, 90°)) - sin ψ],
    ψ = τ arcsin σ, φ = arccos(1 - δ/ρ). Never beyond the pole, ρ(1 - σ), nor beyond the equator, ρσ, of the circle.
    A level surface allows inf in a flat (its cusp is in no wall), a layer up to the pole 0.
    Raises RecipeError for an unknown rule or side.
    """
    if rule not in RULES or side not in SIDES:
        raise RecipeError(f"layer rule {rule!r} with tolerance side {side!r}", f"choose of {[*RULES]} and {[*SIDES]}")
    slope, radius, bulges, delta = np.broadcast_arrays(
        np.asarray(sigma, dtype=np.float64), np.asarray(rho_mm, dtype=np.float64), np.asarray(convex, dtype=bool),
        np.asarray(delta_mm, dtype=np.float64),
    )  # fmt: skip
    found = _many(slope.ravel(), radius.ravel(), bulges.ravel(), delta.ravel(), RULES[rule], SIDES[side])
    return np.asarray(found.reshape(slope.shape))


@njit(cache=True)
def _many(
    sigma: Floats, rho: Floats, convex: NDArray[np.bool_], delta: Floats, rule: int, side: int
) -> Floats:  # pragma: no cover
    found = np.empty(sigma.shape[0])
    for i in range(sigma.shape[0]):
        found[i] = circle_thickness(sigma[i], rho[i], convex[i], delta[i], rule, side)
    return found


@njit(cache=True)
def circle_thickness(
    sigma: float, rho: float, convex: bool, delta: float, rule: int, side: int
) -> float:  # pragma: no cover
    """One case of `allowed_thickness`; rule and side by their numbers in RULES and SIDES."""
    steep = min(abs(sigma), 1.0)
    flat = np.inf if steep == 0.0 else delta / steep
    if rule == 0:
        return flat
    if rho > 1e9 * delta:  # the sagitta of a flat allows anything to a chord
        return flat if rule == 1 else np.inf
    towards_pole = (sigma >= 0.0) == convex or sigma == 0.0
    if rule == 2:
        start = math.asin(steep) if towards_pole else -math.asin(steep)
        turn = 2.0 * math.acos(max(1.0 - delta / rho, -1.0))
        return rho * (math.sin(min(start + turn, 0.5 * math.pi)) - math.sin(start))
    e = 0.0
    if side != 0:
        upper = sigma > 0.0 or (sigma == 0.0 and convex)
        e = float(side) if upper else -float(side)
    sign = 1.0 if towards_pole else -1.0
    extra = 2.0 * sign * rho * delta + (e * delta * delta if side != 0 else -sign * delta * delta)
    cap = rho * (1.0 - steep) if towards_pole else rho * steep
    below_root = rho * rho * steep * steep + extra
    if below_root < 0.0:
        return cap
    root = math.sqrt(below_root)
    if rho * steep + root == 0.0:
        return 0.0
    return max(min(sign * extra / (rho * steep + root), cap), 0.0)
