"""As-built against the mesh: where metal is missing, where there is too much, and how far off the surface is."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from sim.process.stock import Stock
from sim.process.target import Target

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Deviation:
    """Signed distance of the as-built surface from the part's, along the part's normal: + too much metal, - metal missing.

    Figures in mm over samples spread by area on the part's surface above the substrate; volumes in mm3.
    p50, p95 and p99 are of the absolute value. A deviation beyond the stock's band counts as the band.
    """

    mean_mm: float
    p50_mm: float
    p95_mm: float
    p99_mm: float
    max_excess_mm: float
    max_missing_mm: float
    missing_mm3: float
    excess_mm3: float
    part_mm3: float
    samples: int
    cell_mm: float

    def as_dict(self) -> dict[str, float]:
        """Plain numbers, rounded to 0.1 um and 0.1 mm3, for JSON."""
        return {name: round(value, 1 if name.endswith("mm3") else 4) for name, value in asdict(self).items()}


def surface_deviation(stock: Stock, target: Target, base_mm: float) -> tuple[Array, NDArray[np.bool_]]:
    """Deviation at the target's area-uniform samples, mm, and which of them count (those above `base_mm`)."""
    points = target.samples[target.spread]
    counted: NDArray[np.bool_] = points[:, 2] > base_mm
    return -stock.distance(points), counted


def compare(stock: Stock, target: Target, base_mm: float | None = None) -> Deviation:
    """Measure the stock against the part.

    base_mm : surface at or below this height is the joint with the substrate and does not count; default 1.5 cells.
    """
    base = 1.5 * stock.cell_mm if base_mm is None else base_mm
    deviation, counted = surface_deviation(stock, target, base)
    deviation = deviation[counted]
    size = np.abs(deviation)
    missing, excess = _volumes(stock, target)
    p50, p95, p99 = np.percentile(size, [50.0, 95.0, 99.0])
    return Deviation(
        mean_mm=float(deviation.mean()),
        p50_mm=float(p50),
        p95_mm=float(p95),
        p99_mm=float(p99),
        max_excess_mm=float(max(0.0, deviation.max())),
        max_missing_mm=float(max(0.0, -deviation.min())),
        missing_mm3=missing,
        excess_mm3=excess,
        part_mm3=target.volume_mm3,
        samples=int(counted.sum()),
        cell_mm=stock.cell_mm,
    )


def _volumes(stock: Stock, target: Target) -> tuple[float, float]:
    """Missing and excess volume above the substrate, mm3, with cells on a surface counted by their filled fraction."""
    above = int(np.ceil(-stock.origin[2] / stock.cell_mm + 0.5))
    part = target.field(stock.origin, stock.cell_mm, stock.field.shape, stock.band_mm)
    wanted = np.clip(0.5 - part[:, :, above:] / stock.cell_mm, 0.0, 1.0)
    built = np.clip(0.5 - stock.field[:, :, above:] / stock.cell_mm, 0.0, 1.0)
    gap = (wanted - built).astype(np.float64)
    cell3 = stock.cell_mm**3
    return float(np.maximum(gap, 0.0).sum() * cell3), float(np.maximum(-gap, 0.0).sum() * cell3)
