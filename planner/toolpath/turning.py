"""What is done to layers that turn with the part, each in its own frame: deposited, faced, milled in ruled bands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.errors import PlanningError
from planner.mesh.mesh import Mesh
from planner.nurbs.offset import outset
from planner.plan import Operation
from planner.process import Bead, Settings
from planner.slicing.turning import TurnedLayer
from planner.toolpath.beside import Stands
from planner.toolpath.cut import BULGE, Left, faced, left_findings
from planner.toolpath.deposit import THINNEST, Dropped, dropped_findings, grown_region, outside_mm
from planner.toolpath.order import RUNS_DOWN
from planner.toolpath.placed import in_build
from planner.toolpath.side import places
from planner.toolpath.turned_bands import TurnedBand, layers_under, make_turned_bands
from planner.toolpath.turned_deposit import Laid, laid
from planner.toolpath.turned_side import turned_side_operations

__all__ = ["StandsIn", "TurnedWork", "in_build", "turned_operations"]

Floats = NDArray[np.float64]
StandsIn = Callable[[Floats], Stands]
"""What a cutter must keep clear of in a frame, given build_from_frame, (4, 4) float."""

_TOP_SHARE = 0.02  # of a layer's top; smaller free rims belong to leaning walls
_PILED, _PILED_WITHIN = 0.3, 1.0
"""Of the next layer's least height: metal standing higher than this over the plane is faced before the next layer, so that
the head's stand-off stays right; after the last layer of a band, and within one."""
_WEDGE_MM = 1.0  # how far under a band, beyond what ran down, its cutter's end is let down at most


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
    """The piece while it grows.

    above_mm : metal over the nominal top since the last facing   unfaced : layers since then   laid : how layers were made
    """

    layers: Sequence[TurnedLayer]
    mesh: Mesh
    settings: Settings
    stands_in: StandsIn | None
    above_mm: float = 0.0
    most_above_mm: float = 0.0
    unfaced: int = 0
    laid: list[Laid] = field(default_factory=list)
    dropped: list[Dropped] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)


def turned_operations(
    mesh: Mesh, layers: Sequence[TurnedLayer], settings: Settings, *, stands_in: StandsIn | None = None
) -> Iterator[TurnedWork]:
    """The work on each layer of a piece that turns, in order, each when it is asked for.

    mesh : the piece that the layers were cut from   layers : all of them, from `turned_layers`
    stands_in : what else stands, for cutters.
    Raises RecipeError where no bead fills a layer, PlanningError if none fits anywhere.
    """
    state = _State(layers, mesh, settings, stands_in)
    tops = _finished_tops(layers, settings)
    bands = make_turned_bands(layers, mesh, settings) if settings.is_milled else iter(())
    band: TurnedBand | None = None
    for number, layer in enumerate(layers):
        if band is None or band.band.last < number:
            band = next(bands, None)
        made = laid(layer, tops[number], settings)
        state.laid.append(made)
        state.dropped.extend(made.dropped)
        state.above_mm = made.excess_mm + (0.0 if made.is_uniform and not state.unfaced else state.above_mm)
        state.unfaced += 1
        state.most_above_mm = max(state.most_above_mm, state.above_mm)
        top = layer.region.z_top + state.above_mm + made.crest_mm
        operations = list(made.operations)
        is_end = band is not None and band.band.last == number
        if settings.is_milled and _is_face_due(state, number, tops[number], is_end):
            operations += _faced(layer, made.bead, state)
        if band is not None and is_end:
            operations += _milled(band, state)
        findings = _findings(state) if number == len(layers) - 1 else ()
        yield TurnedWork(layer, tuple(operations), top, made.volume_mm3, findings)


def _finished_tops(layers: Sequence[TurnedLayer], settings: Settings) -> list[bool]:
    """Which layers have a top that is faced and stays: part of it carries nothing of the next layer."""
    if not settings.is_milled:
        return [False] * len(layers)
    tops = [layer.region.top.area_mm2 for layer in layers]
    above = [*(layer.region.bottom.area_mm2 for layer in layers[1:]), 0.0]
    return [top > 0.0 and top - carries > _TOP_SHARE * top for top, carries in zip(tops, above, strict=True)]


def _is_face_due(state: _State, number: int, is_top: bool, is_end: bool) -> bool:
    """Whether a layer's top is brought to its plane before the next layer."""
    layers, every = state.layers, state.settings.recipe.face_every_layers
    if number == len(layers) - 1 or is_top or state.laid[-1].is_uniform:
        return True
    return state.above_mm >= _PILED * layers[number + 1].thickness_mm[0] or (
        every is not None and state.unfaced >= every
    )


def _faced(layer: TurnedLayer, bead: Bead, state: _State) -> list[Operation]:
    """The facing of a layer's top plane, in the layer's frame."""
    settings, region = state.settings, layer.region
    if region.areas[2].is_empty and layer is state.layers[-1]:
        return []
    top_from_layer = np.linalg.inv(layer.build_from_top) @ layer.build_from_layer

    def carried(xy: Floats) -> Floats:
        points = np.column_stack([xy, layer.height_at(xy)])
        return np.asarray(points @ top_from_layer[:2, :3].T + top_from_layer[:2, 3])

    metal = shapely.transform(outset(grown_region(region, bead, settings), BULGE * bead.width_mm, 0.01), carried)
    level = replace(region, z_bottom=-region.height_mm, z_top=0.0)
    stands = state.stands_in(layer.build_from_top) if state.stands_in is not None else None
    left: list[Left] = []
    operations = faced(metal, level, state.above_mm, settings, stands, left)
    state.left.extend(replace(item, z_bottom=region.index, z_top=region.index + 1) for item in left)
    state.above_mm, state.unfaced = 0.0, 0
    layer_from_top = np.asarray(np.linalg.inv(top_from_layer))
    return [in_build(operation, layer_from_top) for operation in operations]


def _milled(made: TurnedBand, state: _State) -> list[Operation]:
    """The milling of a band's walls, in the frame of its last layer."""
    settings, band = state.settings, made.band
    beads = [state.laid[k].bead for k in range(band.first, band.last + 1)]
    run_down = RUNS_DOWN * max(bead.crest_mm for bead in beads)
    out = max(outside_mm(bead, settings) + BULGE * bead.width_mm for bead in beads)
    excess = out + max(_leaning_out(state.layers[k]) for k in range(band.first, band.last + 1))
    under = layers_under(made, state.mesh, run_down + _WEDGE_MM)
    stands = state.stands_in(made.build_from_band) if state.stands_in is not None else None
    operations, left = turned_side_operations(made, under, excess, run_down, settings, stands)
    if not made.narrow.is_empty:
        height = band.z_top - band.z_bottom
        state.left.append(
            Left(
                "closed",
                band.first,
                band.last + 1,
                places(made.narrow),
                len(made.narrow.geoms),
                made.narrow.area * height,
            )
        )
    state.left.extend(replace(item, z_bottom=band.first, z_top=band.last + 1) for item in left)
    layer_from_band = state.layers[band.last].layer_from_build @ made.build_from_band
    return [in_build(operation, layer_from_band) for operation in operations]


def _leaning_out(layer: TurnedLayer) -> float:
    """How far a layer stands out beyond its ruled wall, mm: it is as wide as its widest section."""
    filled = [area for area in layer.region.areas if not area.is_empty]
    narrow = min(filled, key=lambda area: area.area)
    return float(shapely.hausdorff_distance(narrow.boundary, layer.region.region.boundary))


def _findings(state: _State) -> tuple[str, ...]:
    """What is to be said of the whole piece.  Raises PlanningError if nothing of it was deposited."""
    if not any(made.operations for made in state.laid):
        width = state.laid[0].bead.width_mm
        raise PlanningError(
            f"nothing can be deposited: all walls are thinner than {THINNEST * width:.2f} mm, {THINNEST:g} of the bead's width",
            "choose less power, more speed or a larger stock allowance",
        )
    found = [*dropped_findings(state.dropped), *left_findings(state.left, state.settings, by_layer=True)]
    if state.settings.is_milled:
        found.append(
            f"layers that turn stand up to {state.most_above_mm:.2f} mm over their planes before they are faced"
        )
    uniform = [number for number, made in enumerate(state.laid) if made.is_uniform]
    if uniform:
        found.append(
            f"{len(uniform)} layers of {min(state.layers[k].thickness_mm[0] for k in uniform):.2f} to "
            f"{max(state.layers[k].thickness_mm[1] for k in uniform):.2f} mm are made of uniform beads, some of them partial: up to "
            f"{max(state.laid[k].excess_mm for k in uniform):.2f} mm over their planes are milled off"
        )
    return tuple(found)
