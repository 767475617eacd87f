"""The metal on the table: one narrow-band signed distance field that beads are added to and cutters take from."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from config import Material
from sim.process.cut import remove_piece
from sim.process.deposit import add_piece
from sim.process.melt import bead_section

Array = NDArray[np.float64]

BAND_CELLS = 3.0  # the field is exact this far from the surface: enough for a trilinear look-up and a cutter's sweep
REACH_HEIGHTS = 1.5  # of the bead's height below the spot: what lies deeper the pool does not touch
ADHESION_WIDTHS = 0.35  # of the bead's width: the pool holds to its neighbour over that much of nothing
AXIAL_STEP_CELLS = 0.1  # a cutter's move along its axis is split this fine
ANGLE_STEP_RAD = 0.02  # and a turning axis this fine


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

    def deposit(self, start: Array, end: Array, axis: Array, power_w: float, powder_g_min: float, seconds: float) -> float:
        """Add metal along one straight piece of the spot's path; returns the volume that stuck, mm3.

        start, end : (3,) float, mm   axis : (3,) float, unit vector from the spot into the head   seconds : time that the piece takes
        Pieces of about one cell's length are right: shorter ones are slow, longer ones level the surface too evenly.
        """
        length = float(np.linalg.norm(end - start))
        bead = bead_section(self.material, power_w, powder_g_min, length / seconds if seconds > 0.0 else 0.0)
        if bead.area_mm2 <= 0.0:
            return 0.0
        order, up = _upright(axis)
        field = np.transpose(self.field, order)
        origin, a, p0, p1 = self.origin[order], axis[order], start[order], end[order]
        if up < 0.0:
            field = field[:, :, ::-1]
            flip = np.array([1.0, 1.0, -1.0])
            origin = origin * flip - np.array([0.0, 0.0, self.cell_mm * (field.shape[2] - 1)])
            a, p0, p1 = a * flip, p0 * flip, p1 * flip
        volume = bead.area_mm2 * length
        held = float(
            add_piece(
                field, origin, self.cell_mm, self.band_mm, p0, p1, a, 0.5 * bead.width_mm, bead.height_mm, volume,
                REACH_HEIGHTS * bead.height_mm, ADHESION_WIDTHS * bead.width_mm,
            )
        )  # fmt: skip
        self.deposited_mm3 += held
        self.lost_powder_mm3 += volume - held
        return held

    def cut(self, start: Array, end: Array, axis0: Array, axis1: Array, radius: float, corner: float, reach: float) -> float:
        """Remove what a cutter sweeps; returns the greatest depth in metal, mm.

        start, end : (3,) float, mm, cutter end   axis0, axis1 : (3,) float, unit vectors   radius, corner, reach : mm
        """
        lift = abs(float((end - start) @ axis0))
        turn = float(np.arccos(np.clip(axis0 @ axis1, -1.0, 1.0)))
        slope = lift / max(float(np.linalg.norm(end - start)), 1e-12)
        pieces = 1 + int(turn / ANGLE_STEP_RAD)
        if slope > 1e-6:
            pieces = max(pieces, 1 + int(lift / (AXIAL_STEP_CELLS * self.cell_mm)))
        deepest = 0.0
        for i in range(pieces):
            f0, f1 = i / pieces, (i + 1) / pieces
            axis = axis0 + 0.5 * (f0 + f1) * (axis1 - axis0)
            depth = remove_piece(
                self.field, self.origin, self.cell_mm, self.band_mm,
                start + f0 * (end - start), start + f1 * (end - start), axis / np.linalg.norm(axis), radius, corner, reach,
            )  # fmt: skip
            deepest = max(deepest, float(depth))
        return deepest


def _upright(axis: Array) -> tuple[list[int], float]:
    """Order of the grid's directions with the one nearest to `axis` last, and its sign."""
    k = int(np.argmax(np.abs(axis)))
    return [(k + 1) % 3, (k + 2) % 3, k], float(np.sign(axis[k]))
