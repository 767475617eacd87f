"""Small stocks with known metal for the tests of the process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from config import Tool, load_material
from sim.process.bead import pool_law
from sim.process.deposit import deposit
from sim.process.melt import BeadSection, bead_at
from sim.process.stock import Stock

Array = NDArray[np.float64]

MATERIAL = load_material("316L")
POWER_W, POWDER_G_MIN, SPEED_MM_S = 1200.0, 12.0, 12.0
HEAD = Tool(number=1, name="head", kind="deposition", tip_mm=(0.0, 0.0, -160.0), diameter_mm=2.0)
LAW = pool_law(MATERIAL, HEAD)
BEAD = BeadSection(*bead_at(LAW.melt, POWER_W, POWDER_G_MIN, SPEED_MM_S, 0.0, 1.0, LAW.heat.ambient_k)[:3])  # on cold metal
UP = np.array([0.0, 0.0, 1.0])


def vector(*values: float) -> Array:
    return np.array(values, dtype=np.float64)


def plate(size_mm: float = 24.0, cell_mm: float = 0.2, top_mm: float = 5.0) -> Stock:
    """A wide plate with its top at z = 0; metal is followed `top_mm` above it."""
    half = 0.5 * size_mm
    bounds = np.array([[-half, -half, -1.5], [half, half, top_mm]])
    return Stock(bounds, cell_mm, MATERIAL, np.array([[-100.0, -100.0, -10.0], [100.0, 100.0, 0.0]]))


def block(low: Array, high: Array, cell_mm: float = 0.2) -> Stock:
    """A free block of metal in a grid that is 3 mm larger."""
    stock = Stock(np.array([low - 3.0, high + 3.0]), cell_mm, MATERIAL)
    stock.fill_box(np.array([low, high]))
    return stock


def track(stock: Stock, start: Array, end: Array, axis: Array = UP, powder_g_min: float = POWDER_G_MIN) -> float:
    """One bead at the usual figures; volume that stuck, mm3."""
    seconds = float(np.linalg.norm(end - start)) / SPEED_MM_S
    return deposit(stock, LAW, start, end, axis, POWER_W, powder_g_min, seconds)


def height(stock: Stock, x: float, y: float, from_mm: float = 4.9) -> float:
    """Height of the metal over a point, mm, by walking down the interpolated field."""
    z = np.arange(from_mm, -1.2, -0.005)
    inside = stock.distance(np.column_stack([np.full_like(z, x), np.full_like(z, y), z])) < 0.0
    return float(z[np.argmax(inside)]) if inside.any() else -np.inf
