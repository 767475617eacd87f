"""The metal on the table: one sparse signed distance field that beads are added to and cutters take from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import Material
from sim.process.cut import Cut, remove_pieces, room_of
from sim.process.field import AIR, BLOCK, METAL, Blocks, Field
from sim.process.removal import ENGAGED, ENGAGED_AT, GOUGE, GOUGE_AT, REMOVED, TOLD, TOUCH
from sim.process.solid import unite, unite_box
from sim.process.target import Target

Array = NDArray[np.float64]

BAND_CELLS = 3.0  # the field is exact this far from the surface: enough for a trilinear look-up and a cutter's sweep


class Stock:
    """Metal in the build frame, substrate included.

    bounds : (2, 3) float, mm   Box in which metal can be followed (grown by the band).
    cell_mm : grid spacing. Surfaces are resolved to a fraction of it.
    substrate : (2, 3) float, mm   Corners of the plate under the part; None: no plate.
    material : bead laws of the powder.
    """

    def __init__(self, bounds: Array, cell_mm: float, material: Material, substrate: Array | None = None) -> None:
        margin = (BAND_CELLS + 1.0) * cell_mm
        low = np.asarray(bounds[0], dtype=float) - margin
        cells = np.ceil((np.asarray(bounds[1], dtype=float) + margin - low) / cell_mm).astype(np.int64) + 1
        self.field = Field(low, cell_mm, BAND_CELLS * cell_mm, cells)
        self.origin, self.cell_mm, self.band_mm = self.field.origin, self.field.cell_mm, self.field.band_mm
        self.material = material
        self._part = Field(low, cell_mm, self.band_mm, cells)  # air until `guard`
        self.lost_powder_mm3 = 0.0
        self.deposited_mm3 = 0.0
        self.removed_mm3 = 0.0
        if substrate is not None:
            self.fill_box(np.asarray(substrate, dtype=float))

    def points(self) -> tuple[Array, Array, Array]:
        """Cell centres along x, y and z, mm."""
        x, y, z = (self.origin[d] + self.cell_mm * np.arange(n) for d, n in enumerate(self.field.shape))
        return x, y, z

    def fill_box(self, box: Array, from_build: Array | None = None) -> None:
        """Unite with a box. box : (2, 3) float, mm, corners; from_build : (4, 4) float, rigid, from the build frame to the box's."""
        unite_box(self.field, np.asarray(box, dtype=np.float64), np.eye(4) if from_build is None else from_build)

    def unite(self, distance_of: Callable[[Array], Array], box: Array | None = None) -> None:
        """Unite with a solid given by its signed distance.

        distance_of : points (n, 3) float, mm -> (n,) float, mm, negative inside; 1-Lipschitz
        box : (2, 3) float, mm   Corners of a box that holds the solid; None: the whole grid.
        """
        unite(self.field, distance_of, box)

    def guard(self, target: Target) -> None:
        """Know the part from now on: `cut` tells how deep a cutter goes below its surface. target : build frame."""
        self._part = target.field_on(self.origin, self.cell_mm, self.band_mm, self.field.shape)

    def distance(self, points: Array) -> Array:
        """Signed distance at points by trilinear interpolation, mm, negative in metal. points : (n, 3) float, mm -> (n,) float"""
        return self.field.distance(points)

    def marks(self, points: Array) -> NDArray[np.int16]:
        """What made the surface next to each point: 0 clamped, > 0 bead of layer mark - 1, < 0 minus the cutter. points : (n, 3) float, mm"""
        return self.field.marks(points)

    def volume_mm3(self, above_mm: float = 0.0) -> float:
        """Metal above a height of the build frame; cells on the surface count by their filled fraction."""
        self.field.refresh()
        first = max(0, int(np.ceil((above_mm - self.origin[2]) / self.cell_mm + 0.5)))
        return float(_filled_cells(self.field.blocks, first)) * self.cell_mm**3

    def cut(
        self, start: Array, end: Array, axis0: Array, axis1: Array, radius: float, corner: float, reach: float, tool: int = 0
    ) -> Cut:  # fmt: skip
        """Remove what a cutter sweeps on one piece of its path, on which its end and its axis go linearly.

        start, end : (3,) float, mm, cutter's end   axis0, axis1 : (3,) float, unit vectors from the end to the spindle
        radius, corner, reach : mm   reach is the length of the flutes   tool : number, its negative marks the new surface
        """
        told = self.cut_pieces(np.concatenate([start, end, axis0, axis1])[None, :], radius, corner, reach, tool)[0]
        at = told[GOUGE_AT : GOUGE_AT + 3] if told[GOUGE] > 0.0 else told[ENGAGED_AT : ENGAGED_AT + 3]
        return Cut(float(told[ENGAGED]), float(told[GOUGE]), float(told[REMOVED]), at)

    def cut_pieces(self, path: Array, radius: float, corner: float, reach: float, tool: int = 0) -> Array:
        """The same along many pieces in order of time.

        path : (n, 12) float   start, end (mm), axis at start and at end of each piece
        Returns (n, 10) float: engaged_mm, gouge_mm, removed_mm3, place of the deepest engagement (3) and of the deepest gouge (3), mm, and
        how many cells' distances to the sweep were worked out.
        """
        path = np.ascontiguousarray(path, dtype=np.float64)
        told = np.zeros((len(path), TOLD))
        cutter = np.array([radius, corner, reach])
        done = 0
        while done < len(path):
            done = remove_pieces(self.field.blocks, self._part.blocks, path, cutter, -tool, done, told)
            if done < len(path):
                self.field.reserve_blocks(room_of(self.field.blocks, path[done], cutter))
        told[told[:, GOUGE] < TOUCH * self.cell_mm, GOUGE] = 0.0
        self.removed_mm3 += float(told[:, REMOVED].sum())
        return told

    @property
    def memory_bytes(self) -> int:
        """Of the metal's field and of the part's."""
        return self.field.memory_bytes + self._part.memory_bytes

    def snapshot(self) -> dict[str, NDArray[np.generic]]:
        """The state of the metal, to be given to `restore`; the target of `guard` is not part of it."""
        totals = np.array([self.lost_powder_mm3, self.deposited_mm3, self.removed_mm3])
        return {**self.field.snapshot(), "totals": totals}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Go back to a snapshot. Raises ValueError when it is of another grid."""
        self.field.restore(state)
        totals = np.asarray(state["totals"], dtype=np.float64)
        self.lost_powder_mm3, self.deposited_mm3, self.removed_mm3 = totals.tolist()


@njit(cache=True, nogil=True)
def _filled_cells(blocks: Blocks, first: int) -> float:
    """Metal in cells, those on a surface by their filled fraction, from index `first` along z on."""
    total = 0.0
    cell = blocks.size[0]
    for c in range(first // BLOCK, blocks.directory.shape[2]):
        low = max(0, first - c * BLOCK)
        for a in range(blocks.directory.shape[0]):
            for b in range(blocks.directory.shape[1]):
                block = blocks.directory[a, b, c]
                if block == METAL:
                    total += BLOCK * BLOCK * (BLOCK - low)
                elif block != AIR:
                    for i in range(BLOCK):
                        for j in range(BLOCK):
                            for k in range(low, BLOCK):
                                total += min(1.0, max(0.0, 0.5 - blocks.value[block, i, j, k] / cell))
    return total
