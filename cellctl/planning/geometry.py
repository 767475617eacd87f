"""A layer's passes as the console draws them: one vertex after the other in the order of execution, in a container of arrays."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cellctl.planning.container import pack, quantised, unpack

if TYPE_CHECKING:
    from planner.nurbs.curve import Curve
    from planner.plan import Layer, Operation, Pass

Array = NDArray[np.float64]

VIEW_SCHEMA = 2
CHORD_TOLERANCE_MM = 0.02  # of the drawn line: below a pixel
AXIS_TOLERANCE_DEG = 2.0  # between vertices of a pass whose axis turns: below what a colour tells
DECIMALS = 3
FIRST, LINK, RAPID = 1, 2, 4
PROCESS_SHIFT = 4
PROCESSES = ("deposit_contour", "deposit_fill", "deposit_overhang", "mill_face", "mill_side", "mill_scallop")
SPEED_STEP, POWER_STEP, TILT_STEP, POWDER_STEP = 0.01, 0.1, 0.01, 0.01  # mm/s, W, deg, g/min: unit of each column of `values`
MOST = 65535.0


def place_of(layer: Layer) -> dict[str, Any]:
    """Where a layer lies and what of it rests on nothing; mm, mm², deg, build frame.

    bottom, top : point and unit normal of the bounding planes; z_bottom, z_top, the heights of those points, say where a
    layer is only if its tilt_deg (of the bottom plane from level) is 0
    """
    tilt = math.degrees(math.acos(min(max(float(layer.bottom[5]), -1.0), 1.0)))
    return {
        "index": layer.index,
        "z_bottom": round(float(layer.bottom[2]), 4),
        "z_top": round(float(layer.top[2]), 4),
        "bottom": rounded(layer.bottom),
        "top": rounded(layer.top),
        "tilt_deg": round(tilt, 3),
        "thickness_mm": [round(float(value), 4) for value in layer.thickness_mm],
        "subcomponent": layer.subcomponent,
        "overlap_mm2": round(float(layer.overlap_mm2), 3),
        "overhang_mm2": round(float(layer.overhang_mm2), 3),
    }


def rounded(values: Any, decimals: int = 6) -> list[float]:
    """All numbers of an array in a flat list; no minus zero."""
    found: list[float] = (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).ravel().tolist()
    return found


def _parameters(pass_: Pass, rows: Array) -> Array:
    """(k,) where a pass has vertices: within the chord tolerance, where a set-point changes, and where the axis turns."""
    tip = pass_.tip
    found = [tip.sample(CHORD_TOLERANCE_MM)]
    if len(rows) > 1:
        found.append(tip.at_arc_length(rows[1:, 0]))
    if not isinstance(pass_.axis, np.ndarray):
        found.append(_turning(pass_.axis))
    return np.unique(np.concatenate(found))


def _turning(axis: Curve) -> Array:
    """(k,) parameters between which the axis turns by little."""
    coarse = np.linspace(*axis.domain, 33)
    points = axis.evaluate(coarse)
    points = points / np.linalg.norm(points, axis=1)[:, None]
    turn = np.degrees(np.arccos(np.clip((points[1:] * points[:-1]).sum(axis=1), -1.0, 1.0))).sum()
    return np.linspace(*axis.domain, max(2, int(turn / AXIS_TOLERANCE_DEG) + 1))


def _tilts(pass_: Pass, at: Array) -> Array:
    """(k,) deg   Of the tool axis from the build direction."""
    axis = np.tile(pass_.axis, (len(at), 1)) if isinstance(pass_.axis, np.ndarray) else pass_.axis.evaluate(at)
    return np.asarray(np.degrees(np.arccos(np.clip(axis[:, 2] / np.linalg.norm(axis, axis=1), -1.0, 1.0))))


class Columns(NamedTuple):
    """One pass: points (k, 3) mm, arc (k,) mm, values (k, 4) of the piece that ends at each vertex, flags (k,), set-point rows (r, 5)."""

    points: Array
    arc: Array
    values: Array
    flags: NDArray[np.int64]
    rows: Array


def _columns(pass_: Pass, process: int) -> Columns:
    """What is drawn of a pass. process : its number in PROCESSES"""
    rows = np.atleast_2d(np.asarray(pass_.setpoints, dtype=np.float64)).reshape(-1, 5)
    at = _parameters(pass_, rows)
    points = np.asarray(pass_.tip.evaluate(at), dtype=np.float64)[:, :3]
    arc = np.asarray(pass_.tip.arc_length(at), dtype=np.float64)
    middle = np.concatenate([arc[:1], 0.5 * (arc[1:] + arc[:-1])])
    values = np.zeros((len(at), 4))
    if len(rows):
        row = np.clip(np.searchsorted(rows[:, 0], middle, side="right") - 1, 0, len(rows) - 1)
        values[:, (0, 1, 3)] = rows[row][:, (1, 2, 3)]
    values[:, 2] = _tilts(pass_, at)
    flags = np.full(len(at), (process << PROCESS_SHIFT) | (LINK if pass_.is_link else 0) | (RAPID if pass_.rapid else 0), dtype=np.int64)
    flags[0] |= FIRST
    return Columns(points, arc, values, flags, rows)


def _described(index: int, operation: Operation) -> dict[str, Any]:
    return {
        "index": index,
        "process": operation.process.value,
        "note": operation.note,
        "passes": len(operation.passes),
        "bead_width_mm": float(operation.bead_width_mm),
        "bead_height_mm": float(operation.bead_height_mm),
        "cutter_mm": float(operation.cutter_diameter_mm),
        "spindle_rpm": float(operation.spindle_rpm),
    }


def steps_of(values: Array) -> NDArray[np.uint16]:
    """(n, 4) u2 of speed mm/s, power W, tilt deg and powder g/min."""
    units = np.array([SPEED_STEP, POWER_STEP, TILT_STEP, POWDER_STEP])
    return np.asarray(np.clip(np.rint(values / units), 0.0, MOST), dtype=np.uint16)


def layer_geometry(layer: Layer) -> bytes:
    """A layer's container.

    position : (n, 4) u2, steps from the origin, and flags: FIRST of its pass, LINK, RAPID, and the process from PROCESS_SHIFT on
    arc : (n,) f4, mm along the pass   values : (n, 4) u2, see `steps_of`, of the piece that ends at the vertex
    passes : (p, 4) i4, first vertex, operation in the layer, LINK and RAPID, first row   rows : (r, 5) f4, set-points as in the Plan
    overhang : (m, 3) f4, mm, closed outlines; outlines : (k + 1,) i4, where each begins
    """
    found: list[Columns] = []
    table: list[tuple[int, int, int, int]] = []
    vertex = row = 0
    for index, operation in enumerate(layer.operations):
        process = PROCESSES.index(operation.process.value)
        for pass_ in operation.passes:
            columns = _columns(pass_, process)
            table.append((vertex, index, int(columns.flags[-1]) & (LINK | RAPID), row))
            vertex, row = vertex + len(columns.points), row + len(columns.rows)
            found.append(columns)
    flags = np.concatenate([one.flags for one in found]) if found else np.zeros(0, dtype=np.int64)
    origin, step, position = quantised(_joined([one.points for one in found], 3), flags)
    overhang = [np.vstack([outline, outline[:1]]) for outline in layer.overhang]
    header = {
        "schema": VIEW_SCHEMA,
        "kind": "layer",
        "place": place_of(layer),
        "origin": origin,
        "step_mm": step,
        "operations": [_described(index, operation) for index, operation in enumerate(layer.operations)],
    }
    arrays: dict[str, NDArray[Any]] = {
        "position": position,
        "arc": _joined([one.arc[:, None] for one in found], 1)[:, 0].astype(np.float32),
        "values": steps_of(_joined([one.values for one in found], 4)),
        "passes": np.array(table, dtype=np.int32).reshape(-1, 4),
        "rows": _joined([one.rows for one in found], 5).astype(np.float32),
        "overhang": _joined(overhang, 3).astype(np.float32),
        "outlines": np.cumsum([0, *map(len, overhang)]).astype(np.int32),
    }
    return pack(header, arrays)


def _joined(parts: list[Array], columns: int) -> Array:
    return np.concatenate(parts) if parts else np.zeros((0, columns))


def points_of(header: dict[str, Any], position: NDArray[Any]) -> Array:
    """(n, 3) mm of quantised positions."""
    points: Array = np.asarray(header["origin"]) + header["step_mm"] * position[:, :3].astype(np.float64)
    return points


def layer_document(content: bytes) -> dict[str, Any]:
    """The same as plain data, for programs: passes as polylines x0, y0, z0, x1, ... mm. Raises ContainerError."""
    header, arrays = unpack(content)
    points = points_of(header, arrays["position"])
    values, table = arrays["values"], arrays["passes"]
    ends = np.append(table[1:, 0], len(points))
    told = header["operations"]
    operations: list[dict[str, Any]] = [{**{name: one[name] for name in ("index", "process", "note")}, "passes": []} for one in told]
    for (first, operation, flags, _row), end in zip(table.tolist(), ends.tolist(), strict=True):
        speed, power = values[first:end, 0].max() * SPEED_STEP, values[first:end, 1].max() * POWER_STEP
        shown = {"link": bool(flags & LINK), "laser_w": round(float(power), 1), "feed_mm_s": round(float(speed), 2)}
        operations[operation]["passes"].append({**shown, "points": rounded(points[first:end], DECIMALS)})
    outlines = arrays["outlines"].tolist()
    overhang = [rounded(arrays["overhang"][low:high], DECIMALS) for low, high in itertools.pairwise(outlines)]
    return {**header["place"], "overhang": overhang, "operations": operations}
