"""A direction from which a cutter comes: what it must keep off at each depth, and what of the metal it then reaches."""

from __future__ import annotations

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.decompose.solids import polygons, prism, section, silhouette
from planner.process import Settings
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]

STICK_OUT = 5.0
"""Of the cutter's diameter: how far an ordinary end mill stands out of its holder."""
HOLDER_RADIUS_MM = 16.0
HOLDER_CLEARANCE_MM = 1.0
_TOUCH_MM = 1e-3  # what stands this little above the cutter's end is touched, not cut
_GRID_MM = 1e-4  # overlays are made on this grid
_KEY = 1e4  # heights are told apart to a ten-thousandth of a millimetre
_CRUMB_MM2 = 0.02


class Access:
    """Everything seen along a direction: in its frame z points towards the tool.

    direction : (3,) float, unit, frame of the solids   frame_from : (4, 4) float, from theirs to this one
    part, plate : what must not be cut   metal : what is to be milled away
    """

    def __init__(
        self,
        direction: Floats,
        part: manifold3d.Manifold,
        plate: manifold3d.Manifold,
        metal: manifold3d.Manifold,
        settings: Settings,
    ) -> None:
        self.direction = np.asarray(direction, dtype=np.float64)
        self.settings = settings
        self.frame_from = np.eye(4)
        self.frame_from[:3, :3] = plane_frame(np.concatenate([np.zeros(3), self.direction]))[1:]
        self._part = part.transform(self.frame_from[:3])
        self._plate = plate.transform(self.frame_from[:3])
        self._part_top, self._plate_top = (float(solid.bounding_box()[5]) for solid in (self._part, self._plate))
        self._part_shadows: dict[int, MultiPolygon] = {}
        self._shadows: dict[int, MultiPolygon] = {}
        self.take(metal)
        box = self.metal.bounding_box()
        self.top_mm = max(self._part_top, self._plate_top, float(box[5]))
        aside = 4.0 * settings.cutter_diameter_mm + HOLDER_RADIUS_MM
        self._window = shapely.box(box[0] - aside, box[1] - aside, box[3] + aside, box[4] + aside)

    def take(self, metal: manifold3d.Manifold) -> None:
        """Look at other metal, a part of what was there first."""
        self.metal = metal.transform(self.frame_from[:3])
        box = self.metal.bounding_box()
        self.low_mm, self.high_mm = float(box[2]), float(box[5])

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

    def section(self, z: float) -> MultiPolygon:
        """The metal at a height, mm."""
        return section(self.metal, min(max(z, self.low_mm + _TOUCH_MM), self.high_mm - _TOUCH_MM))

    def missed(self, metal: MultiPolygon, keep: MultiPolygon) -> MultiPolygon:
        """What of the metal a cutter that keeps off does not sweep, mm."""
        if metal.is_empty or keep.is_empty:
            return MultiPolygon()
        radius = self.settings.cutter_radius_mm
        around = shapely.box(*metal.buffer(3.0 * radius).bounds)
        free = shapely.difference(around, shapely.buffer(keep, radius - _TOUCH_MM, quad_segs=12))
        swept = shapely.buffer(free, radius + _TOUCH_MM, quad_segs=12)
        missed = shapely.difference(metal, swept)
        return MultiPolygon([piece for piece in polygons(missed).geoms if piece.area > _CRUMB_MM2])

    def levels(self, step_mm: float) -> Floats:
        """(n+1,) float, mm   Heights from the metal's top down to its bottom, at most a step apart."""
        count = max(1, int(np.ceil((self.high_mm - self.low_mm) / step_mm - 1e-9)))
        return np.linspace(self.high_mm, self.low_mm, count + 1)

    def left_at(self, levels: Floats) -> list[MultiPolygon]:
        """What stays of the metal between neighbouring heights, from the top down, mm."""
        above = MultiPolygon()
        found: list[MultiPolygon] = []
        for high, low in zip(levels[:-1].tolist(), levels[1:].tolist(), strict=True):
            missed = self.missed(self.section(0.5 * (high + low)), self.keep(low, above))
            if not missed.is_empty:
                above = polygons(shapely.union(above, missed, grid_size=_GRID_MM))
            found.append(missed)
        return found

    def without(self, levels: Floats, left: list[MultiPolygon]) -> manifold3d.Manifold:
        """The metal that stays, as a solid in the frame of the solids.  left : of `left_at`."""
        slabs = [
            prism(region, low - _TOUCH_MM, high + _TOUCH_MM)
            for region, high, low in zip(left, levels[:-1].tolist(), levels[1:].tolist(), strict=True)
            if not region.is_empty
        ]
        if not slabs:
            return manifold3d.Manifold()
        whole = self.metal ^ manifold3d.Manifold.batch_boolean(slabs, manifold3d.OpType.Add)
        return whole.transform(np.linalg.inv(self.frame_from)[:3])
