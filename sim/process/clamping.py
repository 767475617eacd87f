"""What is clamped to the table before the first line: the plate, and for milling the stock, in the build frame."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from config import Cell, Material
from sim.process.metal import Metal
from sim.process.solid import unite_field
from sim.process.stock import Stock
from sim.process.target import Target

Array = NDArray[np.float64]

BESIDE_MM = 4.0  # of the part, where metal is still followed: beads bulge out by less
ABOVE_MM = 6.0
BELOW_MM = 2.0  # of the plate
SAMPLE_MM = 0.25  # spacing of a stock mesh's samples


class TriangleMesh(Protocol):
    """A closed triangle mesh, mm."""

    @property
    def vertices(self) -> NDArray[np.float64]:
        """(n, 3) float, mm."""

    @property
    def facets(self) -> NDArray[np.int64]:
        """(m, 3) int."""


def table_from_build(cell: Cell) -> Array:
    """(4, 4) float, build frame to table frame, from the cell's placement."""
    angle = np.radians(cell.placement.rotation_deg)
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:2, :2] = [[c, -s], [s, c]]
    matrix[:3, 3] = cell.placement.part_origin_mm
    return matrix


def inverse(matrix: Array) -> Array:
    """Inverse of a (4, 4) rigid motion."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def in_build(mesh: TriangleMesh, build_from_part: Array) -> Array:
    """(n, 3) float, mm   The vertices of a mesh of the part's frame in the build frame."""
    turned = np.asarray(mesh.vertices, dtype=np.float64) @ build_from_part[:3, :3].T
    return np.asarray(turned + build_from_part[:3, 3])


def metal_for(cell: Cell, part_bounds: Array, cell_mm: float, material: Material, build_from_table: Array | None = None) -> Metal:
    """A fresh plate, ready for the traces of a World.

    part_bounds : (2, 3) float, mm, build frame   Metal is followed in this box and a margin round it; a larger stock widens it.
    cell_mm : grid of the stock
    build_from_table : (4, 4) float; default: from the cell's placement
    """
    frame = inverse(table_from_build(cell)) if build_from_table is None else build_from_table
    low, high = np.asarray(part_bounds, dtype=np.float64)
    bounds = np.array([low - np.array([BESIDE_MM, BESIDE_MM, BELOW_MM]), high + np.array([BESIDE_MM, BESIDE_MM, ABOVE_MM])])
    stock = Stock(bounds, cell_mm, material)
    size, top = np.array(cell.plate.size_mm), np.array(cell.plate.top_mm)
    half = 0.5 * size * [1.0, 1.0, 0.0]
    stock.fill_box(np.array([top - half - [0.0, 0.0, size[2]], top + half]), inverse(frame))
    return Metal(stock, cell, frame)


def clamp_block(stock: Stock, part_bounds: Array, allowance_mm: float) -> None:
    """A block to mill from: the part's box grown by the allowance sideways and upwards. part_bounds : (2, 3) float, mm, build frame."""
    low, high = np.asarray(part_bounds, dtype=np.float64)
    stock.fill_box(np.array([low - [allowance_mm, allowance_mm, 0.0], high + allowance_mm]))


def clamp_mesh(stock: Stock, mesh: TriangleMesh, build_from_part: Array) -> None:
    """A stock of any closed shape. mesh : part frame, mm; build_from_part : (4, 4) float."""
    shape = Target(in_build(mesh, build_from_part), np.asarray(mesh.facets, dtype=np.int64), SAMPLE_MM)
    unite_field(stock.field, shape.field_on(stock.origin, stock.cell_mm, stock.band_mm, stock.field.shape))
