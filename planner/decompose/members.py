"""Members of a part: bodies beyond planes through its seams, each of which may grow by itself along the plane's normal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planner.decompose.bores import Bore, hanging_bores
from planner.decompose.cutting import Body, PlaneCut
from planner.decompose.direction import build_frame
from planner.decompose.hanging import Hanging, Limits, hanging
from planner.decompose.path import AxisPath, axis_path
from planner.decompose.seams import Seam
from planner.errors import PlanningError
from planner.mesh.mesh import Mesh
from planner.process import Settings

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_TURNED_COS = float(np.cos(np.radians(100.0)))
"""Of a direction against the first one: beyond, the plate is in the way."""
_SAME_DIRECTION = 1e-3
_ON_BASE_MM = 0.05  # facets within this of the base plane lie on it
_BEGIN = 0.08  # of the axis' length, over which its first direction is taken
_CORNER_DEG = 40.0  # off the base's direction: with the head tilted by that and the material's own lean the start still holds
_LEANS_FIRST = 0.3  # of what hangs: a bent bar leans more and more before its underside is level
_WORTH_MM2 = 0.5  # less is rounding
_MOST_PATHS = 6  # that are looked for in one part
_LEAST_BAR = 1.25  # length over width
_LEAST_SHARE = 1e-4  # of the part's volume: less is no member
_MOST_PLANES = 160  # that are cut in search of members


@dataclass(frozen=True)
class Ways:
    """What the search asks of a part again and again.

    limits : of the material   bores : round holes that are bored from the side afterwards, so that nothing hangs over them
    paths : what is known of bodies on their bases
    """

    mesh: Mesh
    settings: Settings
    limits: Limits
    bores: tuple[Bore, ...] = ()
    paths: dict[tuple[str, bytes], AxisPath | None] = field(default_factory=dict)

    @classmethod
    def of(cls, mesh: Mesh, settings: Settings) -> Ways:
        """For a part in its own frame."""
        return cls(mesh, settings, Limits.of(settings), _bores(mesh, settings))

    def spared(self, direction: Floats) -> Flags:
        """(m,) bool   Facets of bores whose mouth does not look against a direction."""
        mask = np.zeros(len(self.mesh.facets), dtype=np.bool_)
        for bore in self.bores:
            lean = float(bore.axis @ direction)
            if lean >= -1e-3 or (bore.is_through and lean <= 1e-3):
                mask[bore.facets] = True
        return mask

    def hanging(self, body: Body, base: Floats, cap: Flags | None) -> Hanging:
        """What hangs of a body cut from the part."""
        spared = self.spared(base[3:])[np.maximum(body.source, 0)] & (body.source >= 0)
        return hanging(body.mesh, base, cap, self.limits, spared)


@dataclass(frozen=True, eq=False)
class Member:
    """A body beyond a plane.

    plane : (6,) float, the direction is its normal   share : (m,) float, 0 … 1, of the area of each of the part's facets
    hangs : (m,) float, mm² of each of the part's facets that hang in it
    """

    plane: Floats
    share: Floats
    volume_mm3: float
    joint_mm2: float
    hangs: Floats
    tilted_mm2: float
    body: Body = field(repr=False)

    @property
    def direction(self) -> Floats:
        """(3,) float   In which it grows."""
        return self.plane[3:]


def members(ways: Ways, lines: Sequence[Seam], directions: Sequence[Floats], needed: Floats) -> list[Member]:
    """The members beyond planes through the far ends of seams, across each of the directions and of the seam's own.

    needed : (m,) float   where something hangs in some first direction, or leans: only members that hold some are wanted.
    """
    found = []
    for plane in _planes(ways.mesh, lines, directions):
        try:
            cut = PlaneCut(ways.mesh, plane)
        except PlanningError:
            continue
        for number in range(cut.count):
            mine = cut.label == number
            if needed[mine].sum() <= 0.0:
                continue
            member = _member(ways, cut, number)
            if member is not None:
                found.append(member)
    return found


def _member(ways: Ways, cut: PlaneCut, number: int) -> Member | None:
    """One body beyond a plane; None if it is too small or touches nothing."""
    body = cut.above(number)
    cap = body.source < 0
    volume = body.mesh.volume
    if volume < _LEAST_SHARE * ways.mesh.volume or not cap.any():
        return None
    count = len(ways.mesh.facets)
    own = body.source[~cap]
    area = np.bincount(own, weights=body.mesh.areas[~cap], minlength=count)
    share = np.clip(area / np.maximum(ways.mesh.areas, 1e-12), 0.0, 1.0)
    stands = ways.hanging(body, cut.plane, cap)
    hangs = np.bincount(own, weights=stands.weights[~cap], minlength=count).astype(np.float64)
    return Member(cut.plane, share, volume, cut.cap_mm2(number), hangs, stands.tilted_mm2, body)


def may_bend(mesh: Mesh, joint_mm2: float, hangs_mm2: float, tilted_mm2: float) -> bool:
    """Whether it is worth to look for a path.

    The body leans before it hangs, and its bulk is that of a bar on its joint, bent by no more than half a turn and longer
    than wide.
    """
    if joint_mm2 <= 0.0 or tilted_mm2 < max(_LEANS_FIRST * hangs_mm2, _WORTH_MM2):
        return False
    volume_mm3, diagonal_mm = mesh.volume, mesh.diagonal
    length = volume_mm3 / joint_mm2
    width = 2.0 * float(np.sqrt(joint_mm2 / np.pi))
    return _LEAST_BAR * width < length < 0.5 * np.pi * diagonal_mm


def path_on(body: Body, base: Floats, ways: Ways) -> AxisPath | None:
    """Planes along the axis of a body that stands on a base plane.

    None if the recipe wants none, they cannot follow the axis, it leaves the base at a corner or ends in nearly the direction
    in which it began, or something would hang on the turned planes as well.
    """
    recipe = ways.settings.recipe
    if recipe.axis_layers == "never" or recipe.process == "mill":
        return None
    key = (body.mesh.sha256, np.round(base, 6).tobytes())
    if key not in ways.paths:
        ways.paths[key] = _turning(body, base, ways) if len(ways.paths) < _MOST_PATHS else None
    return ways.paths[key]


def _turning(body: Body, base: Floats, ways: Ways) -> AxisPath | None:
    """As `path_on`, looked for."""
    facts = ways.settings.material.deposition
    found = axis_path(
        body.mesh,
        base,
        layer_min_mm=facts.layer_height_mm.min,
        layer_max_mm=facts.layer_height_mm.max,
        max_ratio=facts.max_layer_ratio,
    )
    if not isinstance(found, AxisPath):
        return None
    if _angle_deg(found.planes[0, 3:], found.planes[-1, 3:]) <= ways.limits.upright_deg or _starts_off(found, base):
        return None
    if _hangs_along(body, found, base, ways) > ways.limits.patch_mm2:
        return None
    return found


def _starts_off(path: AxisPath, base: Floats) -> bool:
    """Whether the axis leaves the base at a corner, not in a bend."""
    steps = np.linalg.norm(np.diff(path.axis, axis=0), axis=1)
    begin = int(np.searchsorted(np.cumsum(steps), _BEGIN * steps.sum())) + 1
    return _angle_deg(path.axis[begin] - path.axis[0], base[3:]) > _CORNER_DEG


def _angle_deg(first: Floats, second: Floats) -> float:
    cosine = first @ second / max(float(np.linalg.norm(first) * np.linalg.norm(second)), 1e-12)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _hangs_along(body: Body, path: AxisPath, base: Floats, ways: Ways) -> float:
    """Area, mm², of undersides against the nearest plane's direction, off the base and outside bores."""
    mesh = body.mesh
    _, nearest = cKDTree(path.planes[:, :3]).query(mesh.centroids)
    facing = (mesh.normals * path.planes[nearest, 3:]).sum(axis=1)
    over = np.abs((mesh.corners - base[:3]) @ base[3:]).max(axis=1) > _ON_BASE_MM
    hangs = over & (facing < -np.sin(np.radians(ways.limits.tilted_deg)))
    spared = ways.spared(base[3:])[np.maximum(body.source, 0)] & (body.source >= 0)
    return float(mesh.areas[hangs & ~spared].sum())


def distinct(directions: Sequence[Floats]) -> list[Floats]:
    """Directions without repetitions, the first of each kind."""
    kept: list[Floats] = []
    for direction in directions:
        if all(np.abs(direction - other).max() > _SAME_DIRECTION for other in kept):
            kept.append(direction)
    return kept


def _planes(mesh: Mesh, lines: Sequence[Seam], directions: Sequence[Floats]) -> list[Floats]:
    """Planes across directions through the farthest point of each seam: (6,) each, at most `_MOST_PLANES`, no two alike."""
    found: list[Floats] = []
    seen: set[tuple[float, ...]] = set()
    middle = mesh.bounds.mean(axis=0)
    for line in lines:
        own = [] if line.normal is None else [line.normal, -line.normal]
        for direction in distinct([*directions, *own]):
            along = line.points @ direction
            level = float(along.max())
            key = tuple(np.round([*direction, level - float(middle @ direction)], 3).tolist())
            if key in seen:
                continue
            seen.add(key)
            foot = line.points[int(np.argmax(np.round(along, 6)))]
            found.append(np.concatenate([foot, direction]))
    return found[:_MOST_PLANES]


def _bores(mesh: Mesh, settings: Settings) -> tuple[Bore, ...]:
    """Round holes that are bored from the side where they would hang: each in the part's frame, once."""
    if settings.recipe.process != "hybrid":
        return ()
    found: dict[int, Bore] = {}
    for axis in np.eye(3):
        frame = build_frame(mesh, axis)
        part_from_frame = np.linalg.inv(frame)
        for bore in hanging_bores(mesh.transformed(frame), settings.material.deposition.max_overhang_deg, settings.recipe.crease_deg):
            turned = part_from_frame[:3, :3]
            mouth = turned @ bore.mouth + part_from_frame[:3, 3]
            here = Bore(mouth, turned @ bore.axis, bore.radius_mm, bore.depth_mm, bore.is_through, bore.facets)
            found.setdefault(int(bore.facets.min()), here)
    return tuple(found[key] for key in sorted(found))
