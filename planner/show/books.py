"""The metal books of a plan in a line: the layer farthest from its balance, the widest void, the most that lies double."""

from __future__ import annotations

from typing import Any

from planner.errors import RecipeError
from planner.plan import Plan
from planner.process import Settings
from planner.recipe import parse_recipe
from planner.toolpath.balance import LayerBalance, plan_balance


def books(plan: Plan) -> list[LayerBalance]:
    """Of all layers that are equally high and laid upright; none where nothing is deposited or the material is not at hand."""
    if not any(operation.process.is_deposit for operation in plan.operations):
        return []
    try:
        settings = Settings.from_recipe(parse_recipe(plan.recipe_toml))
    except RecipeError:
        return []
    return plan_balance(plan, settings)


def books_figures(found: list[LayerBalance]) -> dict[str, Any] | None:
    """The worst layers as data; None without books. Layers under a face that is milled, which get more on purpose, are apart."""
    plain = [layer for layer in found if not layer.is_top]
    if not found:
        return None
    worst = max(plain or found, key=lambda layer: abs(layer.ratio - 1.0))
    void = max(found, key=lambda layer: layer.void_beads)
    double = max(found, key=lambda layer: layer.double_share)
    return {
        "layers": len(found),
        "ratio": round(worst.ratio, 4),
        "ratio_layer": worst.layer,
        "void_beads": round(void.void_beads, 4),
        "void_layer": void.layer,
        "double_share": round(double.double_share, 4),
        "double_layer": double.layer,
    }


def books_line(found: list[LayerBalance]) -> list[str]:
    """One line for the plan's text; none without books."""
    seen = books_figures(found)
    if seen is None:
        return []
    return [
        f"balance of {seen['layers']} level layers: deposited to wanted metal at worst {seen['ratio']:.3f} (layer {seen['ratio_layer']}), "
        f"widest void {seen['void_beads']:.2f} beads (layer {seen['void_layer']}), laid double at most {100 * seen['double_share']:.1f} % of "
        f"the beads (layer {seen['double_layer']})"
    ]
