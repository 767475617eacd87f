"""The metal books of a plan in a line: the layer farthest from its balance, the widest void, the most that lies double."""

from __future__ import annotations

from planner.errors import RecipeError
from planner.plan import Plan
from planner.process import Settings
from planner.recipe import parse_recipe
from planner.toolpath.balance import LayerBalance, plan_balance
from planner.toolpath.books import books_figures

__all__ = ["books", "books_figures", "books_line"]


def books(plan: Plan) -> list[LayerBalance]:
    """Of all layers that are equally high and laid upright; none where nothing is deposited or the material is not at hand."""
    if not any(operation.process.is_deposit for operation in plan.operations):
        return []
    try:
        settings = Settings.from_recipe(parse_recipe(plan.recipe_toml))
    except RecipeError:
        return []
    return plan_balance(plan, settings)


def books_line(plan: Plan) -> list[str]:
    """One line for the plan's text, of the books that were kept when it was made; none without books."""
    seen = plan.books
    if not seen:
        return []
    top = ""
    if "top_ratio" in seen:
        top = f", under milled faces up to {seen['top_ratio']:.3f} (layer {seen['top_ratio_layer']:.0f})"
    return [
        f"balance of {seen['layers']:.0f} level layers: deposited to wanted metal at worst {seen['ratio']:.3f} "
        f"(layer {seen['ratio_layer']:.0f}){top}; widest void {seen['void_beads']:.2f} bead (layer {seen['void_layer']:.0f}); laid double "
        f"at most {100 * seen['double_share']:.1f} % of the beads (layer {seen['double_layer']:.0f})"
    ]
