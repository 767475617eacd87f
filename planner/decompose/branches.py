"""Branches: members that stand side by side on a block are pieces of their own, each finished before the next begins.

The rule. Along a block's direction, its body beyond a level where its outline changes falls into bodies. Those that are at
least 1.25 times as long as the circle with their joint's area is wide are members, the others (bosses, stubs, rims, lugs)
are features of what they stand on. Members are cut off where two or more bodies stand at one level: each can then be
milled all round while the other is not there yet. A ring that closes again further up is one body and is not cut.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.decompose.blocks import Block, cut_off
from planner.decompose.cutting import PlaneCut
from planner.decompose.members import Member, Ways
from planner.decompose.search import COSTS
from planner.errors import PlanningError
from planner.slicing.critical import critical_heights
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]

SLENDER = 1.25  # length over width from which a branch is a member
_LEAST_MM = 1.0  # of a block below its branches
_BETWEEN_MM = 0.3  # levels nearer than this are one: less than a layer
_PROBE = 1e-3  # of the block's height: above a level its outlines are counted
_MOST_PIECES = 40
_COVERS = 0.5  # of a branch, by area, that a member along its own axis must hold to stand for it


def branched(ways: Ways, block: Block, members: Sequence[Member], used: list[Floats], room: int = _MOST_PIECES) -> list[Block]:
    """The block and its branches, the block first, each branch followed by its own.

    members : found at seams: where one of them along another direction leans less, the branch is cut there instead
    used : directions in which something is built already; grows
    """
    if room <= 0 or block.path is not None:
        return [block]
    for level in _splits(block):
        found = _branches(block, level)
        if not found:
            continue
        made: list[Block] = []
        rest = block
        for like in found:
            plane = np.concatenate([block.base[:3] + (level - float(block.base[:3] @ block.base[3:])) * block.base[3:], block.base[3:]])
            try:
                rest, branch = _best_cut(ways, rest, plane, like, members, used)
            except PlanningError:
                continue
            if branch.left_mm2 > block.left_mm2 + 0.5:
                return [block]
            made.append(branch)
        if made:
            pieces = branched(ways, rest, members, used, room - len(made))
            for branch in made:
                pieces += branched(ways, branch, members, used, room - len(made) - len(pieces))
            return pieces
    return [block]


def _splits(block: Block) -> list[float]:
    """Levels along the block's direction above which its section is in two or more, mm, rising."""
    direction = block.base[3:]
    heights = critical_heights(block.mesh, direction)
    low, high = float(heights[0]), float(heights[-1])
    kept: list[float] = []
    for height in heights.tolist():
        if height > low + _LEAST_MM and height < high - _LEAST_MM and (not kept or height > kept[-1] + _BETWEEN_MM):
            kept.append(height)
    if not kept:
        return []
    probes = np.array(kept) + _PROBE * (high - low)
    planes = np.column_stack([np.outer(probes, direction), np.tile(direction, (len(kept), 1))])
    sections = slice_mesh(block.mesh, planes)
    return [
        level for level, section in zip(kept, sections, strict=True) if sum(not loop.is_hole for loop in section.loops) > 1
    ]


def _branches(block: Block, level: float) -> list[Floats]:
    """Slender bodies beside others beyond a level: share of the part's facets in each, (m,)."""
    direction = block.base[3:]
    try:
        cut = PlaneCut(block.mesh, np.concatenate([direction * level, direction]))
    except PlanningError:
        return []
    if cut.count < 2:
        return []
    source = block.body.source
    found = []
    for number in range(cut.count):
        mine = cut.label == number
        joint = cut.cap_mm2(number)
        top = float((block.mesh.corners[mine] @ direction).max())
        if joint <= 0.0 or top - level < SLENDER * 2.0 * np.sqrt(joint / np.pi):
            continue
        like = np.zeros(int(source.max()) + 1)
        like[source[mine & (source >= 0)]] = 1.0
        found.append((like, tuple(np.round(block.mesh.corners[mine].mean(axis=(0, 1)), 3).tolist())))
    found.sort(key=lambda one: one[1])
    return [like for like, _ in found]


def _best_cut(
    ways: Ways, block: Block, plane: Floats, like: Floats, members: Sequence[Member], used: list[Floats]
) -> tuple[Block, Block]:
    """The block without a branch, and the branch: cut straight across, or along the branch's own axis if that leans less."""
    why = "one of several members that stand side by side: finished by itself, reached from all sides"
    rest, branch = cut_off(ways, block, plane, like, None, why)
    shadow = 0.25 * float(ways.mesh.areas.sum())
    areas = ways.mesh.areas
    whole = np.zeros(len(areas))
    whole[: len(like)] = like
    size = float((whole * areas).sum())
    best: tuple[float, Member] | None = None
    for member in members:
        own = float((member.share * areas).sum())
        shared = float((member.share * whole * areas).sum())
        if shared < 0.97 * own or own < _COVERS * size or member.hangs.sum() > branch.left_mm2 + 0.5:
            continue
        is_new = all(float(member.direction @ other) < 0.9999 for other in used)
        left = branch.hangs.tilted_mm2 * (1.0 - own / size)
        saved = COSTS["tilted"] * (branch.hangs.tilted_mm2 - member.tilted_mm2 - left)
        saved += COSTS["joint"] * (branch.joint_mm2 - member.joint_mm2)
        gain = saved / shadow - COSTS["setup"] * is_new
        if gain > 1e-6 and (best is None or gain > best[0] + 1e-9):
            best = (gain, member)
    if best is None:
        return rest, branch
    along = best[1]
    used.append(along.direction)
    return cut_off(ways, block, along.plane, along.share, None, f"{why}; along its own axis it leans less")
