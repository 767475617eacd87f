"""The course of a proof over time: set-points, what came of them, speed and gaps, in at most 4,000 rows whose extremes are kept."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROWS_MAX = 4000
SPAN_S = 0.05  # of a row to begin with; doubles when the rows are full
# columns of a span while the run goes on: time in it, line at its begin, time with a gap, integrals over time, extremes
TIME, LINE, GAP_TIME = range(3)
SUMS = 3  # power set, emission, powder set, powder, programmed speed, speed, gap, base temperature
SUM_COLUMNS = 8
LOWS = SUMS + SUM_COLUMNS  # emission, powder, speed, gap
HIGHS = LOWS + 4
COLUMNS = HIGHS + 4
# of the sums, which have extremes
EXTREMES = (1, 3, 5, 6)
EMISSION, POWDER, SPEED, GAP, BASE = 1, 3, 5, 6, 7


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


@njit(cache=True)
def _into(row: Floats, seconds: float, line: float, values: Floats) -> None:
    """Add one piece's share of time to a span; NaN in the gap: none."""
    if row[TIME] == 0.0:
        row[LINE] = line
        row[LOWS:HIGHS] = np.inf
        row[HIGHS:] = -np.inf
    row[TIME] += seconds
    has_gap = not np.isnan(values[GAP])
    if has_gap:
        row[GAP_TIME] += seconds
    for n in range(SUM_COLUMNS):
        if (n != GAP and n != BASE) or has_gap:
            row[SUMS + n] += values[n] * seconds
    for k in range(4):
        value = values[EXTREMES[k]]
        if not np.isnan(value):
            row[LOWS + k] = min(row[LOWS + k], value)
            row[HIGHS + k] = max(row[HIGHS + k], value)


@njit(cache=True)
def _halve(rows: Floats, used: int) -> int:
    """Unite rows in pairs. Returns how many are left."""
    left = (used + 1) // 2
    for k in range(left):
        first = rows[2 * k].copy()
        if 2 * k + 1 < used:
            second = rows[2 * k + 1]
            first[TIME] += second[TIME]
            first[GAP_TIME:LOWS] += second[GAP_TIME:LOWS]
            first[LOWS:HIGHS] = np.minimum(first[LOWS:HIGHS], second[LOWS:HIGHS])
            first[HIGHS:] = np.maximum(first[HIGHS:], second[HIGHS:])
        rows[k] = first
    rows[left:used] = 0.0
    return left


@njit(cache=True)
def _record(rows: Floats, state: Floats, dt: Floats, line: Floats, values: Floats) -> None:
    """Add the pieces of a step. state : (3,) rows begun, width of a span s, time left in the last one s."""
    for k in range(dt.shape[0]):
        left = dt[k]
        while left > 1e-12:
            if state[2] <= 1e-12:
                if state[0] == rows.shape[0]:
                    state[0] = _halve(rows, int(state[0]))
                    state[1] *= 2.0
                state[0] += 1.0
                state[2] = state[1]
            part = min(left, state[2])
            _into(rows[int(state[0]) - 1], part, line[k], values[k])
            state[2] -= part
            left -= part


class Recorder:
    """Grows a Timeline while a run goes on, in bounded room; what is recorded depends on the run alone."""

    def __init__(self) -> None:
        self._rows = np.zeros((ROWS_MAX, COLUMNS))
        self._state = np.array([0.0, SPAN_S, 0.0])

    def add(self, dt: Floats, line: Floats, values: Floats) -> None:
        """Add pieces: dt (k,) s, line (k,) and values (k, 8): power setpoint and emission, powder setpoint and at the nozzle, programmed and
        real tip speed, gap (NaN: none) and base temperature."""
        _record(self._rows, self._state, dt, line, values)

    def state(self) -> dict[str, Floats]:
        """What was recorded so far, as arrays."""
        return {"rows": self._rows[: int(self._state[0])].copy(), "state": self._state.copy()}

    def restore(self, state: dict[str, Floats]) -> None:
        """Go back to a state."""
        self._rows[:] = 0.0
        self._rows[: len(state["rows"])] = state["rows"]
        self._state[...] = state["state"]

    def timeline(self, layer_of_line: NDArray[np.int64]) -> Timeline:
        """What was recorded. layer_of_line : (n + 1,) by N-word, [0] for none."""
        rows = self._rows[: int(self._state[0])]
        time = rows[:, TIME]
        line = rows[:, LINE].astype(np.int64)
        mean = rows[:, SUMS:LOWS] / np.maximum(time, 1e-300)[:, None]
        with_gap = rows[:, GAP_TIME] > 0.0
        measured = np.where(with_gap[:, None], rows[:, [SUMS + GAP, SUMS + BASE]] / np.maximum(rows[:, GAP_TIME], 1e-300)[:, None], np.nan)
        low, high = rows[:, LOWS:HIGHS], rows[:, HIGHS:]
        gap_low, gap_high = (np.where(with_gap, side[:, 3], np.nan) for side in (low, high))
        return Timeline(
            time_s=np.concatenate(([0.0], np.cumsum(time)[:-1])) if len(time) else _empty(),
            line=line,
            layer=layer_of_line[np.clip(line, 0, len(layer_of_line) - 1)],
            power_setpoint_w=mean[:, 0],
            emission_w=mean[:, 1],
            emission_min_w=low[:, 0],
            emission_max_w=high[:, 0],
            powder_setpoint_g_min=mean[:, 2],
            powder_nozzle_g_min=mean[:, 3],
            powder_min_g_min=low[:, 1],
            powder_max_g_min=high[:, 1],
            speed_programmed_mm_s=mean[:, 4],
            speed_mm_s=mean[:, 5],
            speed_min_mm_s=low[:, 2],
            speed_max_mm_s=high[:, 2],
            gap_mm=measured[:, 0],
            gap_min_mm=gap_low,
            gap_max_mm=gap_high,
            base_k=measured[:, 1],
        )
