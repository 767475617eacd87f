"""Which layers end in a finished top, and the bead that each layer is made with."""

from __future__ import annotations

import shapely
from shapely import MultiPolygon

from planner.errors import RecipeError
from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion

TOP_RESERVE = 0.35
"""Of the layer's height, deposited more where a top is finished: the valleys between tracks, which a next layer would
fill, must lie above the plane to which the top is faced."""
_TOP_SHARE = 0.02  # of a layer's top; smaller free rims belong to leaning walls


def finished_tops(regions: list[LayerRegion], settings: Settings) -> list[bool]:
    """Which layers have a top that is faced and stays: part of it carries nothing of the next layer."""
    lowers = [*(region.areas[0] for region in regions[1:]), MultiPolygon()]
    return [settings.is_milled and _has_top(region, above) for region, above in zip(regions, lowers, strict=True)]


def layer_beads(regions: list[LayerRegion], tops: list[bool], settings: Settings) -> list[Bead]:
    """The bead of each layer.  tops : which have a finished face.

    Raises RecipeError if no bead fills one, or if only milling could bring one down.
    """
    if settings.is_milled:
        return [
            settings.bead_for(region.height_mm, TOP_RESERVE if is_top else 0.0)
            for region, is_top in zip(regions, tops, strict=True)
        ]
    beads = [settings.bead_for(region.height_mm) for region in regions]
    for region, bead in zip(regions, beads, strict=True):
        most = region.height_mm * (1.0 + settings.overbuild) * 1.05
        if bead.height_mm > most:
            raise RecipeError(
                f"layer {region.index}: {region.height_mm:.3g} mm high, but the lowest bead of {settings.material.name} makes "
                f"{bead.height_mm:.3g} mm and process = deposit mills nothing down",
                "choose higher layers, less powder or process = hybrid",
            )
    return beads


def _has_top(region: LayerRegion, above: MultiPolygon) -> bool:
    """Whether part of a layer's top is a finished face: nothing of the next layer stands on it."""
    return bool(shapely.difference(region.areas[2], above).area > _TOP_SHARE * region.areas[2].area)
