"""From where an interrupted run goes on: where metal ended, or where the machine stood if all the metal before that place is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNFINISHED_MM = 1.0
"""Less than that of a pass without light is the last tick's, not an interruption: half the width of a bead, no joint is worth it."""

KNOWN_BY = {
    "tick": "by the cell's last tick before the end, 10 ms at most",
    "sample": "by the journal's last sample: the place may lie a little further on; look at the part",
}


@dataclass(frozen=True)
class MetalEnd:
    """Index of a line and share of it that is done. known_by : "tick" or "sample" """

    line: int
    fraction: float
    known_by: str


def metal_end_of(
    end: Mapping[str, Any], arc_mm: NDArray[np.float64], is_emitting: NDArray[np.bool_]
) -> MetalEnd | None:
    """From what was written down at the end of a run; None if every line was executed.

    end : data of the run's last event: last_line (count), place and metal_end {line, fraction}, known_by
    arc_mm : (n + 1,) path length of the tip up to each line   is_emitting : (n,) whether the Program lights on it
    """
    count = len(is_emitting)
    executed = min(max(int(end.get("last_line") or 0), 0), count)
    place, metal = (end.get(name) or {} for name in ("place", "metal_end"))
    known_by = str(end.get("known_by") or "sample")
    stood = (executed, float(place.get("fraction", 0.0)) if int(place.get("line", -1)) == executed else 0.0)
    if known_by != "tick" or int(place.get("line", -1)) < 0:
        return MetalEnd(executed, 0.0, "sample") if executed < count else None
    lit = (int(metal["line"]), float(metal["fraction"])) if int(metal.get("line", -1)) >= 0 else (0, 0.0)
    chosen = lit if lit >= stood or unlit_mm(lit, stood, arc_mm, is_emitting) > UNFINISHED_MM else stood
    return MetalEnd(*chosen, known_by) if chosen < (count - 1, 1.0) else None


def unlit_mm(
    begin: tuple[int, float], end: tuple[int, float], arc_mm: NDArray[np.float64], is_emitting: NDArray[np.bool_]
) -> float:
    """Length of the passes between two places on a Program, mm, of which the light is wanted."""
    last = min(end[0], len(is_emitting) - 1)
    ways = np.diff(arc_mm[begin[0] : last + 2])
    ways[0] *= 1.0 - begin[1]
    if last == end[0]:
        ways[-1] -= (arc_mm[last + 1] - arc_mm[last]) * (1.0 - end[1])
    return float(np.sum(np.maximum(ways, 0.0)[np.asarray(is_emitting[begin[0] : last + 1])]))
