"""Division of a part into pieces: each with a base on what stands before it, a direction and a place in the order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.decompose.blocks import Block, first_block, freed, stands_on, with_path
from planner.decompose.branches import branched
from planner.decompose.cutting import Body
from planner.decompose.direction import build_directions, build_frame, candidate_directions
from planner.decompose.members import Member, Ways, distinct, members
from planner.decompose.order import Blocked, Standing, build_order
from planner.decompose.outcome import pieces_of_blocks
from planner.decompose.pieces import Division
from planner.decompose.pins import in_places, pinned
from planner.decompose.seams import seams
from planner.decompose.search import Search, Taken
from planner.decompose.shares import share_findings
from planner.decompose.skeleton import skeleton
from planner.decompose.weighing import vector_text, weighed
from planner.errors import PlanningError
from planner.mesh.mesh import Mesh
from planner.plan import Candidate
from planner.process import Settings
from planner.recipe import Recipe

Floats = NDArray[np.float64]

_LEAST_BASE = 0.02  # of the part's mean shadow: on less it does not stand
_LEFT_MM2 = 0.5  # less hanging is rounding
_MOST_FIRST = 10  # first directions that are searched
_MOST_ORDERED = 4  # ways, the cheapest first, whose order is looked at


@dataclass(frozen=True, eq=False)
class _Way:
    """One way to build the part.  places : block -> place in the order that the recipe asks for."""

    blocks: list[Block]
    figures: Candidate
    places: dict[int, int]


def divide(mesh: Mesh, recipe: Recipe, settings: Settings) -> Division:
    """The pieces of a part in the order of building: nothing hangs, every piece is reached, as few set-ups as that takes.

    mesh : part frame, mm, closed.
    First directions are weighed; along each, members that would hang are cut off at the part's seams and grow along their own
    direction or with their axis (`planner.decompose.search`), branches that stand side by side become pieces of their own
    (`planner.decompose.branches`), and the cheapest way whose order head and cutter can reach is taken.
    Raises RecipeError if a direction or a cut of the recipe cannot be used, PlanningError if something is left that
    neither a direction nor support can make.
    """
    ways = Ways.of(mesh, settings)
    directions = build_directions(mesh, recipe)
    firsts = _first_blocks(ways, directions)
    if (recipe.decompose == "never" and not recipe.cuts) or recipe.process == "mill":
        found = [_whole(ways, first) for first in firsts]
    elif recipe.cuts:
        found = [_pinned(ways, first, recipe) for first in firsts]
    else:
        found = _searched(ways, firsts, directions if recipe.build_direction == "auto" else candidate_directions(mesh))
    found.sort(key=lambda way: round(way.figures.score, 3))  # ways as good as each other keep their order on any mesh of the part
    return _division(ways, found, recipe)


def _first_blocks(ways: Ways, directions: list[Floats]) -> list[Block]:
    """The whole part along the directions in which it has a base, the most promising of them; along all if it has none in any."""
    shadow = 0.25 * float(ways.mesh.areas.sum())
    blocks = [first_block(ways, Body.whole(ways.mesh), direction) for direction in directions]
    standing = [block for block in blocks if block.joint_mm2 >= _LEAST_BASE * shadow] or blocks
    ranked = sorted(range(len(standing)), key=lambda n: (round(_promise(standing[n], shadow), 6), n))
    return [standing[n] for n in sorted(ranked[:_MOST_FIRST])]


def _promise(block: Block, shadow: float) -> float:
    """Rough cost of a first direction before anything is cut: small is better."""
    hangs = block.hangs
    return (hangs.total_mm2 + hangs.foot_mm2 + 0.2 * hangs.tilted_mm2) / shadow - 0.5 * min(hangs.base_mm2 / shadow, 1.0)


def _whole(ways: Ways, first: Block) -> _Way:
    block = with_path(ways, first)
    return _Way([block], weighed(ways, [block], 0.0), {})


def _pinned(ways: Ways, first: Block, recipe: Recipe) -> _Way:
    blocks, places = pinned(ways, first, recipe)
    blocks = [with_path(ways, block) for block in blocks]
    return _Way(blocks, weighed(ways, blocks, 0.0), places)


def _searched(ways: Ways, wholes: list[Block], directions: list[Floats]) -> list[_Way]:
    """For each first direction the members that would hang cut off, with and without branches as pieces of their own."""
    needed = np.sum([block.hangs.weights for block in wholes], axis=0) + _leaning(ways, [whole.base[3:] for whole in wholes])
    own = members(ways, seams(ways.mesh), directions, needed) if needed.any() else []
    shadow = 0.25 * float(ways.mesh.areas.sum())
    promising = sorted(range(len(wholes)), key=lambda n: (round(_promise(wholes[n], shadow), 6), n))
    made = {number: _along(ways, wholes[number], own) for number in promising}
    return [way for number in sorted(made) for way in made[number]]


def _along(ways: Ways, whole: Block, own: list[Member]) -> list[_Way]:
    """The ways to build the part on one first direction."""
    search = Search(ways, own, whole.base[3:])
    stands = _standing_facets(ways, whole)
    taken, left = search.cover(whole.hangs.weights, None, stands, whole.base[3:], 1)
    straight = with_path(ways, whole) if not taken or left > _LEFT_MM2 else whole
    if straight.path is not None:
        return [_Way([straight], weighed(ways, [straight], 0.0), {})]
    if taken and left > _LEFT_MM2 and ways.settings.recipe.support == "auto":
        return [*_with(ways, whole, taken, own), *_with(ways, whole, [], own)]
    return _with(ways, whole, taken, own)


def _with(ways: Ways, whole: Block, taken: list[Taken], own: list[Member]) -> list[_Way]:
    """The ways to build the part without the members that are taken off, with branches apart and together."""
    try:
        blocks = [with_path(ways, block) for block in freed(ways, whole, taken)]
    except PlanningError:
        blocks = [whole]
    joints = sum((block.joint_mm2 for block in blocks[1:]), 0.0)
    plain = _Way(blocks, weighed(ways, blocks, joints), {})
    used = [block.base[3:] for block in blocks]
    split = [piece for block in blocks for piece in branched(ways, block, own, used)]
    if len(split) == len(blocks):
        return [plain]
    split = [split[0], *(with_path(ways, block) for block in split[1:])]
    figures = weighed(ways, split, joints)
    if figures.overhang_mm2 > plain.figures.overhang_mm2 + 0.5:
        return [plain]
    figures = replace(figures, score=min(figures.score, plain.figures.score - 1e-6))
    return [_Way(split, figures, {}), replace(plain, figures=replace(plain.figures, note=_joined(plain.figures.note, "branches not apart")))]


def _leaning(ways: Ways, firsts: list[Floats]) -> Floats:
    """(m,) float, mm²   Of each facet, what leans over in some first direction."""
    lean = np.sin(np.radians(ways.limits.upright_deg))
    facing = ways.mesh.normals @ np.array(firsts).T
    return np.asarray(np.where(facing < -lean, ways.mesh.areas[:, None], 0.0).sum(axis=1))


def _standing_facets(ways: Ways, block: Block) -> NDArray[np.bool_]:
    """(m,) bool   Facets on which the part stands; those at its lowest point where it has no base."""
    height = (ways.mesh.vertices - block.base[:3]) @ block.base[3:]
    low = height[ways.mesh.facets]
    flat = (low <= 0.05).all(axis=1)
    return np.asarray(flat if flat.any() else (low <= 0.05).any(axis=1))


def _division(ways: Ways, found: list[_Way], recipe: Recipe) -> Division:
    """The cheapest way whose order can be reached, as pieces in the build frame; the others as candidates."""
    notes = [way.figures.note for way in found]
    chosen, order, hit = 0, [0], None
    parents: list[int] = [-1]
    tried: list[tuple[int, list[int], list[int], list[Blocked]]] = []
    for number, way in enumerate(found[:_MOST_ORDERED]):
        frame = build_frame(ways.mesh, way.blocks[0].base[3:], recipe.turn_deg)
        parents = _parents(way.blocks)
        if len(way.blocks) == 1:
            tried.append((number, [0], parents, []))
            break
        order, blocked = build_order(way.blocks, parents, Standing(way.blocks, frame, ways.settings))
        tried.append((number, order, parents, blocked))
        if not blocked:
            break
        notes[number] = _joined(notes[number], _blocked_text(blocked[0], order))
    clear = [one for one in tried if not one[3]]
    chosen, order, parents, hits = clear[0] if clear else tried[0]
    hit = hits[0] if hits else None
    way = found[chosen]
    order = in_places(order, way.places, parents)
    findings = [] if hit is None else [_blocked_text(hit, order)]
    candidates = [
        replace(one.figures, chosen=number == chosen, note=_reason(number == chosen, notes[number]))
        for number, one in enumerate(found)
    ]
    frame = build_frame(ways.mesh, way.blocks[0].base[3:], recipe.turn_deg)
    pieces, more = pieces_of_blocks(ways, way.blocks, order, parents, frame)
    part = ways.mesh.transformed(frame)
    firsts = distinct([one.blocks[0].base[3:] for one in found])
    told = [] if recipe.process == "mill" else share_findings(ways, way.blocks[0].base[3:], firsts)
    findings = [*_chosen_text(way, recipe, len(found)), *told, *findings, *more]
    return Division(frame, tuple(pieces), skeleton(part, np.array([0.0, 0.0, 1.0])), tuple(candidates), tuple(findings))


def _parents(blocks: list[Block]) -> list[int]:
    """What each block stands on: -1 the plate, else another block's number."""
    return [-1] + [max(stands_on(block, blocks), 0) for block in blocks[1:]]


def _joined(first: str, second: str) -> str:
    return "; ".join(text for text in (first, second) if text)


def _reason(is_chosen: bool, note: str) -> str:
    """Why a candidate was taken, or what speaks against it."""
    if is_chosen:
        return _joined("lowest score of those that can be reached", note)
    return note or "no lower score"


def _blocked_text(blocked: Blocked, order: list[int]) -> str:
    """Which piece is hit by what."""
    piece = order.index(blocked.number) + 1
    by = "the plate" if blocked.by < 0 else f"piece {order.index(blocked.by) + 1}"
    return f"piece {piece}: the {blocked.tool} meets {by} at {100.0 * blocked.share:.0f} % of its places"


def _chosen_text(way: _Way, recipe: Recipe, weighed_count: int) -> list[str]:
    """The finding that says which way was chosen."""
    first = way.blocks[0].base[3:]
    lines = []
    if recipe.build_direction == "auto":
        lines.append(f"build direction chosen: {vector_text(first)}, the best of {weighed_count} ways")
    if len(way.blocks) > 1:
        lines.append(f"built in {len(way.blocks)} pieces, {way.figures.name}")
    return lines
