"""The feed that a program in workpiece coordinates asks for along a pass: the plan's, and less where the axes cannot hold it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.plan import Pass
from planner.post.tracking import TOLERANCE, track

Floats = NDArray[np.float64]

_SAME_ARC_MM = 1e-6
_SLACK_S = 0.05  # what the planned feed may gain or lose in a stretch before it is worth another F: a few blocks' time
_LEAST_S = 0.1  # how long a lowered feed holds at least: NURBS are cut where it changes


@dataclass(frozen=True)
class Feeds:
    """arc_mm : (k,) float, where the feed changes, the first where the pass begins   mm_min : (k,) float."""

    arc_mm: Floats
    mm_min: Floats

    def at(self, arc_mm: Floats) -> Floats:
        """(n,) mm/min at arc lengths."""
        return np.asarray(self.mm_min[np.maximum(np.searchsorted(self.arc_mm, arc_mm, side="right") - 1, 0)])


def pass_feeds(items: NDArray[np.void], source: Pass) -> Feeds:
    """Feed along a pass, constant over stretches as long as may be; a lowered one is the mean of its stretch.

    items : (n,) ITEM_DTYPE, its moves, time_s as the axes take them at best
    """
    starts = items["arc_start_mm"]
    row = np.searchsorted(source.setpoints[:, 0], starts + _SAME_ARC_MM, side="right") - 1
    planned = 60.0 * source.setpoints[row, 1]
    if source.rapid or len(items) == 0:
        return Feeds(starts[:1].copy(), planned[:1])
    length, time_s = items["arc_end_mm"] - starts, items["time_s"]
    share = np.minimum(60.0 * length / np.maximum(time_s * planned, 1e-12), 1.0)
    if share.min() > 1.0 - TOLERANCE:
        first = np.flatnonzero(np.append(True, np.diff(planned) != 0.0))
        return Feeds(starts[first], planned[first])
    levels = track(planned, share, time_s, np.zeros(len(planned)), _SLACK_S, _LEAST_S, 0.0)
    first = np.flatnonzero(np.append(True, (np.diff(levels) != 0.0) | (np.diff(planned) != 0.0)))
    mean = 60.0 * np.add.reduceat(length, first) / np.maximum(np.add.reduceat(time_s, first), 1e-12)
    return Feeds(
        starts[first], np.where(levels[first] < planned[first], np.minimum(mean, planned[first]), planned[first])
    )
