"""The order in which blocks are built: parents first, few set-ups, and each reached past what stands by then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.collide.reach import PLATE, CutterShape, HeadShape, PointTree, Shape, reach, surface_points
from planner.decompose.blocks import Block
from planner.decompose.corners import used_vertices
from planner.mesh.mesh import Mesh
from planner.process import Settings

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SAME_COS = 0.9999
_TIPS = 160  # of a block that are looked at, for each tool
_PITCH_MM = 1.5  # of what stands; a bead is wider
_CELL = 1.0 / 3.0  # of the pitch
_TILTS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0)
_ROUND = 8  # ways in which the tool may lean
_GAP_MM = 0.3  # a tool that is nearer touches
_BLOCKED = 0.04  # of the tips: fewer lie in corners beside the joint that no tool fills to the last bead
_SIDEWAYS = 0.6  # least horizontal share of a direction in which the plate is beside the head
_RIM_MM = 3.0  # of the plate that stays free beside the part
_ABOVE_MM = 0.8  # over the joint: the first layer beside what it stands on


@dataclass(frozen=True)
class Blocked:
    """What keeps the tools from a block: `share` of its places, most of them by another block, or -1: the plate."""

    number: int
    by: int
    tool: str
    share: float


class Standing:
    """Blocks in the build frame as obstacles and as places to reach."""

    def __init__(self, blocks: Sequence[Block], build_from_part: Floats, settings: Settings) -> None:
        self._settings = settings
        turn = build_from_part[:3, :3]
        shift = build_from_part[:3, 3] + _towards_edge(blocks, build_from_part, settings.recipe.substrate_mm)
        self._points = [_surface(block.mesh) @ turn.T + shift for block in blocks]
        self._tips = [_tips(block, turn, shift) for block in blocks]
        self._plate = settings.recipe.substrate_mm

    def blocked(self, number: int, standing: Sequence[int]) -> Blocked | None:
        """What keeps head or cutter from a block when others stand; None if they reach it."""
        owner = np.concatenate([np.full(len(self._points[n]), n) for n in standing]) if standing else np.empty(0, np.int64)
        points = np.concatenate([self._points[n] for n in standing]) if standing else np.empty((0, 3))
        tree = PointTree.over(points)
        tips, axes, normals = self._tips[number]
        worst = self._tool(number, "head", tips, axes, HeadShape(), tree, owner)
        if worst is None and self._settings.is_milled:
            radius = (self._settings.with_small_cutter() or self._settings).cutter_radius_mm
            lies = np.abs((normals * axes).sum(axis=1)) < 0.7
            beside = tips[lies] + (radius + _GAP_MM) * normals[lies]
            worst = self._tool(number, "cutter", beside, axes[lies], CutterShape(radius_mm=radius), tree, owner)
        return worst

    def _tool(
        self, number: int, name: str, tips: Floats, axes: Floats, shape: Shape, tree: PointTree, owner: NDArray[np.int64]
    ) -> Blocked | None:
        """Whether a tool comes to all places, leaning as far as the material allows."""
        count = len(tips)
        met = np.full(count, PLATE)
        left = np.arange(count)
        for tilt in _TILTS_DEG:
            if tilt > self._settings.material.deposition.max_tilt_deg:
                break
            for way in range(_ROUND if tilt else 1):
                if not len(left):
                    return None
                found = reach(
                    tips[left], _leaning(axes[left], tilt, 360.0 * way / _ROUND), tree, self._plate, shape, enough_mm=_GAP_MM
                )
                if not tilt:
                    near = found.nearest
                    met[left] = np.where(near >= 0, owner[np.maximum(near, 0)] if len(owner) else PLATE, PLATE)
                left = left[~found.free]
        if len(left) <= _BLOCKED * count:
            return None
        names, times = np.unique(met[left], return_counts=True)
        return Blocked(number, int(names[int(np.argmax(times))]), name, len(left) / count)


def _surface(mesh: Mesh) -> Floats:
    """(n, 3) float, mm   Points of a mesh's surface, one in each cell of a grid: large facets sampled, small ones by their corners."""
    longest = np.linalg.norm(np.roll(mesh.corners, -1, axis=1) - mesh.corners, axis=2).max(axis=1)
    is_small = longest <= _PITCH_MM
    corners = mesh.vertices[used_vertices(Mesh(mesh.vertices, mesh.facets[is_small]))]
    points = np.concatenate([surface_points(Mesh(mesh.vertices, mesh.facets[~is_small]), _PITCH_MM), corners])
    cells = np.floor(points / (_CELL * _PITCH_MM)).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    _, first = np.unique(cells @ [1 << 40, 1 << 20, 1], return_index=True)
    return np.asarray(points[np.sort(first)])


def build_order(blocks: Sequence[Block], parents: Sequence[int], standing: Standing) -> tuple[list[int], list[Blocked]]:
    """Numbers of blocks in the order of building, and what is not reached in it.

    The first block is number 0. Next comes a block whose parent stands and which is reached: of the direction in use if there
    is one, else of the direction of most volume; the one nearest to the plate first, then by place.
    """
    order, found = [0], []
    first = standing.blocked(0, [])
    if first is not None:
        found.append(first)
    left = list(range(1, len(blocks)))
    while left:
        ready = [n for n in left if parents[n] in order or parents[n] < 0]
        if not ready:
            ready = left[:1]
        ranked = _ranked(ready, blocks, blocks[order[-1]].base[3:])
        hindered: list[Blocked] = []
        for number in ranked:
            blocked = standing.blocked(number, order)
            if blocked is None:
                chosen = number
                break
            hindered.append(blocked)
        else:
            least = min(hindered, key=lambda one: one.share)
            found.append(least)
            chosen = least.number
        order.append(chosen)
        left.remove(chosen)
    return order, found


def _ranked(ready: list[int], blocks: Sequence[Block], now: Floats) -> list[int]:
    """Blocks that may come next, the best first."""
    groups: list[list[int]] = []
    for number in ready:
        direction = blocks[number].base[3:]
        for group in groups:
            if float(direction @ blocks[group[0]].base[3:]) > _SAME_COS:
                group.append(number)
                break
        else:
            groups.append([number])
    groups.sort(
        key=lambda group: (
            float(now @ blocks[group[0]].base[3:]) <= _SAME_COS,
            -round(sum(blocks[n].mesh.volume for n in group), 1),
            tuple((-np.round(blocks[group[0]].base[3:], 4)).tolist()),
        )
    )
    return [number for group in groups for number in sorted(group, key=lambda n: _place(blocks[n]))]


def _place(block: Block) -> tuple[float, ...]:
    """Height of the joint along its direction, then the joint's place, to a hundredth of a millimetre."""
    return (round(float(block.base[:3] @ block.base[3:]), 2), *np.round(block.base[:3], 2).tolist())


def _towards_edge(blocks: Sequence[Block], build_from_part: Floats, plate: tuple[float, float]) -> Floats:
    """(3,) float, mm   Shift of the part to the edge of its plate over which most metal grows sideways."""
    turn = build_from_part[:3, :3]
    pull = np.zeros(2)
    for block in blocks[1:]:
        flat = (turn @ block.base[3:])[:2]
        if np.linalg.norm(flat) > _SIDEWAYS:
            pull += np.where(np.abs(flat) > 0.5 * _SIDEWAYS, np.sign(flat), 0.0) * block.mesh.volume
    foot = blocks[0].mesh.vertices @ turn.T + build_from_part[:3, 3]
    reach_mm = np.where(pull > 0.0, foot[:, :2].max(axis=0), -foot[:, :2].min(axis=0))
    room = np.maximum(0.5 * np.array(plate) - _RIM_MM - reach_mm, 0.0)
    return np.append(np.sign(np.round(pull, 6)) * room, 0.0)


def _tips(block: Block, turn: Floats, shift: Floats) -> tuple[Floats, Floats, Floats]:
    """Places on a block's surface, the tool's axis at each and the surface's normal, (n, 3) each, build frame.

    Places lie at the middles of facets, spread over the surface by area.
    """
    mesh, base = block.mesh, block.base
    height = (mesh.centroids - base[:3]) @ base[3:]
    able = (height > _ABOVE_MM) & (mesh.areas > 0.0)
    if not able.any():
        able = mesh.areas > 0.0
    rows = np.flatnonzero(able)
    order = rows[np.lexsort(np.round(mesh.centroids[rows], 3).T)]
    total = np.cumsum(mesh.areas[order])
    wanted = (np.arange(_TIPS) + 0.5) / _TIPS * total[-1]
    chosen = order[np.minimum(np.searchsorted(total, wanted), len(order) - 1)]
    golden = (np.arange(_TIPS) * 0.6180339887498949) % 1.0, (np.arange(_TIPS) * 0.7548776662466927) % 1.0
    root = np.sqrt(golden[0])
    weights = np.column_stack([1.0 - root, root * (1.0 - golden[1]), root * golden[1]])
    tips = np.einsum("ij,ijk->ik", weights, mesh.corners[chosen])
    lifted = np.maximum((tips - base[:3]) @ base[3:], 0.0)
    tips = tips + np.maximum(_ABOVE_MM - lifted, 0.0)[:, None] * base[3:]
    axes = np.tile(base[3:], (_TIPS, 1))
    if block.path is not None:
        planes = block.path.planes
        apart = np.linalg.norm(tips[:, None] - planes[None, :, :3], axis=2)
        axes = planes[np.argmin(apart, axis=1), 3:]
    return tips @ turn.T + shift, axes @ turn.T, mesh.normals[chosen] @ turn.T


def _leaning(axes: Floats, tilt_deg: float, way_deg: float) -> Floats:
    """Axes turned off by an angle towards one side.  (n, 3) float, unit."""
    if not tilt_deg:
        return axes
    helper = np.where(np.abs(axes[:, :1]) < 0.9, np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    first = np.cross(axes, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(axes, first)
    tilt, way = np.radians(tilt_deg), np.radians(way_deg)
    return np.asarray(np.cos(tilt) * axes + np.sin(tilt) * (np.cos(way) * first + np.sin(way) * second))
