"""The metal books of all layers as figures, and one line where they do not balance, with the reason."""

from __future__ import annotations

from collections.abc import Sequence

from planner.plan import Layer
from planner.process import Settings
from planner.toolpath.balance import LayerBalance, lit_beads

Books = dict[str, float]

MOST_OFF = 0.02
"""Of a layer's wanted metal: how much its beads may bring more or less."""
MOST_VOID = 0.1
"""Of a bead's width: the widest void."""
_AT_LIMIT = 0.25  # of a layer's bead length: so much at the end of the window is the reason for what is too much or too little
_NEAR = 1e-3


def books_figures(found: Sequence[LayerBalance]) -> Books | None:
    """The worst layers as data; None without books. Layers under a face that is milled, which get more on purpose, are apart."""
    if not found:
        return None
    plain = [layer for layer in found if not layer.is_top] or list(found)
    tops = [layer for layer in found if layer.is_top]
    worst = max(plain, key=lambda layer: abs(layer.ratio - 1.0))
    void = max(found, key=lambda layer: layer.void_beads)
    double = max(found, key=lambda layer: layer.double_share)
    figures: Books = {
        "layers": len(found),
        "ratio": round(worst.ratio, 4),
        "ratio_layer": worst.layer,
        "off_layers": sum(_is_off(layer) for layer in found),
        "void_beads": round(void.void_beads, 4),
        "void_layer": void.layer,
        "double_share": round(double.double_share, 4),
        "double_layer": double.layer,
    }
    if tops:
        most = max(tops, key=lambda layer: layer.ratio)
        figures |= {"top_ratio": round(most.ratio, 4), "top_ratio_layer": most.layer}
    return figures


def books_findings(found: Sequence[LayerBalance], layers: Sequence[Layer], settings: Settings) -> list[str]:
    """One line where layers are off balance or have voids: how many, the worst of either, why. layers : of which the books are."""
    off = [layer for layer in found if _is_off(layer)]
    void = [layer for layer in found if layer.void_beads > MOST_VOID]
    said = []
    if off:
        worst = max(off, key=lambda layer: abs(layer.ratio - 1.0))
        why = _why(worst, [layer for layer in layers if layer.index == worst.layer], settings)
        said.append(
            f"{_count(off)} more than {100 * MOST_OFF:.0f} % more or less metal than wanted, at worst {worst.ratio:.3f} times "
            f"(layer {worst.layer}: {worst.deposited_mm2:.1f} for {worst.region_mm2:.1f} mm²; {why})"
        )
    if void:
        worst = max(void, key=lambda layer: layer.void_beads)
        said.append(
            f"{_count(void)} voids wider than {MOST_VOID:g} bead, at worst {worst.void_mm:.2f} mm, {worst.void_beads:.2f} bead "
            f"(layer {worst.layer})"
        )
    return [f"balance of metal: {'; '.join(said)}"] if said else []


def _is_off(layer: LayerBalance) -> bool:
    """Whether a layer's metal is off balance, other than on purpose."""
    return (abs(layer.ratio - 1.0) > MOST_OFF and not layer.is_top) or layer.ratio < 1.0 - MOST_OFF


def _count(layers: list[LayerBalance]) -> str:
    return "1 layer has" if len(layers) == 1 else f"{len(layers)} layers have"


def _why(books: LayerBalance, layers: list[Layer], settings: Settings) -> str:
    """What keeps a layer's beads from bringing just the metal."""
    recipe, facts, law = settings.recipe, settings.material.deposition, settings.material.bead
    if recipe.speed_mm_s is not None and recipe.powder_g_min is not None:
        return "the recipe fixes speed and powder"
    passes = [step for layer in layers for operation in layer.operations if operation.process.is_deposit for step in operation.passes]
    per_speed = law.catch_efficiency / 60.0 / settings.material.density_g_mm3
    fastest, slowest = recipe.speed_mm_s or facts.speed_mm_s.max, recipe.speed_mm_s or facts.speed_mm_s.min
    least = per_speed * (recipe.powder_g_min or facts.powder_g_min.min) / fastest
    most = per_speed * (recipe.powder_g_min or facts.powder_g_min.max) / slowest
    beads = lit_beads(passes, settings)
    lit = sum(bead.length_mm for bead in beads)
    if books.ratio > 1.0:
        if sum(bead.length_mm for bead in beads if bead.area_mm2 <= least * (1.0 + _NEAR)) >= _AT_LIMIT * lit:
            return "beads there are the smallest of the material's window"
        return "short and closed beads overlap at their ends"
    if sum(bead.length_mm for bead in beads if bead.area_mm2 >= most * (1.0 - _NEAR)) >= _AT_LIMIT * lit:
        return "beads there are the largest of the material's window"
    return "places too narrow for a bead stay open"
