"""Pieces of a division from the blocks that were found: in the build frame, in order, with support where nothing else helps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.decompose.axis import straight_axis
from planner.decompose.blocks import Block
from planner.decompose.members import Ways
from planner.decompose.pieces import Piece
from planner.decompose.support import supports
from planner.errors import PlanningError
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]

_HANGS_MM2 = 0.5  # less is rounding


def pieces_of_blocks(
    ways: Ways, blocks: Sequence[Block], order: Sequence[int], parents: Sequence[int], build_from_part: Floats
) -> tuple[list[Piece], list[str]]:
    """The blocks as pieces, in order, and what is to be told of them.

    Raises PlanningError, naming the place, if something hangs that support cannot carry either.
    """
    pieces: list[Piece] = []
    findings: list[str] = []
    for place, number in enumerate(order):
        block = blocks[number]
        parent = -1 if block.cap is None else order.index(parents[number])
        piece = _piece(str(place + 1), block, parent, build_from_part)
        if block.left_mm2 > _HANGS_MM2 and ways.settings.recipe.process != "mill":
            piece, lines = _supported(ways, piece, block, pieces)
            findings += lines
        pieces.append(piece)
    return pieces, findings


def _piece(name: str, block: Block, parent: int, build_from_part: Floats) -> Piece:
    """A block in the build frame."""
    turn, shift = build_from_part[:3, :3], build_from_part[:3, 3]
    mesh = block.mesh.transformed(build_from_part)
    base = np.concatenate([turn @ block.base[:3] + shift, turn @ block.base[3:]])
    if parent < 0:
        base = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    path = None
    if block.path is None:
        axis, _ = straight_axis(mesh, base)
    else:
        planes = block.path.planes
        path = np.hstack([planes[:, :3] @ turn.T + shift, planes[:, 3:] @ turn.T])
        axis = block.path.axis @ turn.T + shift
    why = block.why or ("stands on the plate",)
    return Piece(name, mesh, parent, base, block.joint_mm2, axis, path, None, why)


def _supported(ways: Ways, piece: Piece, block: Block, before: Sequence[Piece]) -> tuple[Piece, list[str]]:
    """The piece with sacrificial metal under what hangs.  Raises PlanningError if that is not wanted or does not help."""
    worst = int(np.argmax(block.hangs.weights))
    place = place_text(piece.mesh.centroids[worst])
    text = f"piece {piece.name}: {block.left_mm2:.0f} mm² hang around {place}, and no direction or cut that was tried carries them"
    if ways.settings.recipe.support == "never":
        return piece, [f"{text}; support = never"]
    to_piece = _piece_from_build(piece.base)
    standing = _joined([other.mesh for other in before])
    try:
        found = supports(
            piece.mesh.transformed(to_piece),
            ways.limits.tilted_deg,
            ways.settings,
            None if standing is None else standing.transformed(to_piece),
        )
    except PlanningError as error:
        raise PlanningError(f"{text}; support: {error.message}", error.hint) from None
    if found is None:
        return piece, [f"{text}; too narrow for support: the head is tilted as far as it goes"]
    mesh = found.mesh.transformed(np.linalg.inv(to_piece))
    why = f"{block.left_mm2:.0f} mm² of it hang in every direction: {found.volume_mm3:.0f} mm³ of support carry them"
    return replace(piece, support=mesh, why=(*piece.why, why)), [f"piece {piece.name}: {line}" for line in found.findings]


def _piece_from_build(base: Floats) -> Floats:
    """(4, 4) float   Into the frame whose z is a base plane's direction and whose z = 0 is the plane."""
    axes = plane_frame(base)[1:]
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = -axes @ base[:3]
    return matrix


def _joined(meshes: Sequence[Mesh]) -> Mesh | None:
    """Several closed meshes as one; None for none."""
    if not meshes:
        return None
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    facets = [mesh.facets + begin for mesh, begin in zip(meshes, first, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(facets))
