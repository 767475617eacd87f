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
from planner.recipe import Recipe

Floats = NDArray[np.float64]

_ALIGNED = 0.9999


def pinned(ways: Ways, block: Block, recipe: Recipe) -> tuple[list[Block], dict[int, int]]:
    """The block and what the recipe's cuts take off it, and the places in the order that they ask for: block -> place.

    Every cut goes through all blocks that are there by then; each body beyond it becomes one.
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
        made: list[Block] = []
        for at, here in enumerate(blocks):
            rest, beyond = _all_beyond(ways, here, plane)
            blocks[at] = rest
            made += beyond
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


def _all_beyond(ways: Ways, block: Block, plane: Floats) -> tuple[Block, list[Block]]:
    """A block without what lies beyond a plane, and the bodies beyond; the block itself where the plane misses it."""
    rest, made = block, []
    for _ in range(PlaneCut(block.mesh, plane).count):
        cut = PlaneCut(rest.mesh, plane)
        if not cut.count or (cut.label >= 0).all():
            break
        source = rest.body.source
        like = np.zeros(len(ways.mesh.facets))
        mine = source[(cut.label == 0) & (source >= 0)]
        if not len(mine):
            break
        like[mine] = 1.0
        rest, beyond = cut_off(ways, rest, plane, like, None, "cut where the recipe says")
        made.append(beyond)
    return rest, made
