"""All layers of a plan in one drawing that fits a graphics card: vertices that a far eye does not miss are left out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cellctl.planning.container import pack, quantised, unpack
from cellctl.planning.geometry import FIRST, LINK, PROCESS_SHIFT, VIEW_SCHEMA, points_of

Array = NDArray[np.float64]

VERTICES_MAX = 300_000  # of the whole drawing: 6 MB on the graphics card
FINEST_SHARE = 1.0 / 4000.0  # of the part's diagonal: a quarter of a pixel on a screen of 1000
COARSER = 2.0
TRIES = 8
FILLS = (1, 2)  # numbers of processes that lie inside, and are thinned by whole passes where nothing else helps


@njit(cache=True, nogil=True)
def keep_within(points: Array, first: NDArray[np.bool_], tolerance: float) -> NDArray[np.bool_]:
    """Which vertices a polyline keeps so that the others lie within the tolerance of it, pass by pass.

    points : (n, 3) mm   first : (n,) begins of passes   Greedy: a chord grows while all between its ends are near to it.
    """
    n = len(points)
    keep = np.zeros(n, dtype=np.bool_)
    start = 0
    for k in range(n):
        if first[k] or k == 0:
            keep[k] = True
            if k > 0:
                keep[k - 1] = True
            start = k
            continue
        if k - start < 2:
            continue
        dx, dy, dz = points[k, 0] - points[start, 0], points[k, 1] - points[start, 1], points[k, 2] - points[start, 2]
        square = dx * dx + dy * dy + dz * dz
        far = 0.0
        for m in range(start + 1, k):
            x, y, z = points[m, 0] - points[start, 0], points[m, 1] - points[start, 1], points[m, 2] - points[start, 2]
            t = 0.0 if square == 0.0 else min(1.0, max(0.0, (x * dx + y * dy + z * dz) / square))
            far = max(far, (x - t * dx) ** 2 + (y - t * dy) ** 2 + (z - t * dz) ** 2)
        if far > tolerance * tolerance or k - start > 200:
            keep[k - 1] = True
            start = k - 1
    if n:
        keep[n - 1] = True
    return keep


def thinned(points: Array, flags: NDArray[np.int64], budget: int, finest_mm: float) -> NDArray[np.int64]:
    """Indices of at most about `budget` vertices of a layer: coarser chords first, then without links, then fewer fill passes."""
    first = (flags & FIRST) != 0
    chosen = np.arange(len(points))
    tolerance = finest_mm
    for _ in range(TRIES):
        chosen = np.flatnonzero(keep_within(points, first, tolerance))
        if len(chosen) <= budget:
            return chosen
        tolerance *= COARSER
    chosen = chosen[(flags[chosen] & LINK) == 0]
    process = flags[chosen] >> PROCESS_SHIFT
    inside = np.isin(process, FILLS)
    spare = budget - int((~inside).sum())
    every = max(1, int(np.ceil(inside.sum() / max(1, spare))))
    number = np.cumsum((flags[chosen] & FIRST) != 0)
    return np.asarray(chosen[~inside | (number % every == 0)], dtype=np.int64)


def whole_geometry(layers: Iterable[bytes], count: int, diagonal_mm: float, budget: int = VERTICES_MAX) -> bytes:
    """One container of all layers' containers in order: `position`, `values` and `arc` as in a layer, `layers` (count + 1,) i4 first
    vertices, `beads` (count, 2) f4 width and height of the beads, mm. Raises ContainerError."""
    points: list[Array] = []
    columns: dict[str, list[NDArray[Any]]] = {"flags": [], "values": [], "arc": []}
    starts, beads = [0], []
    share = max(48, budget // max(1, count))
    for content in layers:
        header, arrays = unpack(content)
        found = points_of(header, arrays["position"])
        flags = arrays["position"][:, 3].astype(np.int64)
        kept = thinned(found, flags, share, diagonal_mm * FINEST_SHARE)
        points.append(found[kept])
        columns["flags"].append(flags[kept])
        columns["values"].append(arrays["values"][kept])
        columns["arc"].append(arrays["arc"][kept])
        starts.append(starts[-1] + len(kept))
        sizes = [(one["bead_width_mm"], one["bead_height_mm"]) for one in header["operations"] if one["bead_width_mm"] > 0.0]
        beads.append(sizes[0] if sizes else (0.0, 0.0))
    flags = np.concatenate(columns["flags"]) if points else np.zeros(0, dtype=np.int64)
    origin, step, position = quantised(np.concatenate(points) if points else np.zeros((0, 3)), flags)
    arrays = {
        "position": position,
        "arc": np.concatenate(columns["arc"]) if points else np.zeros(0, dtype=np.float32),
        "values": np.concatenate(columns["values"]) if points else np.zeros((0, 4), dtype=np.uint16),
        "layers": np.array(starts, dtype=np.int32),
        "beads": np.array(beads, dtype=np.float32).reshape(-1, 2),
    }
    return pack({"schema": VIEW_SCHEMA, "kind": "whole", "origin": origin, "step_mm": step}, arrays)
