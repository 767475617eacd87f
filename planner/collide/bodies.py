"""The bodies of a cell as convex solids on carriers: what its file draws, tools, plate and clamps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Tool
from config.machine import Clamps, Solid
from planner.collide.convex import BOX, FRUSTUM, HULL, ROUNDED
from planner.errors import PostError
from planner.mesh.load import load

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PLATE = "plate"
_EDGES = {0: (), 2: ((1.0, 0.0), (-1.0, 0.0)), 4: ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))}
_CONVEX_MM = 1e-3  # of a corner of a mesh outside a facet's plane
_UPRIGHT = np.eye(3)


@dataclass(frozen=True)
class Body:
    """One convex solid.

    kind, size, points : see `planner.collide.convex`   pose : (3, 4) float, machine frame at all joints zero from its own
    tool : number of the cutter that it belongs to, 0: always there   is_flutes : it may touch what it cuts
    """

    name: str
    carrier: int
    kind: int
    size: tuple[float, float, float]
    pose: Floats
    points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    tool: int = 0
    is_flutes: bool = False

    def sphere(self) -> tuple[Floats, float]:
        """Centre, own frame, and radius (mm) of a ball that holds it."""
        a, b, c = self.size
        if self.kind == BOX:
            return np.zeros(3), float(np.linalg.norm(self.size))
        if self.kind == HULL:
            centre = 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))
            return centre, float(np.linalg.norm(self.points - centre, axis=1).max())
        low, high = (a, b) if self.kind == FRUSTUM else (a, a)
        middle = float(np.clip(0.5 * c + 0.5 * (high * high - low * low) / c, 0.0, c))
        return np.array([0.0, 0.0, middle]), float(max(np.hypot(low, middle), np.hypot(high, c - middle)))


class Packed(NamedTuple):
    """Bodies for kernels.

    kind, carrier : (n,)   size : (n, 3)   pose : (n, 3, 4)   first, last : (n,) rows of `points` (m, 3), own frame
    centre : (n, 3) mm, own frame, of the ball that holds it   radius : (n,) mm
    """

    kind: Ints
    carrier: Ints
    size: Floats
    pose: Floats
    first: Ints
    last: Ints
    points: Floats
    centre: Floats
    radius: Floats

    @classmethod
    def of(cls, bodies: Iterable[Body]) -> Packed:
        """The same in arrays."""
        given = list(bodies)
        last = np.cumsum([len(body.points) for body in given], dtype=np.int64)
        balls = [body.sphere() for body in given]
        return cls(
            np.array([body.kind for body in given], dtype=np.int64),
            np.array([body.carrier for body in given], dtype=np.int64),
            np.array([body.size for body in given], dtype=np.float64).reshape(-1, 3),
            np.array([body.pose for body in given], dtype=np.float64).reshape(-1, 3, 4),
            last - np.array([len(body.points) for body in given], dtype=np.int64),
            last,
            np.ascontiguousarray(np.concatenate([np.empty((0, 3)), *(body.points for body in given)])),
            np.array([centre for centre, _ in balls], dtype=np.float64).reshape(-1, 3),
            np.array([radius for _, radius in balls], dtype=np.float64),
        )


def bodies_of(cell: Cell, carriers: dict[str, int], plate: Body) -> list[Body]:
    """All bodies of a cell that has a `machine`, with its plate and the clamps on it.

    Raises PostError for an STL that is no closed mesh, and for a carrier that the cell has not.
    """
    assert cell.machine is not None
    bodies = [body for solid in cell.machine.solids for body in _drawn(solid, carriers)]
    heads = sum(tool.kind == "deposition" for tool in cell.tools)
    for tool in cell.tools:
        if tool.kind == "deposition":
            bodies += head_bodies(tool, carriers["head_slide"], f" {tool.number}" if heads > 1 else "")
        else:
            bodies += cutter_bodies(tool, carriers["spindle"])
    return [*bodies, plate, *_clamps(cell.machine.clamps, plate)]


def plate_body(size_mm: tuple[float, float, float], carrier: int, table_from_build: Floats) -> Body:
    """The plate: its top is z = 0 of the build frame, its middle under that frame's origin.  size_mm : x, y, thickness"""
    middle = table_from_build[:3, 3] - table_from_build[:3, 2] * 0.5 * size_mm[2]
    half = (0.5 * size_mm[0], 0.5 * size_mm[1], 0.5 * size_mm[2])
    return Body(PLATE, carrier, BOX, half, _pose(table_from_build[:3, :3], middle))


def head_bodies(tool: Tool, carrier: int, mark: str = "") -> list[Body]:
    """Cone and body of a deposition head, from its focus upwards."""
    x, y, z = tool.tip_mm
    shape, wide = tool.nozzle, 0.5 * tool.holder_diameter_mm
    end = z + shape.standoff_mm
    cone = (0.5 * shape.end_diameter_mm, wide, shape.cone_length_mm)
    return [
        Body(f"nozzle{mark}", carrier, FRUSTUM, cone, _pose(_UPRIGHT, (x, y, end))),
        Body(f"head body{mark}", carrier, FRUSTUM, (wide, wide, shape.body_length_mm), _pose(_UPRIGHT, (x, y, end + shape.cone_length_mm))),
    ]


def cutter_bodies(tool: Tool, carrier: int) -> list[Body]:
    """Flutes, shank and holder of a cutter; the holder ends at the gauge line."""
    x, y, z = tool.tip_mm
    radius, holder = 0.5 * tool.diameter_mm, 0.5 * tool.holder_diameter_mm
    shank = radius if tool.shank_diameter_mm is None else 0.5 * tool.shank_diameter_mm
    flutes = min(tool.flute_length_mm or tool.stickout, tool.stickout)
    edge = radius if tool.kind == "ball_mill" else min(tool.corner_radius_mm, radius)
    name = f"T{tool.number}"
    bodies = [Body(f"{name} flutes", carrier, ROUNDED, (radius, edge, flutes), _pose(_UPRIGHT, tool.tip_mm), tool=tool.number, is_flutes=True)]
    for what, wide, low, high in (("shank", shank, flutes, tool.stickout), ("holder", holder, tool.stickout, -z)):
        if high > low:
            pose = _pose(_UPRIGHT, (x, y, z + low))
            bodies.append(Body(f"{name} {what}", carrier, FRUSTUM, (wide, wide, high - low), pose, tool=tool.number))
    return bodies


def _clamps(clamps: Clamps, plate: Body) -> list[Body]:
    """Toe clamps over the middles of the plate's edges."""
    half = np.array(plate.size)
    top, bottom = half[2] + clamps.above_mm, -half[2]
    bodies = []
    for number, (x, y) in enumerate(_EDGES[clamps.count], start=1):
        edge = abs(x) * half[0] + abs(y) * half[1] + 0.5 * (clamps.outside_mm - clamps.overlap_mm)
        middle = plate.pose[:, :3] @ np.array([x * edge, y * edge, 0.5 * (top + bottom)]) + plate.pose[:, 3]
        deep, wide = 0.5 * (clamps.overlap_mm + clamps.outside_mm), 0.5 * clamps.width_mm
        size = (deep if x else wide, wide if x else deep, 0.5 * (top - bottom))
        bodies.append(Body(f"clamp {number}", plate.carrier, BOX, size, _pose(plate.pose[:, :3], middle)))
    return bodies


def _drawn(solid: Solid, carriers: dict[str, int]) -> list[Body]:
    """A solid of the file; a mesh that is not convex becomes one body for each facet."""
    if solid.carrier not in carriers:
        raise PostError(f"machine.solids {solid.name}: the cell has no axis {solid.carrier}", f"carriers: {', '.join(carriers)}")
    carrier = carriers[solid.carrier]
    if solid.shape == "box":
        assert solid.size_mm is not None
        half = (0.5 * solid.size_mm[0], 0.5 * solid.size_mm[1], 0.5 * solid.size_mm[2])
        return [Body(solid.name, carrier, BOX, half, _pose(_turned(solid.turn_deg), solid.at_mm))]
    if solid.shape == "stl":
        pose = _pose(_turned(solid.turn_deg), solid.at_mm)
        return [Body(solid.name, carrier, HULL, (0.0, 0.0, 0.0), pose, points) for points in _pieces(solid.file)]
    assert solid.diameter_mm is not None and solid.length_mm is not None
    end = solid.diameter_mm if solid.end_diameter_mm is None else solid.end_diameter_mm
    size = (0.5 * solid.diameter_mm, 0.5 * end, solid.length_mm)
    return [Body(solid.name, carrier, FRUSTUM, size, _pose(_towards(np.array(solid.axis)), solid.at_mm))]


def _pieces(path: str) -> list[Floats]:
    """Corners of a mesh if it is convex, else of each of its facets: (k, 3) float, mm, each."""
    mesh = load(path, "mm")
    corners = mesh.corners
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    points = np.unique(corners.reshape(-1, 3), axis=0)
    if all(((points @ n).max() - c @ n) <= _CONVEX_MM for n, c in zip(normal, corners[:, 0], strict=True)):
        return [np.ascontiguousarray(points)]
    return [np.ascontiguousarray(facet) for facet in corners]


def _pose(rotation: Floats, at: Iterable[float]) -> Floats:
    return np.ascontiguousarray(np.column_stack([rotation, np.array(list(at), dtype=np.float64)]))


def _turned(turn_deg: tuple[float, float, float]) -> Floats:
    """(3, 3) float: about x, then y, then z of the machine."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]])
    about_y = np.array([[cb, 0.0, sb], [0.0, 1.0, 0.0], [-sb, 0.0, cb]])
    about_z = np.array([[cc, -sc, 0.0], [sc, cc, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_z @ about_y @ about_x)


def _towards(axis: Floats) -> Floats:
    """(3, 3) float: a rotation that brings z to a unit vector."""
    side = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(side, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
