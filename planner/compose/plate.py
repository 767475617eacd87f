"""Where on its plate a part stands: in the middle, or at the edge over which pieces grow sideways, so that head and cutter have room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.decompose.pieces import Division, Piece
from planner.errors import RecipeError
from planner.mesh.mesh import Mesh
from planner.plan import Skeleton
from planner.recipe import Recipe

Floats = NDArray[np.float64]

_RIM_MM = 3.0  # of the plate that stays free: allowance and half a bead lie outside the part
_SIDEWAYS = 0.6  # least horizontal share of a direction in which the plate is beside the head, not below it
_ONE_SIDED = 0.5  # of what grows sideways: pieces on opposite sides leave the part in the middle
_NEAR_MM = 40.0  # above the plate: higher up head and holder pass over it


def on_plate(division: Division, recipe: Recipe) -> tuple[Division, list[str]]:
    """The division, shifted on the plate as the recipe asks or as its sideways pieces need, and what was decided.

    Raises RecipeError if a shift asked for carries the part's foot off the plate.
    """
    foot = np.vstack([piece.mesh.vertices[:, :2] for piece in division.pieces if piece.parent < 0])
    low, high = foot.min(axis=0), foot.max(axis=0)
    half = 0.5 * np.array(recipe.substrate_mm)
    if recipe.shift_mm != "auto":
        shift = np.array(recipe.shift_mm)
        over = float(np.maximum(high + shift - half, -half - low - shift).max())
        if over > 0.0 and np.any(shift):
            raise RecipeError(
                f"shift_mm: the part's foot leaves the plate by {over:.1f} mm", "shift less, or name a larger substrate_mm"
            )
        return shifted(division, shift), []
    need = _pull(division.pieces)
    room = np.maximum(half - _RIM_MM - np.where(need > 0.0, high, -low), 0.0)
    shift = np.sign(need) * room
    if not np.any(shift):
        return division, []
    x, y = shift
    return shifted(division, shift), [
        f"the part stands ({x:.1f}, {y:.1f}) mm off the plate's middle, so that what grows sideways does so beyond its edge"
    ]


def shifted(division: Division, shift_mm: Floats) -> Division:
    """The division moved along the plate.  shift_mm : (2,) float"""
    if not np.any(shift_mm):
        return division
    move = np.array([shift_mm[0], shift_mm[1], 0.0])
    matrix = np.eye(4)
    matrix[:3, 3] = move
    skeleton = division.skeleton
    return replace(
        division,
        build_from_part=matrix @ division.build_from_part,
        pieces=tuple(_moved(piece, move) for piece in division.pieces),
        skeleton=Skeleton(skeleton.nodes + move, skeleton.radii, skeleton.edges),
    )


def _pull(pieces: tuple[Piece, ...]) -> Floats:
    """(2,) float   Towards which edges: -1, 0 or 1 along x and y, where pieces grow sideways near the plate.

    Each axis is judged by the pieces that grow along it. Where only one edge is asked for, the part goes to that edge's
    corner: clamps hold a plate at the middles of its edges.
    """
    pull, whole = np.zeros(2), np.zeros(2)
    for piece in pieces:
        flat = piece.direction[:2]
        if piece.parent >= 0 and np.linalg.norm(flat) >= _SIDEWAYS and piece.mesh.bounds[0, 2] < _NEAR_MM:
            along = np.where(np.abs(flat) >= 0.5 * _SIDEWAYS, np.sign(flat), 0.0)
            pull += along * piece.mesh.volume
            whole += np.abs(along) * piece.mesh.volume
    asked = np.where(np.abs(pull) > _ONE_SIDED * whole, np.sign(pull), 0.0)
    if asked.any():
        asked = np.where(whole > 0.0, asked, 1.0)
    return asked


def _moved(piece: Piece, move: Floats) -> Piece:
    along = np.concatenate([move, np.zeros(3)])
    return replace(
        piece,
        mesh=_moved_mesh(piece.mesh, move),
        base=piece.base + along,
        axis=piece.axis + move,
        path=None if piece.path is None else piece.path + along,
        support=None if piece.support is None else _moved_mesh(piece.support, move),
    )


def _moved_mesh(mesh: Mesh, move: Floats) -> Mesh:
    return Mesh(mesh.vertices + move, mesh.facets)
