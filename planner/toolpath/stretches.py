"""The stretches of a closed cut on which the tool is free of what stands beside it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.curve import Curve
from planner.plan import Pass
from planner.process import Settings
from planner.toolpath.motion import Motion, process_pass
from planner.toolpath.side import begun_on_flat

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

IsFree = Callable[[Floats, Floats], Flags]
"""Tips (n, 3), mm, and unit axes (n, 3) of poses: which are free, (n,)."""
LEAST_STRETCH_MM = 1.0
"""Shorter cuts between places that are barred are left out."""
_SAMPLE_MM = 0.05  # chord error at which a pass is looked at


def free_passes(motion: Motion, barred: MultiPolygon, settings: Settings) -> list[Pass]:
    """The stretches of a closed motion on which its tip stays clear of a region, each a pass; all of it if it does."""
    shapely.prepare(barred)
    return passes_where(motion, lambda tips, axes: ~shapely.contains_xy(barred, tips[:, 0], tips[:, 1]), settings)


def passes_where(motion: Motion, is_free: IsFree, settings: Settings) -> list[Pass]:
    """The stretches of a closed motion on which its poses are free, each a pass; all of it if they all are."""
    row = [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0]
    u, free = _asked(motion, is_free)
    if free.all():
        return [process_pass(begun_on_flat(motion), row)]
    if not free.any():
        return []
    first = int(np.flatnonzero(~free)[0])
    turned = motion.started_at(float(motion.tip.arc_length([u[first]])[0]))
    u, free = _asked(turned, is_free)
    arcs = turned.tip.arc_length(u)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(np.int8)))
    found = []
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        begin, end = float(arcs[start]), float(arcs[stop - 1])
        if end - begin >= LEAST_STRETCH_MM:
            found.append(process_pass(_between(turned, begin, end), row))
    return found


def _asked(motion: Motion, is_free: IsFree) -> tuple[Floats, Flags]:
    """Parameters along a motion, and where it is free, (n,) each."""
    u = motion.tip.sample(_SAMPLE_MM)
    tips = motion.tip.evaluate(u)
    axes = motion.axis.evaluate(u) if isinstance(motion.axis, Curve) else np.broadcast_to(motion.axis, tips.shape)
    return u, is_free(tips, axes / np.linalg.norm(axes, axis=1)[:, None])


def _between(motion: Motion, begin: float, end: float) -> Motion:
    """The motion from one arc length to another, mm."""
    part = motion if end >= motion.length - 1e-6 else motion.from_arc(end)[0]
    return part if begin <= 1e-6 else part.from_arc(begin)[1]
