"""What stands when a piece is made, seen from the piece's frame: finished pieces before it and the substrate."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.collide.points import PointTree, surface_points
from planner.decompose.pieces import Piece
from planner.decompose.solids import mesh_of_solid, polygons, silhouette, solid_of
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.slicing.regions import LayerRegion, layer_regions
from planner.toolpath.holder import holder_radius_mm, stickout_mm
from planner.toolpath.roughing import box_mesh

Floats = NDArray[np.float64]

_PLATE_MM = 10.0  # thickness of an ordinary plate
_TABLE_MM = 240.0  # diameter of an ordinary rotary table, which lies under the plate
_ROUND = 72  # sides of what stands for it
_BESIDE_TABLE_MM = 0.5  # room between its rim and a holder
_COARSE_MM = 5.0  # between points of plate and table: the head's curves are wider than that
_PITCH_MM = 1.5  # of points all over what stands
_TOUCH_MM = 0.02  # metal this little above the cutter's end is touched, not cut
_GRID_MM = 1e-3  # heights nearer than this are one


class Standing:
    """Everything that is there before a piece, in the frame of that piece (z = 0 its base plane, z up its direction).

    meshes : of the finished pieces, closed, mm, piece frame   plate, table : what they are clamped to
    """

    def __init__(self, meshes: Sequence[Mesh], plate: Mesh, table: Mesh) -> None:
        self.meshes = tuple(meshes)
        self.plate, self.table = plate, table
        self._solids = [solid_of(mesh) for mesh in (*meshes, plate, table)]
        self._shadows: dict[float, MultiPolygon] = {}

    @classmethod
    def before(cls, pieces: Sequence[Piece], number: int, substrate_mm: tuple[float, float]) -> Standing:
        """What stands before piece `number` of a division is begun.  substrate_mm : size of the plate, x and y."""
        piece_from_build = np.linalg.inv(pieces[number].build_from_piece)
        half = 0.5 * np.array(substrate_mm)
        plate = box_mesh(np.array([-half[0], -half[1], -_PLATE_MM]), np.array([half[0], half[1], 0.0]))
        round_mm = 0.5 * _TABLE_MM / np.cos(np.pi / _ROUND) + _BESIDE_TABLE_MM
        drum = manifold3d.Manifold.cylinder(_PLATE_MM, round_mm, circular_segments=_ROUND)
        table = mesh_of_solid(drum.translate((0.0, 0.0, -2.0 * _PLATE_MM)))
        return cls(
            [piece.mesh.transformed(piece_from_build) for piece in pieces[:number]],
            plate.transformed(piece_from_build),
            table.transformed(piece_from_build),
        )

    @property
    def top_mm(self) -> float:
        """Highest point of what stands above the base plane, mm; 0 where nothing does."""
        return max(0.0, *(float(mesh.bounds[1, 2]) for mesh in (*self.meshes, self.plate, self.table)))

    def shadow(self, z: float) -> MultiPolygon:
        """What stands above a height, projected along z, mm."""
        level = round(z / _GRID_MM) * _GRID_MM
        if level not in self._shadows:
            found = [
                silhouette(solid.trim_by_plane((0.0, 0.0, 1.0), level + _TOUCH_MM))
                for solid in self._solids
                if solid.bounding_box()[5] > level + _TOUCH_MM
            ]
            self._shadows[level] = polygons(shapely.union_all(found)) if found else MultiPolygon()
        return self._shadows[level]

    def keep_out(self, z: float, settings: Settings) -> MultiPolygon:
        """Where the centre of an upright cutter must not go with its end at a height, mm: flutes, and the holder above."""
        near = shapely.buffer(self.shadow(z), settings.cutter_radius_mm - _TOUCH_MM, quad_segs=32)
        high = shapely.buffer(self.shadow(z + stickout_mm(settings)), holder_radius_mm(settings) - _TOUCH_MM, quad_segs=32)
        return polygons(shapely.union(near, high))

    def seen_from(self, frame_from_piece: Floats) -> Standing:
        """The same in another frame.  frame_from_piece : (4, 4) float, rigid"""
        return Standing(
            [mesh.transformed(frame_from_piece) for mesh in self.meshes],
            self.plate.transformed(frame_from_piece),
            self.table.transformed(frame_from_piece),
        )

    def height_over(self, region: MultiPolygon, beside_mm: float) -> float:
        """How high what stands reaches over the hull of a region and a distance beside it, mm; 0 where nothing does."""
        reach = shapely.buffer(region.convex_hull, beside_mm)
        low, high = 0.0, self.top_mm
        if high <= 0.0 or not shapely.intersects(self.shadow(0.0), reach):
            return 0.0
        while high - low > 0.5:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if shapely.intersects(self.shadow(middle), reach) else (low, middle)
        return high

    @cached_property
    def points(self) -> Floats:
        """(n, 3) float, mm   Points all over what stands, closer than any tool is wide, piece frame."""
        near = [surface_points(mesh, _PITCH_MM) for mesh in self.meshes]
        return np.vstack([*near, surface_points(self.plate, _COARSE_MM), surface_points(self.table, _COARSE_MM)])

    @cached_property
    def tree(self) -> PointTree:
        """The same, for many questions."""
        return PointTree.over(self.points)

    def height_of_points(self, layer_from_piece: Floats, region: MultiPolygon, beside_mm: float) -> float:
        """As `height_over`, in the frame of a layer that turns, to the pitch of points."""
        points = self.points @ layer_from_piece[:3, :3].T + layer_from_piece[:3, 3]
        points = points[points[:, 2] > _PITCH_MM]
        reach = shapely.buffer(region.convex_hull, beside_mm + _PITCH_MM)
        low_x, low_y, high_x, high_y = reach.bounds
        near = (points[:, 0] > low_x) & (points[:, 0] < high_x) & (points[:, 1] > low_y) & (points[:, 1] < high_y)
        points = points[near]
        over = shapely.contains_xy(reach, points[:, 0], points[:, 1])
        return float(points[over, 2].max()) + _PITCH_MM if over.any() else 0.0

    def layers_under(self, depth_mm: float, height_mm: float) -> list[LayerRegion]:
        """What stands under the base plane as layers of a height down to a depth, from the lowest; none on the plate alone."""
        if not self.meshes:
            return []
        count = max(1, int(np.ceil(depth_mm / height_mm - 1e-9)))
        return layer_regions(merged(self.meshes), np.linspace(-count * height_mm, 0.0, count + 1))


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several closed meshes as one, body by body."""
    at = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.vstack([mesh.vertices for mesh in meshes]),
        np.vstack([mesh.facets + start for mesh, start in zip(meshes, at, strict=False)]),
    )
