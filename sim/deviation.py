"""The figures of a comparison: deviation of a surface, of each layer, and its histogram."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BINS = 85  # one of them in the middle
PER_TOLERANCE = 10.5  # bins from nothing to the tolerance, which lies between two of them: what is beyond it can be counted
REACH_TOLERANCES = 0.5 * BINS / PER_TOLERANCE  # of the histogram, both ways: 4.05


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Signed distance of the as-built surface from the part's: + too much metal, - metal missing.

    Figures in mm over samples spread by area on the part's surface above the joint with the substrate; volumes in mm3.
    p50, p95 and p99 are of the absolute value. `max_excess_mm` is also the most that any place of the as-built surface stands out
    of the part, so that metal away from the part's surface is not overlooked.
    """

    mean_mm: float
    p50_mm: float
    p95_mm: float
    p99_mm: float
    max_excess_mm: float
    max_missing_mm: float
    missing_mm3: float
    excess_mm3: float
    samples: int

    def as_dict(self) -> dict[str, float]:
        """Plain numbers, rounded to 0.1 um and 0.1 mm3, for JSON."""
        return rounded(asdict(self))


@dataclass(frozen=True, kw_only=True)
class Deviation(Spread):
    """The figures of a whole surface. part_mm3 : volume of the part   cell_mm : grid of the stock"""

    part_mm3: float
    cell_mm: float


@dataclass(frozen=True, kw_only=True)
class LayerDeviation(Spread):
    """The figures of the places whose nearest process path is of one layer; a layer that no sample belongs to has volumes only."""

    layer: int


@dataclass(frozen=True)
class Histogram:
    """How many area-uniform samples deviate by how much.

    edges_mm : (BINS + 1,) from -REACH_TOLERANCES to +REACH_TOLERANCES   counts : (BINS,), the first and the last also hold what lies beyond
    """

    edges_mm: tuple[float, ...]
    counts: tuple[int, ...]

    def as_dict(self) -> dict[str, list[float]]:
        """Plain lists for JSON."""
        return {"edges_mm": [round(edge, 6) for edge in self.edges_mm], "counts": list(self.counts)}


def rounded(figures: dict[str, float]) -> dict[str, float]:
    """Figures by name: volumes to 0.1 mm3, the rest to 0.1 um."""
    return {name: round(value, 1 if name.endswith("mm3") else 4) for name, value in figures.items()}


def histogram(deviation: Array, tolerance_mm: float) -> Histogram:
    """Counts of signed deviations in BINS equal bins. deviation : (n,) float, mm   tolerance_mm : > 0"""
    edges = (np.arange(BINS + 1) - 0.5 * BINS) / PER_TOLERANCE * tolerance_mm
    place = np.clip(np.searchsorted(edges, deviation, side="right") - 1, 0, BINS - 1)
    return Histogram(tuple(edges.tolist()), tuple(np.bincount(place, minlength=BINS).tolist()))


def spread_of(deviation: Array, excess_mm: float = 0.0) -> dict[str, float]:
    """mean_mm to max_missing_mm of signed deviations; all zero without any. excess_mm : known from elsewhere, the least of max_excess_mm."""
    if not len(deviation):
        names = ("mean_mm", "p50_mm", "p95_mm", "p99_mm", "max_excess_mm", "max_missing_mm")
        return dict.fromkeys(names, 0.0) | {"max_excess_mm": excess_mm}
    p50, p95, p99 = np.percentile(np.abs(deviation), [50.0, 95.0, 99.0]).tolist()
    return {
        "mean_mm": float(deviation.mean()),
        "p50_mm": p50,
        "p95_mm": p95,
        "p99_mm": p99,
        "max_excess_mm": float(max(0.0, excess_mm, deviation.max())),
        "max_missing_mm": float(max(0.0, -deviation.min())),
    }
