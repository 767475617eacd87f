"""The deposition of one layer that turns: beads that follow its height, or uniform beads, some of them on its thick side only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.errors import PlanningError, RecipeError
from planner.nurbs.offset import outset
from planner.plan import Operation
from planner.process import Bead, Settings
from planner.slicing.turning import TurnedLayer
from planner.toolpath.deposit import Dropped, deposit_operations, grown_region, outside_mm
from planner.toolpath.relief import Relief
from planner.toolpath.tops import TOP_RESERVE

Floats = NDArray[np.float64]

_TOO_HIGH = 1.05  # of the bead that is wanted: a higher one counts as outside the window
_MOST_BEADS = 12  # upon each other in one layer
_FILLS = 1e-6  # relative


@dataclass(frozen=True)
class Laid:
    """A layer's deposition.

    operations : layer frame, without links   bead : its thickest, the one that width and allowance are reckoned with
    excess_mm : greatest height of the metal over the layer's top plane, overbuild included
    crest_mm : how much higher than that a single track may be   volume_mm3 : nominal
    is_uniform : made of uniform beads, to be faced down to the plane
    """

    operations: tuple[Operation, ...]
    dropped: tuple[Dropped, ...]
    bead: Bead
    excess_mm: float
    crest_mm: float
    volume_mm3: float
    is_uniform: bool


def laid(layer: TurnedLayer, is_top: bool, settings: Settings) -> Laid:
    """How a layer is deposited: by beads whose height follows the layer where the window has them, else by uniform ones.

    is_top : part of its top is a finished face.
    Raises RecipeError where no bead fills the layer, or where only milling could bring one down (process = deposit).
    """
    settings = settings.placed(layer.build_from_layer)
    bead = _following_bead(layer, is_top, settings)
    if bead is not None:
        return _following(layer, bead, is_top, settings)
    if not settings.is_milled:
        least, most = layer.thickness_mm
        raise RecipeError(
            f"layer {layer.region.index}: {least:.3g} to {most:.3g} mm thick, but the window of {settings.material.name} has no "
            "beads that low and that high at once, and process = deposit mills nothing down",
            "leave speed and powder open, choose a sharper division, or process = hybrid",
        )
    return _uniform(layer, is_top, settings)


def _following_bead(layer: TurnedLayer, is_top: bool, settings: Settings) -> Bead | None:
    """The bead for a layer's greatest height, if the window has those for all heights at which beads of it lie.

    Beads lie outside the layer's region too, where allowance and edge are.
    """
    try:
        bead = settings.bead_for(layer.region.height_mm, TOP_RESERVE if is_top else 0.0)
    except RecipeError:
        return None
    relief = Relief.of(layer.region, bead, settings, layer.height_at)
    shares = relief.shares(shapely.get_coordinates(grown_region(layer.region, bead, settings)))
    for share in (float(shares.min()), float(shares.max())):
        if share <= 0.0:
            return None
        try:
            made = settings.with_area(bead, share * bead.area_mm2)
        except RecipeError:
            return None
        if made.area_mm2 > share * bead.area_mm2 * _TOO_HIGH:
            return None
    return bead


def _following(layer: TurnedLayer, bead: Bead, is_top: bool, settings: Settings) -> Laid:
    """Beads whose height follows the layer's along each pass, by speed and powder."""
    region = layer.region
    operations, dropped = deposit_operations(region, bead, settings, is_top, height_at=layer.height_at)
    relief = Relief.of(region, bead, settings, layer.height_at)
    filled = outset(region.region, settings.allowance_mm) if settings.allowance_mm > 0.0 else region.region
    middle = shapely.centroid(filled)
    share = float(
        relief.shares(np.array([[middle.x, middle.y]]))[0]
    )  # height is linear: its mean is that at the centroid
    excess = max(bead.height_mm - region.height_mm, 0.0)
    crest = max(bead.crest_mm - bead.height_mm, 0.0)
    volume = float(filled.area) * share * bead.height_mm
    return Laid(tuple(operations), tuple(dropped), bead, excess, crest, volume, False)


def _uniform(layer: TurnedLayer, is_top: bool, settings: Settings) -> Laid:
    """Uniform beads: the first ones all over the layer, as high as its thin side; then partial ones over what is thicker.

    What stands above the top plane afterwards is milled off.   Source: paper Fig. 6.
    """
    region = layer.region
    reserve = TOP_RESERVE * region.height_mm if is_top else 0.0
    over = 1.0 + settings.overbuild
    made, volume = 0.0, 0.0
    operations: list[Operation] = []
    dropped: list[Dropped] = []
    widest: Bead | None = None
    excess = 0.0
    for number in range(_MOST_BEADS):
        area = _higher_than(layer, (made - reserve) / over, settings) if number else region.region
        if area.is_empty:
            break
        corners = shapely.get_coordinates(_with_edge(area, widest, settings))
        lowest, highest = (
            float(edge) for edge in np.array([layer.height_at(corners).min(), layer.height_at(corners).max()])
        )
        wanted = lowest if not number else highest + (reserve - made) / over
        bead = _nearest_bead(wanted, settings)
        part = replace(region, z_bottom=made, z_top=made + bead.height_mm, region=area)
        more, gone = deposit_operations(part, bead, settings, is_top)
        operations += more
        dropped += gone
        made += bead.height_mm
        volume += float(outset(area, settings.allowance_mm).area) * bead.height_mm
        excess = max(excess, made - lowest)
        widest = bead if widest is None or bead.width_mm > widest.width_mm else widest
    else:
        raise PlanningError(
            f"layer {region.index}: more than {_MOST_BEADS} uniform beads upon each other would be needed",
            "leave speed and powder open, or set axis_layers = never",
        )
    assert widest is not None
    crest = max(widest.crest_mm - widest.height_mm, 0.0)
    return Laid(tuple(operations), tuple(dropped), widest, excess, crest, volume, True)


def _nearest_bead(height_mm: float, settings: Settings) -> Bead:
    """The bead of a uniform layer so high, or the window's highest where it has none."""
    bounds = settings.material.deposition.layer_height_mm
    asked = min(max(height_mm, bounds.min), bounds.max)
    try:
        return settings.bead_for(asked)
    except RecipeError:
        return settings.bead_for(bounds.min)


def _with_edge(area: MultiPolygon, bead: Bead | None, settings: Settings) -> MultiPolygon:
    """An area and what beads cover beside it."""
    growth = settings.allowance_mm if bead is None else outside_mm(bead, settings)
    return outset(area, growth) if growth > 0.0 else area


def _higher_than(layer: TurnedLayer, height_mm: float, settings: Settings) -> MultiPolygon:
    """Where a layer, its allowance included, is higher than so much; within its region, mm."""
    region = layer.region.region
    grown = _with_edge(region, None, settings)
    low_x, low_y, high_x, high_y = grown.buffer(1.0).bounds
    corners = np.array([[low_x, low_y], [high_x, low_y], [high_x, high_y], [low_x, high_y]])
    above = layer.height_at(corners) - height_mm * (1.0 + _FILLS)
    outline: list[Floats] = []
    for k in range(4):
        this, after = above[k], above[(k + 1) % 4]
        if this > 0.0:
            outline.append(corners[k])
        if (this > 0.0) != (after > 0.0):
            outline.append(corners[k] + this / (this - after) * (corners[(k + 1) % 4] - corners[k]))
    if len(outline) < 3:
        return MultiPolygon()
    half = Polygon(outline).buffer(settings.allowance_mm, join_style="mitre")
    cut = shapely.intersection(region, half)
    return MultiPolygon([part for part in shapely.get_parts(cut) if part.geom_type == "Polygon" and part.area > 0.0])
