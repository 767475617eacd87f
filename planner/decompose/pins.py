"""Cuts that the recipe pins: planes, directions and places in the order, used instead of found ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.decompose.blocks import Block, cut_off
from planner.decompose.cutting import PlaneCut
from planner.decompose.direction import asked_direction
from planner.decompose.members import MOST_TURNED_COS, Ways
from planner.decompose.weighing import vector_text
from planner.errors import RecipeError
from planner.mesh.winding import solid_angle_turns
from planner.recipe import Recipe

Floats = NDArray[np.float64]

_ALIGNED = 0.9999
_AT_JOINT = 0.5  # turns of a solid angle: more, seen from just beyond the plane, is inside the body
_BEYOND_MM = 0.02  # where that is asked


def pinned(ways: Ways, block: Block, recipe: Recipe) -> tuple[list[Block], dict[int, int]]:
    """The block and what the recipe's cuts take off it, and the places in the order that they ask for: block -> place.

    A cut whose point lies in the joint of one body takes that body alone: its plane may meet others of the part's arms, which
    stay as they are. Else it goes through all blocks that are there by then, and each body beyond it becomes one.
    Raises RecipeError, naming the cut, if it misses the part, leaves nothing, or has a direction that cannot be reached.
    """
    blocks, places = [block], {}
    for number, cut in enumerate(recipe.cuts):
        name = f"cuts[{number}]"
        normal = asked_direction(cut.normal, f"{name}.normal")
        direction = normal if cut.direction is None else asked_direction(cut.direction, f"{name}.direction")
        if float(direction @ normal) <= 0.1:
            raise RecipeError(f"{name}.direction: {vector_text(direction)} does not lead away from the cut", "turn it towards the normal")
        if float(direction @ normal) < _ALIGNED:
            raise RecipeError(
                f"{name}.direction: {vector_text(direction)} is off the cut's normal {vector_text(normal)}: "
                "a piece grows square on its joint, or layers at its foot would begin beside what carries them",
                "leave direction out, or turn the normal to it",
            )
        if float(direction @ block.base[3:]) <= MOST_TURNED_COS:
            raise RecipeError(
                f"{name}: direction {vector_text(direction)} is more than 100° from the first, {vector_text(block.base[3:])}: "
                "the plate is in the way",
                "choose another build_direction",
            )
        plane = np.concatenate([np.array(cut.point_mm, dtype=np.float64), normal])
        made = _taken_off(ways, blocks, plane)
        if not made:
            raise RecipeError(f"{name}: the plane through {vector_text(plane[:3])} mm misses the part", "move it, or leave it out")
        for one in made:
            if cut.order is not None:
                places[len(blocks)] = cut.order
            blocks.append(one)
    return blocks, places


def in_places(order: list[int], places: dict[int, int], parents: Sequence[int]) -> list[int]:
    """The order with pinned blocks at the places asked for (1 is the first).

    Raises RecipeError if a block would come before what it stands on.
    """
    if not places:
        return order
    free = [number for number in order if number not in places]
    made: list[int] = []
    asked = sorted(places, key=lambda number: (places[number], order.index(number)))
    while free or asked:
        if asked and (places[asked[0]] <= len(made) + 1 or not free):
            made.append(asked.pop(0))
        else:
            made.append(free.pop(0))
    for at, number in enumerate(made):
        if parents[number] >= 0 and parents[number] not in made[:at]:
            raise RecipeError(
                f"cuts: order {places.get(number, at + 1)} comes before the piece on which it stands", "give it a later place"
            )
    return made


def _taken_off(ways: Ways, blocks: list[Block], plane: Floats) -> list[Block]:
    """Bodies that a plane cuts off blocks, which become what is left of them: the one whose joint holds its point, else all beyond."""
    for at, here in enumerate(blocks):
        cut = PlaneCut(here.mesh, plane)
        probe = plane[:3] + _BEYOND_MM * plane[3:]
        for number in range(cut.count):
            if solid_angle_turns(cut.above(number).mesh.corners, probe) > _AT_JOINT:
                one = _one_beyond(ways, here, plane, cut.label == number)
                if one is not None:
                    blocks[at] = one[0]
                    return [one[1]]
    made: list[Block] = []
    for at, here in enumerate(blocks):
        blocks[at], beyond = _all_beyond(ways, here, plane)
        made += beyond
    return made


def _one_beyond(ways: Ways, block: Block, plane: Floats, facets: NDArray[np.bool_]) -> tuple[Block, Block] | None:
    """The rest of a block and the body beyond a plane to which given facets belong; None if none of them is the part's."""
    source = block.body.source
    mine = source[facets & (source >= 0)]
    if not len(mine):
        return None
    like = np.zeros(len(ways.mesh.facets))
    like[mine] = 1.0
    return cut_off(ways, block, plane, like, None, "cut where the recipe says")


def _all_beyond(ways: Ways, block: Block, plane: Floats) -> tuple[Block, list[Block]]:
    """A block without what lies beyond a plane, and the bodies beyond; the block itself where the plane misses it."""
    rest, made = block, []
    for _ in range(PlaneCut(block.mesh, plane).count):
        cut = PlaneCut(rest.mesh, plane)
        if not cut.count or (cut.label >= 0).all():
            break
        one = _one_beyond(ways, rest, plane, cut.label == 0)
        if one is None:
            break
        rest = one[0]
        made.append(one[1])
    return rest, made
