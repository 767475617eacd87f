"""The metal on the table: one narrow-band signed distance field that beads are added to and cutters take from."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from config import Material
from sim.process.cut import remove_piece
from sim.process.deposit import add_pieces, highest
from sim.process.melt import bead_section

Array = NDArray[np.float64]

BAND_CELLS = 3.0  # the field is exact this far from the surface: enough for a trilinear look-up and a cutter's sweep
REACH_HEIGHTS = 1.5  # of the bead's height below the spot: what lies deeper the pool does not touch
ADHESION_WIDTHS = 0.35  # of the bead's width: the pool holds to its neighbour over that much of nothing
ANGLE_STEP_RAD = 0.02  # a cut with a turning axis is split this fine


class Stock:
    """Metal in the build frame, substrate included.

    bounds : (2, 3) float, mm   Box in which metal can be followed (grown by the band).
    cell_mm : grid spacing. Surfaces are resolved to a fraction of it.
    substrate : (2, 3) float, mm   Corners of the plate under the part; None: no plate.
    material : bead laws of the powder.
    """

    def __init__(self, bounds: Array, cell_mm: float, material: Material, substrate: Array | None = None) -> None:
        margin = (BAND_CELLS + 1.0) * cell_mm
        self.cell_mm = float(cell_mm)
        self.band_mm = BAND_CELLS * self.cell_mm
        self.material = material
        low = np.asarray(bounds[0], dtype=float) - margin
        size = np.ceil((np.asarray(bounds[1], dtype=float) + margin - low) / cell_mm).astype(int) + 1
        self.origin = low
        self.field = np.full(tuple(size), self.band_mm, dtype=np.float32)
        self._top = -1  # index along z above which there is no metal
        self.lost_powder_mm3 = 0.0
        self.deposited_mm3 = 0.0
        if substrate is not None:
            self.fill_box(np.asarray(substrate, dtype=float))

    def points(self) -> tuple[Array, Array, Array]:
        """Cell centres along x, y and z, mm."""
        x, y, z = (self.origin[d] + self.cell_mm * np.arange(n) for d, n in enumerate(self.field.shape))
        return x, y, z

    def fill_box(self, box: Array, from_build: Array | None = None) -> None:
        """Unite with a box.

        box : (2, 3) float, mm, corners   from_build : (4, 4) float   Its frame, turned about z and shifted against the build frame.
        """
        x, y, z = self.points()
        frame = np.eye(4) if from_build is None else from_build
        u = frame[0, 0] * x[:, None] + frame[0, 1] * y[None, :] + frame[0, 3]
        v = frame[1, 0] * x[:, None] + frame[1, 1] * y[None, :] + frame[1, 3]
        w = frame[2, 2] * z + frame[2, 3]
        gaps = [np.maximum(box[0, d] - axis, axis - box[1, d]) for d, axis in enumerate((u, v, w))]
        self.unite(np.maximum(np.maximum(gaps[0], gaps[1])[:, :, None], gaps[2][None, None, :]))

    def unite(self, distance: NDArray[np.floating[Any]]) -> None:
        """Unite with a solid given by its signed distance on the grid, mm, negative inside; shape of the field."""
        np.minimum(self.field, np.clip(distance, -self.band_mm, self.band_mm), out=self.field, casting="same_kind")
        filled = np.flatnonzero((self.field < self.band_mm).any(axis=(0, 1)))
        self._top = int(filled[-1]) if len(filled) else -1

    def distance(self, points: Array) -> Array:
        """Signed distance at points by trilinear interpolation, mm, negative in metal. points : (n, 3) float, mm -> (n,) float"""
        value: Array = map_coordinates(self.field, ((points - self.origin) / self.cell_mm).T, order=1, mode="nearest", output=np.float64)
        return value

    def volume_mm3(self, above_mm: float = 0.0) -> float:
        """Metal above a height of the build frame; cells on the surface count by their filled fraction."""
        first = max(0, int(np.ceil((above_mm - self.origin[2]) / self.cell_mm + 0.5)))
        filled = np.clip(0.5 - self.field[:, :, first:] / self.cell_mm, 0.0, 1.0)
        return float(filled.sum(dtype=np.float64)) * self.cell_mm**3

    def deposit(self, start: Array, end: Array, axis: Array, power_w: float, powder_g_min: float, seconds: float) -> float:
        """Add metal along one straight piece of the spot's path; returns the volume that stuck, mm3.

        start, end : (3,) float, mm   axis : (3,) float, unit vector from the spot into the head   seconds : time that the piece takes
        Any length: it is laid down in pieces of one cell's length, as the pool moves on.
        """
        count = max(1, int(np.ceil(float(np.linalg.norm(end - start)) / self.cell_mm - 1e-9)))
        share = np.arange(count + 1)[:, None] / count
        points = start + share * (end - start)
        path = np.hstack([points[:-1], points[1:], np.tile(axis, (count, 1))])
        process = np.tile([power_w, powder_g_min, seconds / count], (count, 1))
        return self.deposit_pieces(path, process)

    def deposit_pieces(self, path: Array, process: Array) -> float:
        """Add metal along pieces in order of time; returns the volume that stuck, mm3.

        path : (n, 9) float   start, end (mm) and axis (unit vector from the spot into the head) of each piece
        process : (n, 3) float   power W, powder g/min and time s of each piece
        Pieces of about one cell's length are right: longer ones level the surface too evenly.
        """
        bead = np.zeros((len(path), 3))
        length = np.linalg.norm(path[:, 3:6] - path[:, 0:3], axis=1)
        for n, (power_w, powder_g_min, seconds) in enumerate(process.tolist()):
            section = bead_section(self.material, power_w, powder_g_min, length[n] / seconds if seconds > 0.0 else 0.0)
            bead[n] = 0.5 * section.width_mm, section.height_mm, section.area_mm2 * length[n]
        melts = bead[:, 2] > 0.0
        path, bead = path[melts], bead[melts]
        held = 0.0
        main = np.argmax(np.abs(path[:, 6:9]), axis=1)
        ends = np.flatnonzero(np.diff(main, append=-1)) + 1
        for first, last in pairwise([0, *ends.tolist()]):
            held += self._deposit_run(path[first:last], bead[first:last])
        self.deposited_mm3 += held
        self.lost_powder_mm3 += max(0.0, float(bead[:, 2].sum()) - held)
        return held

    def _deposit_run(self, path: Array, bead: Array) -> float:
        """Pieces whose axes are all nearest to the same direction of the grid."""
        order, up = _upright(path[0, 6:9])
        field, origin = np.transpose(self.field, order), self.origin[order]
        turned = path.reshape(-1, 3, 3)[:, :, order]
        if up < 0.0:
            field = field[:, :, ::-1]
            flip = np.array([1.0, 1.0, -1.0])
            origin = origin * flip - np.array([0.0, 0.0, self.cell_mm * (field.shape[2] - 1)])
            turned = turned * flip
        held = add_pieces(
            field, origin, self.cell_mm, self.band_mm, np.ascontiguousarray(turned.reshape(-1, 9)), bead, REACH_HEIGHTS, ADHESION_WIDTHS
        )
        points = path[:, :6].reshape(-1, 3)
        box = self._box(points.min(axis=0), points.max(axis=0), 2.0 * float(bead[:, 0].max()))
        self._top = highest(self.field, self.band_mm, box, self._top)
        return float(held)

    def _box(self, low_mm: Array, high_mm: Array, margin_mm: float) -> NDArray[np.int64]:
        """(2, 2) int, first and last index along x and y of the cells in a box with a margin."""
        low = np.floor((low_mm[:2] - margin_mm - self.origin[:2]) / self.cell_mm)
        high = np.ceil((high_mm[:2] + margin_mm - self.origin[:2]) / self.cell_mm)
        last = np.array(self.field.shape[:2]) - 1
        return np.array([np.clip(low, 0, last), np.clip(high, 0, last)]).astype(np.int64)

    def cut(self, start: Array, end: Array, axis0: Array, axis1: Array, radius: float, corner: float, reach: float) -> float:
        """Remove what a cutter sweeps; returns the greatest depth in metal, mm.

        start, end : (3,) float, mm, cutter end   axis0, axis1 : (3,) float, unit vectors   radius, corner, reach : mm
        """
        turn = float(np.linalg.norm(axis1 - axis0))
        pieces = 1 + int(turn / ANGLE_STEP_RAD)
        deepest = 0.0
        for i in range(pieces):
            f0, f1 = i / pieces, (i + 1) / pieces
            axis = axis0 + 0.5 * (f0 + f1) * (axis1 - axis0)
            depth = remove_piece(
                self.field, self.origin, self.cell_mm, self.band_mm, self._top,
                start + f0 * (end - start), start + f1 * (end - start), axis / np.linalg.norm(axis), radius, corner, reach,
            )  # fmt: skip
            deepest = max(deepest, float(depth))
        return deepest


def _upright(axis: Array) -> tuple[list[int], float]:
    """Order of the grid's directions with the one nearest to `axis` last, and its sign."""
    k = int(np.argmax(np.abs(axis)))
    return [(k + 1) % 3, (k + 2) % 3, k], float(np.sign(axis[k]))
