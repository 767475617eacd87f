"""A piece whose layers turn with its axis: each layer made in a frame of its own, linked there, and carried into the build frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.compose.lean import Lean
from planner.compose.made import Made
from planner.compose.standing import Standing
from planner.compose.work import Work
from planner.plan import Contour, Layer, Operation, Wall
from planner.slicing.turned_outlines import plan_outlines
from planner.slicing.turning import TurnedLayer, turned_layers
from planner.toolpath.beside import Stands
from planner.toolpath.links import Pose, linked, taken_up
from planner.toolpath.placed import in_build
from planner.toolpath.turning import TurnedWork, turned_operations

Floats = NDArray[np.float64]

_LOT = 8  # layers whose contours are fitted together
_WAY_MM = 1.0  # beside a layer, for what ways between its passes go over

Outlines = tuple[tuple[Contour, ...], tuple[Wall, ...]]


def turning_piece(work: Work) -> Made:
    """The layers of a piece that turns, with all that is done to it.  Raises PlanningError or RecipeError."""
    piece, settings = work.piece, work.settings
    assert piece.path is not None
    work.say("layers", 0.0)
    layers, findings = turned_layers(piece.mesh, piece.path, settings, settings.recipe)
    work.say("contours", 0.1)
    outlines = _outlines(work, layers)
    lean = work.lean()
    way = _Way()
    made: list[Layer] = []
    deposited = 0.0
    for number, (step, (contours, walls)) in enumerate(zip(_steps(work, layers), outlines, strict=True)):
        operations = _linked(step, way, work, lean)
        layer = work.cooled(_layer(step.layer, contours, walls, operations, work))
        made.append(layer)
        deposited += step.deposited_mm3
        findings = [*findings, *step.findings]
        if work.on_layer is not None:
            work.on_layer(layer)
        work.say("toolpaths", 0.1 + 0.9 * (number + 1) / len(layers))
    return Made(
        made,
        layers[-1].top[3:],
        deposited,
        max(layer.region.unsupported_mm for layer in layers),
        findings=[*findings, *(lean.findings if lean is not None else [])],
    )


def _steps(work: Work, layers: Sequence[TurnedLayer]) -> Iterator[TurnedWork]:
    """The work on each layer, cutters kept clear of what stands."""
    standing = work.standing
    if standing is None or not standing.meshes:
        return turned_operations(work.piece.mesh, layers, work.settings)

    def stands_in(build_from_frame: Floats) -> Stands:
        return standing.seen_from(np.linalg.inv(build_from_frame) @ work.piece.build_from_piece).keep_out

    return turned_operations(work.piece.mesh, layers, work.settings, stands_in=stands_in)


def _outlines(work: Work, layers: Sequence[TurnedLayer]) -> Iterator[Outlines]:
    """Contours and walls, the first layer's at once, the others in lots."""
    at, size = 0, 1
    while at < len(layers):
        yield from plan_outlines(work.piece.mesh, layers[at : at + size], work.settings.recipe)
        at, size = at + size, _LOT


@dataclass
class _Way:
    """How far the tool has come.  here : its pose, build frame   last : what it did"""

    here: Pose | None = None
    last: Operation | None = None


def _linked(step: TurnedWork, way: _Way, work: Work, lean: Lean | None) -> list[Operation]:
    """A layer's operations with their links, build frame; the way goes on to where they leave the tool."""
    layer = step.layer
    standing = _standing_mm(work.standing, layer, work)
    piece_from_layer = np.linalg.inv(work.piece.build_from_piece) @ layer.build_from_layer
    found: list[Operation] = []
    for asked in step.operations:
        operation = asked if lean is None else lean.away(asked, piece_from_layer)
        at = None if way.here is None else _moved_pose(way.here, layer.layer_from_build)
        at = taken_up(at, way.last, operation)
        done, at = linked(operation, at, step.metal_top_mm, work.settings, standing)
        found.append(replace(in_build(done, layer.build_from_layer), layer=layer.region.index + work.first_layer))
        way.here, way.last = _moved_pose(at, layer.build_from_layer), done
    return found


def _standing_mm(standing: Standing | None, layer: TurnedLayer, work: Work) -> float:
    """How high what stands reaches over a layer's hull, in its frame, mm."""
    if standing is None:
        return 0.0
    return standing.height_of_points(layer.layer_from_build @ work.piece.build_from_piece, layer.region.region, _WAY_MM)


def _moved_pose(pose: Pose, matrix: Floats) -> Pose:
    return Pose(matrix[:3, :3] @ pose.tip + matrix[:3, 3], matrix[:3, :3] @ pose.axis)


def _layer(
    layer: TurnedLayer,
    contours: tuple[Contour, ...],
    walls: tuple[Wall, ...],
    operations: Sequence[Operation],
    work: Work,
) -> Layer:
    region = layer.region
    return Layer(
        index=region.index + work.first_layer,
        bottom=layer.bottom,
        top=layer.top,
        contours=contours,
        walls=walls,
        overlap_mm2=region.overlap_mm2,
        overhang_mm2=region.overhang_mm2,
        operations=tuple(operations),
        subcomponent=work.number,
        overhang=work.outlines(region, layer.build_from_layer),
        thickness_mm=layer.thickness_mm,
    )
