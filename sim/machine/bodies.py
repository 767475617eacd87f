"""The machine's solids packed into arrays for kernels: poses, sizes, corners, and what bounds them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.machine.facets import Shell, facets_distance
from sim.machine.shapes import BOX, FRUSTUM, HULL, MESH, box_distance, frustum_distance

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Body:
    """One solid. size : see `sim.machine.shapes`; pose : (3, 4), machine frame at all joints zero from its own frame, mm."""

    name: str
    carrier: int
    kind: int
    size: tuple[float, float, float]
    pose: Array
    shell: Shell | None = None
    cuts: bool = field(default=False)
    tool: int = field(default=0)

    def sphere(self) -> tuple[Array, float]:
        """Centre, machine frame at all joints zero, and radius of a sphere that holds the solid, mm."""
        if self.kind == BOX:
            centre, radius = np.zeros(3), float(np.linalg.norm(self.size))
        elif self.kind == FRUSTUM:
            low, high, length = self.size
            middle = min(length, max(0.0, 0.5 * length + 0.5 * (high * high - low * low) / length))
            centre = np.array([0.0, 0.0, middle])
            radius = max(float(np.hypot(low, middle)), float(np.hypot(high, length - middle)))
        else:
            assert self.shell is not None
            centre = 0.5 * (self.shell.hull.min(axis=0) + self.shell.hull.max(axis=0))
            radius = float(np.linalg.norm(self.shell.hull - centre, axis=1).max())
        return self.pose[:, :3] @ centre + self.pose[:, 3], radius


class Bodies(NamedTuple):
    """All solids. Ranges are first and last (exclusive) rows of the arrays behind them.

    kind, carrier : (n,)   size : (n, 3) mm   pose : (n, 3, 4)   centre : (n, 3) mm, machine frame at zero   radius : (n,) mm
    hull : (n, 2) range of points   facet : (n, 2) range of facets; corner c of facet f is points[corner0 + 3 f + c]
    node : (n, 2) range of boxes and nodes (whose facets and children count from the body's first)
    """

    kind: Index
    carrier: Index
    size: Array
    pose: Array
    centre: Array
    radius: Array
    hull: Index
    facet: Index
    node: Index
    points: Array
    corners: Array
    normals: Array
    boxes: Array
    nodes: Index


def pack(bodies: list[Body]) -> Bodies:
    """Arrays of the solids, in their order. The corners of all facets follow the hulls' points in `points`."""
    shells = [body.shell for body in bodies]
    hulls = [shell.hull if shell else np.zeros((0, 3)) for shell in shells]
    normals = [shell.normals if shell else np.zeros((0, 7, 3)) for shell in shells]
    boxes = [shell.boxes if shell else np.zeros((0, 6)) for shell in shells]
    corners = [np.zeros((0, 3)), *(shell.corners for shell in shells if shell)]
    nodes = [np.zeros((0, 2), dtype=np.int64), *(shell.nodes for shell in shells if shell)]
    spheres = [body.sphere() for body in bodies]
    all_corners = np.concatenate(corners)
    return Bodies(
        kind=np.array([body.kind for body in bodies], dtype=np.int64),
        carrier=np.array([body.carrier for body in bodies], dtype=np.int64),
        size=np.array([body.size for body in bodies], dtype=np.float64).reshape(-1, 3),
        pose=np.array([body.pose for body in bodies], dtype=np.float64).reshape(-1, 3, 4),
        centre=np.array([centre for centre, _ in spheres], dtype=np.float64).reshape(-1, 3),
        radius=np.array([radius for _, radius in spheres], dtype=np.float64),
        hull=_ranges(hulls),
        facet=_ranges(normals),
        node=_ranges(boxes),
        points=np.concatenate([np.zeros((0, 3)), *hulls, all_corners]),
        corners=all_corners,
        normals=np.concatenate([np.zeros((0, 7, 3)), *normals]),
        boxes=np.concatenate([np.zeros((0, 6)), *boxes]),
        nodes=np.concatenate(nodes),
    )


def _ranges(parts: list[Array]) -> Index:
    """(n, 2) int   First and last (exclusive) row of each part, when they stand one behind the other."""
    last = np.cumsum([len(part) for part in parts], dtype=np.int64)
    return np.column_stack((np.concatenate(([0], last[:-1])) if len(last) else last, last)).astype(np.int64)


@njit(cache=True, nogil=True)
def corner_row(bodies: Bodies, facet: int) -> int:
    """Row of `points` with the first corner of a facet."""
    return int(bodies.points.shape[0] - bodies.corners.shape[0] + 3 * facet)


@njit(cache=True, nogil=True)
def body_distance(bodies: Bodies, b: int, x: float, y: float, z: float) -> float:
    """Signed distance of a point of body b's own frame, mm, negative inside."""
    kind = bodies.kind[b]
    if kind == BOX:
        return float(box_distance(bodies.size[b], x, y, z))
    if kind == FRUSTUM:
        return float(frustum_distance(bodies.size[b], x, y, z))
    first, last = bodies.facet[b, 0], bodies.facet[b, 1]
    rows = bodies.node[b]
    return float(
        facets_distance(
            bodies.corners[3 * first : 3 * last], bodies.normals[first:last], bodies.boxes[rows[0] : rows[1]],
            bodies.nodes[rows[0] : rows[1]], x, y, z,
        )
    )  # fmt: skip


@njit(cache=True, nogil=True)
def is_round(bodies: Bodies, b: int) -> bool:
    """Whether turning about its own axis leaves body b as it is."""
    return bool(bodies.kind[b] == FRUSTUM)


__all__ = ["BOX", "FRUSTUM", "HULL", "MESH", "Bodies", "Body", "body_distance", "corner_row", "is_round", "pack"]
