"""A Program as the console scrubs along it: for each line of a layer when it ends and where everything is then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cellctl.domain.arcs import arc_over_chord
from cellctl.planning.container import pack
from cellctl.planning.geometry import VIEW_SCHEMA
from cellctl.planning.view import put
from planner.program import Program

INDEX = "index.v2.json"


def track_beside(directory: Path) -> Path:
    """Where the track of a Program's directory lies."""
    return directory.with_name(f"{directory.name}.track")


def chunk_file(number: int) -> str:
    """File name of a chunk: the lines of one layer."""
    return f"lines_{number:05d}.v2.bin"


def _path_mm(table: NDArray[Any]) -> NDArray[np.float64]:
    """(n,) mm   Way of the tip in the build frame to the end of each line, as the cell counts it."""
    tip = np.asarray(table["tip_end"], dtype=np.float64)
    steps = np.linalg.norm(np.diff(tip, axis=0), axis=1) * arc_over_chord(np.asarray(table["bulge"], dtype=np.float64)[1:])
    return np.concatenate([np.zeros(min(1, len(tip))), np.cumsum(steps)])


def _starts(table: NDArray[Any]) -> NDArray[np.int64]:
    """(k + 1,) first line of each layer that the Program has, from 0 on, and the number of lines."""
    layer = np.maximum.accumulate(np.asarray(table["layer"], dtype=np.int64))
    begins = np.flatnonzero((np.diff(layer) > 0) & (layer[:-1] >= 0)) + 1
    return np.unique(np.concatenate([[0], begins, [len(table)]])).astype(np.int64)


def _chunk(table: NDArray[Any], path: NDArray[np.float64], low: int, high: int) -> tuple[dict[str, Any], bytes]:
    """Entry in the index, and container, of lines low to high.

    Arrays: time (n,) f4, s since the chunk's begin, at the end of each line; tip, axis (n, 3) f4; joints (n, k) f4; arc, path (n,) f4, mm;
    operation (over the plan), pass (n,) i4; kind (n,) u1. `before`: where tip, axis and joints were before its first line.
    """
    rows = table[low:high]
    start = table[low - 1] if low else None
    time_start = float(start["time_end_s"]) if start is not None else 0.0
    path_start = float(path[low - 1]) if low else 0.0
    before = rows[0] if start is None else start
    entry = {
        "layer": int(rows["layer"].max()),
        "first_line": low,
        "lines": high - low,
        "time_start_s": time_start,
        "time_end_s": float(rows["time_end_s"][-1]),
        "path_start_mm": path_start,
    }
    arrays: dict[str, NDArray[Any]] = {
        "time": (rows["time_end_s"] - time_start).astype(np.float32),
        "tip": rows["tip_end"].astype(np.float32),
        "axis": rows["axis_end"].astype(np.float32),
        "joints": rows["joints_end"].astype(np.float32),
        "arc": rows["arc_end_mm"].astype(np.float32),
        "path": (path[low:high] - path_start).astype(np.float32),
        "operation": rows["operation"].astype(np.int32),
        "pass": rows["pass_"].astype(np.int32),
        "kind": rows["kind"].astype(np.uint8),
    }
    places = {name: [float(value) for value in before[field]] for name, field in (("tip", "tip_end"), ("axis", "axis_end"), ("joints", "joints_end"))}
    return entry, pack({"schema": VIEW_SCHEMA, "kind": "lines", **entry, "before": places}, arrays)


def write_track(program: Program, folder: Path) -> None:
    """Write the track of a Program into a folder, its index last. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    table = program.table
    path = _path_mm(table)
    entries = []
    starts = _starts(table) if len(table) else np.zeros(1, dtype=np.int64)
    for number, (low, high) in enumerate(zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)):
        entry, content = _chunk(table, path, low, high)
        put(content, folder / chunk_file(number))
        entries.append(entry)
    told = {"lines": len(table), "duration_s": float(program.duration_s), "axes": list(program.axis_letters)}
    index = {"version": VIEW_SCHEMA, **told, "chunks": entries}
    put(msgspec.json.encode(index), folder / INDEX)
