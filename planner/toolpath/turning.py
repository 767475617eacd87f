"""What is done to layers that turn with the part, each in its own frame: deposited, faced, milled in ruled bands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.errors import PlanningError, RecipeError
from planner.mesh.mesh import Mesh
from planner.nurbs.offset import outset
from planner.plan import Operation
from planner.process import Bead, Settings
from planner.slicing.turning import TurnedLayer
from planner.toolpath.deposit import THINNEST, Dropped, deposit_operations, dropped_findings
from planner.toolpath.placed import in_build
from planner.toolpath.relief import Relief
from planner.toolpath.tops import TOP_RESERVE

__all__ = ["TurnedWork", "in_build", "turned_operations"]

Floats = NDArray[np.float64]

_TOP_SHARE = 0.02  # of a layer's top; smaller free rims belong to leaning walls
_TOO_HIGH = 1.05  # of the bead that is wanted: a higher one brings metal that deposition alone does not take off


@dataclass(frozen=True)
class TurnedWork:
    """What is done when a layer's turn comes.

    operations : in order, in the layer's frame, without links; a band's milling comes with its last layer
    metal_top_mm : highest metal of the piece above the layer's bottom plane until they are done, layer frame
    deposited_mm3 : nominal   findings : one line each; those of the whole piece come with its last layer
    """

    layer: TurnedLayer
    operations: tuple[Operation, ...]
    metal_top_mm: float
    deposited_mm3: float
    findings: tuple[str, ...] = ()


@dataclass
class _State:
    """The piece while it grows.  above_mm : metal over the nominal top since the last facing."""

    settings: Settings
    above_mm: float = 0.0
    deposited_mm3: float = 0.0
    dropped: list[Dropped] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)


def turned_operations(mesh: Mesh, layers: Sequence[TurnedLayer], settings: Settings) -> Iterator[TurnedWork]:
    """The work on each layer of a piece that turns, in order, each when it is asked for.

    mesh : the piece that the layers were cut from   layers : all of them, from `turned_layers`.
    Raises RecipeError where no bead fills a layer, PlanningError if none fits anywhere.
    """
    state = _State(settings)
    tops = _finished_tops(layers, settings)
    is_made = False
    for number, (layer, is_top) in enumerate(zip(layers, tops, strict=True)):
        bead = _bead(layer, is_top, settings)
        before = state.deposited_mm3
        operations = _deposited(layer, bead, is_top, state)
        is_made = is_made or bool(operations)
        top = layer.region.z_top + state.above_mm + max(bead.crest_mm - bead.height_mm, 0.0)
        findings: tuple[str, ...] = ()
        if number == len(layers) - 1:
            if not is_made:
                _refuse_thin(bead)
            findings = (*state.findings, *dropped_findings(state.dropped))
        yield TurnedWork(layer, tuple(operations), top, state.deposited_mm3 - before, findings)


def _finished_tops(layers: Sequence[TurnedLayer], settings: Settings) -> list[bool]:
    """Which layers have a top that is faced and stays: part of it carries nothing of the next layer."""
    found = []
    for number, layer in enumerate(layers):
        if not settings.is_milled:
            found.append(False)
        elif number == len(layers) - 1:
            found.append(not layer.region.areas[2].is_empty)
        else:
            section, above = layer.region.top, layers[number + 1].region.bottom
            top, lower = section.area_mm2, above.area_mm2
            found.append(top > 0.0 and top - lower > _TOP_SHARE * top)
    return found


def _bead(layer: TurnedLayer, is_top: bool, settings: Settings) -> Bead:
    """The bead for a layer's greatest height.

    Raises RecipeError if no bead fills it, or if only milling could bring one down.
    """
    height = layer.region.height_mm
    bead = settings.bead_for(height, TOP_RESERVE if is_top else 0.0)
    if not settings.is_milled and bead.height_mm > height * (1.0 + settings.overbuild) * _TOO_HIGH:
        raise RecipeError(
            f"layer {layer.region.index}: {height:.3g} mm high at most, but the lowest bead of {settings.material.name} makes "
            f"{bead.height_mm:.3g} mm and process = deposit mills nothing down",
            "choose higher layers, less powder or process = hybrid",
        )
    return bead


def _deposited(layer: TurnedLayer, bead: Bead, is_top: bool, state: _State) -> list[Operation]:
    """A layer's deposition, its beads as high as the layer is where they lie."""
    region, settings = layer.region, state.settings
    operations, dropped = deposit_operations(region, bead, settings, is_top, height_at=layer.height_at)
    state.dropped.extend(dropped)
    relief = Relief.of(region, bead, settings, layer.height_at)
    state.above_mm += max(bead.height_mm - region.height_mm, 0.0)
    filled = outset(region.region, settings.allowance_mm) if settings.allowance_mm > 0.0 else region.region
    state.deposited_mm3 += volume_under(filled, relief, bead)
    return operations


def volume_under(region: MultiPolygon, relief: Relief, bead: Bead) -> float:
    """Metal that a layer's beads bring on a region, mm³: their height at its centroid (it is linear) times its area."""
    middle = shapely.centroid(region)
    share = float(relief.shares(np.array([[middle.x, middle.y]]))[0])
    return float(region.area) * share * bead.height_mm


def _refuse_thin(bead: Bead) -> None:
    """Raise PlanningError: nothing of the piece can be deposited."""
    raise PlanningError(
        f"nothing can be deposited: all walls are thinner than {THINNEST * bead.width_mm:.2f} mm, "
        f"{THINNEST:g} of the bead's width",
        "choose less power, more speed or a larger stock allowance",
    )
