"""A direction from which a cutter comes: what it must keep off at each depth, and what of the metal it then reaches."""

from __future__ import annotations

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import MultiPolygon

from planner.decompose.solids import polygons, silhouette
from planner.process import Settings
from planner.slicing.section import plane_frame
from planner.toolpath.metal import Metal, region_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

STICK_OUT = 5.0
"""Of the cutter's diameter: how far an ordinary end mill stands out of its holder."""
HOLDER_RADIUS_MM = 16.0
HOLDER_CLEARANCE_MM = 1.0
_TOUCH_MM = 1e-3  # what stands this little above the cutter's end is touched, not cut
_KEY = 1e4  # heights are told apart to a ten-thousandth of a millimetre
_SLACK = 0.5  # of a cell: a raster does not tell more


class Access:
    """Everything seen along a direction: in its frame z points towards the tool.

    direction : (3,) float, unit, frame of the solids   frame_from : (4, 4) float, from theirs to this one
    part, plate : what must not be cut   metal : what is to be milled away   at : (n, 3) float, mm, its cells in this frame
    """

    def __init__(
        self,
        direction: Floats,
        part: manifold3d.Manifold,
        plate: manifold3d.Manifold,
        metal: Metal,
        settings: Settings,
    ) -> None:
        self.direction = np.asarray(direction, dtype=np.float64)
        self.settings = settings
        self.metal = metal
        self.frame_from = np.eye(4)
        self.frame_from[:3, :3] = plane_frame(np.concatenate([np.zeros(3), self.direction]))[1:]
        self._part = part.transform(self.frame_from[:3])
        self._plate = plate.transform(self.frame_from[:3])
        self._solid = metal.solid.transform(self.frame_from[:3])
        self._part_top, self._plate_top = (float(solid.bounding_box()[5]) for solid in (self._part, self._plate))
        self._part_shadows: dict[int, MultiPolygon] = {}
        self._shadows: dict[int, MultiPolygon] = {}
        self._rasters: dict[int, Flags] = {}
        box = self._solid.bounding_box()
        self.top_mm = max(self._part_top, self._plate_top, float(box[5]))
        self.high_mm = float(box[5])
        aside = 4.0 * settings.cutter_diameter_mm + HOLDER_RADIUS_MM
        self._window = shapely.box(box[0] - aside, box[1] - aside, box[3] + aside, box[4] + aside)
        self.at = metal.points @ self.frame_from[:3, :3].T + self.frame_from[:3, 3]
        margin = settings.cutter_diameter_mm + 2.0 * metal.pitch_mm
        self._low = np.array(box[:2]) - margin
        self._shape = tuple(np.ceil((np.array(box[3:5]) + margin - self._low) / metal.pitch_mm).astype(int).tolist())
        self._cells = tuple(np.floor((self.at[:, :2] - self._low) / metal.pitch_mm).astype(np.int64).T)

    def part_shadow(self, z: float) -> MultiPolygon:
        """What of the part stands above a height, seen along the direction, near the metal, mm."""
        return self._seen(self._part_shadows, self._part, self._part_top, z)

    def shadow(self, z: float) -> MultiPolygon:
        """What of part and plate stands above a height, seen along the direction, near the metal, mm."""
        key = round(z * _KEY)
        if key not in self._shadows:
            plate = self._seen({}, self._plate, self._plate_top, z)
            self._shadows[key] = polygons(shapely.union(self.part_shadow(z), plate))
        return self._shadows[key]

    def _seen(
        self, known: dict[int, MultiPolygon], solid: manifold3d.Manifold, top_mm: float, z: float
    ) -> MultiPolygon:
        key = round(z * _KEY)
        if key not in known:
            level = key / _KEY + _TOUCH_MM
            seen = silhouette(solid.trim_by_plane((0.0, 0.0, 1.0), level)) if top_mm > level else MultiPolygon()
            known[key] = polygons(shapely.intersection(seen, self._window)) if not seen.is_empty else seen
        return known[key]

    def keep(self, z: float, left: MultiPolygon) -> MultiPolygon:
        """What the cutter must not cut with its end at a height, mm: what stands above it, metal left above it, and so much
        round what is as high as the holder that the holder stays clear.
        """
        radius = self.settings.cutter_radius_mm
        high = self.shadow(z + STICK_OUT * self.settings.cutter_diameter_mm)
        round_holder = shapely.buffer(high, HOLDER_RADIUS_MM + HOLDER_CLEARANCE_MM - radius, quad_segs=8)
        return polygons(shapely.union_all([self.shadow(z), round_holder, left]))

    def covered(self, chosen: Flags) -> MultiPolygon:
        """What some cells of the metal cover, seen along the direction, mm."""
        return region_of(self._raster(chosen), self._low, self.metal.pitch_mm)

    def between(self, low: float, high: float) -> MultiPolygon:
        """What the whole metal covers between two heights, mm."""
        slab = self._solid.trim_by_plane((0.0, 0.0, 1.0), low).trim_by_plane((0.0, 0.0, -1.0), -high)
        return silhouette(slab) if not slab.is_empty() else MultiPolygon()

    def reached(self, there: Flags, step_mm: float) -> Flags:
        """(n,) bool   What of the cells that are there a cutter reaches that goes down level by level; told to half a cell.

        At each level it keeps off what it would at its middle: terraces follow the part within a level.
        """
        radius, pitch = self.settings.cutter_radius_mm, self.metal.pitch_mm
        slack = _SLACK * pitch
        level = np.floor((self.high_mm - self.at[:, 2]) / step_mm).astype(np.int64)
        gone = np.zeros(len(there), dtype=np.bool_)
        left = np.zeros(self._shape, dtype=np.bool_)
        for number in np.unique(level[there]).tolist():
            rows = np.flatnonzero(there & (level == number))
            off = self._kept(self.high_mm - (number + 0.5) * step_mm) | left
            swept = np.ones(self._shape, dtype=np.bool_)
            if off.any():
                free = ndimage.distance_transform_edt(~off) * pitch >= radius - slack
                swept[:] = False
                if free.any():
                    swept = ndimage.distance_transform_edt(~free) * pitch <= radius + slack
            gone[rows] = swept[self._cells[0][rows], self._cells[1][rows]]
            missed = rows[~gone[rows]]
            left[self._cells[0][missed], self._cells[1][missed]] = True
        return gone

    def swept(self, rows: NDArray[np.int64], keep: MultiPolygon) -> Flags:
        """(k,) bool   Which of some cells a cutter that keeps off goes over, of exact regions."""
        if keep.is_empty:
            return np.ones(len(rows), dtype=np.bool_)
        x, y = self.at[rows, 0], self.at[rows, 1]
        radius = self.settings.cutter_radius_mm
        around = shapely.box(x.min() - 3.0 * radius, y.min() - 3.0 * radius, x.max() + 3.0 * radius, y.max() + 3.0 * radius)
        free = shapely.difference(around, shapely.buffer(keep, radius - _TOUCH_MM, quad_segs=12))
        swept = shapely.buffer(free, radius + 0.1 * self.metal.pitch_mm, quad_segs=12)
        shapely.prepare(swept)
        return np.asarray(shapely.contains_xy(swept, x, y))

    def _raster(self, chosen: Flags) -> Flags:
        cells = np.zeros(self._shape, dtype=np.bool_)
        cells[self._cells[0][chosen], self._cells[1][chosen]] = True
        return cells

    def _kept(self, z: float) -> Flags:
        """What the cutter must not cut with its end at a height, on the raster."""
        key = round(z * _KEY)
        if key not in self._rasters:
            keep = self.keep(z, MultiPolygon())
            shapely.prepare(keep)
            x, y = (self._low[k] + (np.arange(self._shape[k]) + 0.5) * self.metal.pitch_mm for k in (0, 1))
            inside = shapely.contains_xy(keep, *(axis.ravel() for axis in np.meshgrid(x, y, indexing="ij")))
            self._rasters[key] = np.asarray(inside).reshape(self._shape)
        return self._rasters[key]
