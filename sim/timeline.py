"""The course of a proof over time: set-points, what came of them, speed and gaps, in at most 4,000 rows whose extremes are kept."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROWS_MAX = 4000


def _empty() -> Floats:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class Timeline:
    """Columns of equal length, one row for each of the equal spans that the run was divided into; rows without process have NaN in gap.

    time_s : (k,) float    Begin of the span; line, layer : (k,) int, at its begin (0 and -1: none).
    power_setpoint_w, emission_w, powder_setpoint_g_min, powder_nozzle_g_min, speed_programmed_mm_s, speed_mm_s, gap_mm, base_k : (k,)
        float    Means over the span's time (of the tip over the table; gap: height of the laser's focus above the surface; base:
        temperature of the part below the bead).
    *_min, *_max : (k,) float    Extremes within the span.
    """

    time_s: Floats
    line: NDArray[np.int64]
    layer: NDArray[np.int64]
    power_setpoint_w: Floats
    emission_w: Floats
    emission_min_w: Floats
    emission_max_w: Floats
    powder_setpoint_g_min: Floats
    powder_nozzle_g_min: Floats
    powder_min_g_min: Floats
    powder_max_g_min: Floats
    speed_programmed_mm_s: Floats
    speed_mm_s: Floats
    speed_min_mm_s: Floats
    speed_max_mm_s: Floats
    gap_mm: Floats
    gap_min_mm: Floats
    gap_max_mm: Floats
    base_k: Floats

    @classmethod
    def empty(cls) -> Timeline:
        """No rows."""
        whole = {"line", "layer"}
        return cls(**{f.name: np.zeros(0, np.int64) if f.name in whole else _empty() for f in fields(cls)})  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.time_s)

    def to_dict(self) -> dict[str, list[float | int | None]]:
        """Columns as plain numbers, rounded to 1e-4; NaN becomes None."""
        out: dict[str, list[float | int | None]] = {}
        for column in fields(self):
            values = getattr(self, column.name)
            rounded = np.round(values, 4).tolist()
            out[column.name] = [None if value != value else value for value in rounded]
        return out
