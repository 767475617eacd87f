"""What making a piece comes to, and how its layers are carried into the build frame and numbered."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from planner.plan import Contour, Layer, Operation, Wall
from planner.toolpath.placed import in_build

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Made:
    """A piece with its operations.

    layers : build frame, numbered through the part   end_direction : (3,) float, of its last layer
    deposited_mm3 : nominal   unsupported_mm : longest bead that nothing carries   findings : one line each
    """

    layers: list[Layer]
    end_direction: Floats
    deposited_mm3: float
    unsupported_mm: float = 0.0
    support_mm3: float = 0.0
    findings: list[str] = field(default_factory=list)


def in_place(layer: Layer, build_from_piece: Floats, first: int, subcomponent: int) -> Layer:
    """A layer from its piece's frame in the build frame, with its number in the part.

    build_from_piece : (4, 4) float, rigid, mm   first : layers before the piece   subcomponent : the piece's number.
    """
    if np.array_equal(build_from_piece, np.eye(4)):
        if first == 0 and subcomponent == 0:
            return layer
        return replace(
            layer,
            index=layer.index + first,
            operations=tuple(replace(operation, layer=operation.layer + first) for operation in layer.operations),
            subcomponent=subcomponent,
        )
    return Layer(
        index=layer.index + first,
        bottom=moved_plane(layer.bottom, build_from_piece),
        top=moved_plane(layer.top, build_from_piece),
        contours=tuple(_moved_contour(contour, build_from_piece) for contour in layer.contours),
        walls=tuple(_moved_wall(wall, build_from_piece) for wall in layer.walls),
        overlap_mm2=layer.overlap_mm2,
        overhang_mm2=layer.overhang_mm2,
        operations=tuple(_renumbered(operation, build_from_piece, first) for operation in layer.operations),
        subcomponent=subcomponent,
        overhang=tuple(outline @ build_from_piece[:3, :3].T + build_from_piece[:3, 3] for outline in layer.overhang),
        thickness_mm=layer.thickness_mm,
    )


def moved_plane(plane: Floats, matrix: Floats) -> Floats:
    """(6,) float   A plane, point and unit normal, under a rigid motion."""
    return np.concatenate([matrix[:3, :3] @ plane[:3] + matrix[:3, 3], matrix[:3, :3] @ plane[3:]])


def _moved_contour(contour: Contour, matrix: Floats) -> Contour:
    return replace(contour, curve=contour.curve.transformed(matrix))


def _moved_wall(wall: Wall, matrix: Floats) -> Wall:
    return replace(wall, bottom=wall.bottom.transformed(matrix), top=wall.top.transformed(matrix))


def _renumbered(operation: Operation, matrix: Floats, first: int) -> Operation:
    return replace(in_build(operation, matrix), layer=operation.layer + first)
