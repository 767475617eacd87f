"""Blocks that a part falls into: members cut off one after the other, each with the plane on which it stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.decompose.corners import used_vertices
from planner.decompose.cutting import Body, PlaneCut
from planner.decompose.hanging import Hanging
from planner.decompose.members import Member, Ways, may_bend, path_on
from planner.decompose.path import AxisPath
from planner.decompose.search import Taken, removal_order
from planner.errors import PlanningError
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.mesh.winding import solid_angle_turns

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_UNDER_MM = 0.02  # below a joint is what it stands on
_WORTH_TILT = 0.1  # of the piece's mean shadow: with less leaning nothing is gained by turning layers


@dataclass(frozen=True, eq=False)
class Block:
    """A piece of the part, part frame.

    base : (6,) float, point (mm) and direction   cap : (m,) bool, its facets on what it stands on; None: it stands on the plate
    path : planes along its axis where its layers turn   why : one line each
    """

    ways: Ways = field(repr=False)
    body: Body
    base: Floats
    cap: Flags | None
    path: AxisPath | None = None
    why: tuple[str, ...] = ()

    @cached_property
    def hangs(self) -> Hanging:
        """What hangs of it while it grows straight."""
        return self.ways.hanging(self.body, self.base, self.cap)

    @property
    def mesh(self) -> Mesh:
        """Closed, mm."""
        return self.body.mesh

    @property
    def joint_mm2(self) -> float:
        """Area on which it stands."""
        return self.hangs.base_mm2 if self.cap is None else float(self.mesh.areas[self.cap].sum())

    @property
    def left_mm2(self) -> float:
        """What hangs of it as it is built."""
        return 0.0 if self.path is not None else self.hangs.total_mm2


def first_block(ways: Ways, body: Body, direction: Floats) -> Block:
    """A body that stands on the plate with its lowest point along a direction."""
    used = body.mesh.vertices[used_vertices(body.mesh)]
    lowest = used[int(np.argmin(np.round(used @ direction, 6)))]
    base = np.concatenate([lowest, direction])
    return Block(ways, body, base, None)


def cut_off(ways: Ways, block: Block, plane: Floats, like: Floats | Flags, path: AxisPath | None, why: str) -> tuple[Block, Block]:
    """Cut from a block the body beyond a plane that shares most with given facets of the part: (rest, cut off).

    like : (m,) share of the part's facets in it.  Raises PlanningError if nothing of it is beyond the plane.
    """
    cut = PlaneCut(block.mesh, plane)
    source = block.body.source
    held = np.where(source >= 0, like[np.maximum(source, 0)], 0.0) * block.mesh.areas
    score = np.bincount(cut.label[cut.label >= 0], weights=held[cut.label >= 0], minlength=cut.count)
    if not cut.count or score.max() <= 0.0:
        raise PlanningError(f"nothing lies beyond the cut at {place_text(plane[:3])}", "move the cutting plane")
    number = int(np.argmax(score))
    taken = np.arange(cut.count) == number
    above, below = cut.above(number), cut.below(taken)
    cap = above.source < 0
    beyond = above.after(block.body)
    base = _centred(plane, above.mesh, cap)
    rest_body = below.after(block.body)
    rest_cap = None if block.cap is None else _kept(block.cap, below.source)
    rest = replace(block, body=rest_body, cap=rest_cap)
    return rest, Block(ways, beyond, base, cap, path, (why,))


def freed(ways: Ways, block: Block, taken: Sequence[Taken]) -> list[Block]:
    """A block and the members that are taken off it, in the reverse order of cutting, the block itself first."""
    made: list[Block] = []
    rest = block
    for one in removal_order(taken):
        member = one.member
        rest, beyond = cut_off(ways, rest, member.plane, member.share, one.path, _why(ways, member, one))
        made.append(beyond)
    return [rest, *made[::-1]]


def with_path(ways: Ways, block: Block) -> Block:
    """The block with planes along its axis where it would hang, or lean much, and its axis bends on the whole."""
    if block.path is not None:
        return block
    leans = block.hangs.tilted_mm2 > _WORTH_TILT * 0.25 * float(block.mesh.areas.sum())
    if block.hangs.total_mm2 <= 0.0 and not leans:
        return block
    if not may_bend(block.mesh, block.joint_mm2, block.hangs.total_mm2, block.hangs.tilted_mm2):
        return block
    path = path_on(block.body, block.base, ways)
    if path is None:
        return block
    turned = float(np.degrees(np.arccos(np.clip(path.planes[0, 3:] @ path.planes[-1, 3:], -1.0, 1.0))))
    why = f"its axis turns by {turned:.0f}°: its layers follow it"
    return replace(block, path=path, why=(*block.why, why))


def stands_on(block: Block, others: Sequence[Block]) -> int:
    """Which of other blocks a block stands on: number, or -1 if none is under its joint."""
    if block.cap is None:
        return -1
    cap = np.flatnonzero(block.cap)
    largest = cap[np.argsort(-np.round(block.mesh.areas[cap], 9), kind="stable")[:3]]
    for facet in largest:
        under = block.mesh.centroids[facet] - _UNDER_MM * block.base[3:]
        for number, other in enumerate(others):
            if other is block:
                continue
            low, high = other.mesh.bounds
            if (under >= low).all() and (under <= high).all() and solid_angle_turns(other.mesh.corners, under) > 0.5:
                return number
    return -1


def _centred(plane: Floats, mesh: Mesh, cap: Flags) -> Floats:
    """The plane with the middle of the cap as its point."""
    area = mesh.areas[cap]
    middle = (mesh.centroids[cap] * area[:, None]).sum(axis=0) / max(float(area.sum()), 1e-12)
    middle = middle - ((middle - plane[:3]) @ plane[3:]) * plane[3:]
    return np.concatenate([middle, plane[3:]])


def _kept(mask: Flags, source: NDArray[np.int64]) -> Flags:
    """Flags of facets carried over to what was cut from them."""
    return np.asarray((source >= 0) & mask[np.maximum(source, 0)])


def _why(ways: Ways, member: Member, one: Taken) -> str:
    """Why a member is built by itself."""
    if one.path is not None:
        return f"cut where {member.joint_mm2:.0f} mm² carry it: its axis bends, layers turn with it"
    if one.hangs_mm2 > 0.5:
        return f"hangs less along its own direction: {one.hangs_mm2:.1f} mm² remain"
    return f"would hang on the first direction; along its own nothing hangs on the joint of {member.joint_mm2:.0f} mm²"
