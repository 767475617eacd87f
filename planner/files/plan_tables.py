"""A Plan as flat tables of numbers, and back: all curves in concatenated arrays, one range of rows per layer."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.files import piece_tables as pieces
from planner.files.piece_tables import offsets, stacked
from planner.nurbs.curve import Curve
from planner.plan import Contour, Layer, Operation, Pass, Plan, Process, Wall

Table = NDArray[Any]
Read = Callable[[str, int, int], Table]

PROCESSES = tuple(Process)
UNITS = {
    "contours/deviation": "mm",
    "contours/smooth_deviation": "mm (NaN: follows facets)",
    "curves/knots": "1",
    "curves/weights": "1",
    "curves/points": "mm (tool axes: 1)",
    "layers/bottom": "mm, 1",
    "layers/top": "mm, 1",
    "layers/areas": "overlap, overhang: mm^2",
    "layers/thickness": "least, greatest: mm",
    "outlines/points": "mm",
    "operations/numbers": "cutter diameter mm, spindle 1/min, interpass s, bead width mm, bead height mm",
    "passes/axis": "1",
    "passes/setpoints": "arc length mm, feed mm/s, laser W, powder g/min, shield gas L/min",
    "walls/twist": "rad",
    "plan/bounds": "mm",
    "plan/build_from_part": "mm, 1",
    **pieces.UNITS,
}


class _Curves:
    """Curves as they are collected."""

    def __init__(self) -> None:
        self.curves: list[Curve] = []

    def add(self, curve: Curve) -> int:
        self.curves.append(curve)
        return len(self.curves) - 1

    def tables(self) -> dict[str, Table]:
        curves = self.curves
        return {
            "curves/degree": np.array([c.degree for c in curves], dtype="<i4"),
            "curves/rational": np.array([c.weights is not None for c in curves], dtype="u1"),
            "curves/knot_offset": offsets([len(c.knots) for c in curves]),
            "curves/point_offset": offsets([len(c.control_points) for c in curves]),
            "curves/knots": stacked([c.knots for c in curves], ()),
            "curves/points": stacked([c.control_points for c in curves], (3,)),
            "curves/weights": stacked(
                [np.ones(len(c.control_points)) if c.weights is None else c.weights for c in curves], ()
            ),
        }


def tables_of(plan: Plan) -> dict[str, Table]:
    """All of a plan but its schema number as named arrays, little-endian, in the order of the plan."""
    curves = _Curves()
    rows: dict[str, list[Any]] = {name: [] for name in _ROWS}
    curve_counts: list[int] = []
    for layer in plan.layers:
        before = len(curves.curves)
        _add_layer(layer, curves, rows)
        curve_counts.append(len(curves.curves) - before)
    tables = curves.tables()
    for name, (dtype, shape) in _ROWS.items():
        tables[name] = np.array(rows[name], dtype=dtype).reshape(-1, *shape)
    tables["layers/curve_offset"] = offsets(curve_counts)
    tables["layers/contour_offset"] = offsets([len(layer.contours) for layer in plan.layers])
    tables["layers/wall_offset"] = offsets([len(layer.walls) for layer in plan.layers])
    tables["layers/outline_offset"] = offsets([len(layer.overhang) for layer in plan.layers])
    outlines = [outline for layer in plan.layers for outline in layer.overhang]
    tables["outlines/point_offset"] = offsets([len(outline) for outline in outlines])
    tables["outlines/points"] = stacked(outlines, (3,))
    tables["layers/operation_offset"] = offsets([len(layer.operations) for layer in plan.layers])
    operations = plan.operations
    tables["operations/pass_offset"] = offsets([len(operation.passes) for operation in operations])
    setpoints = [step.setpoints for operation in operations for step in operation.passes]
    tables["passes/setpoint_offset"] = offsets([len(rows_) for rows_ in setpoints])
    tables["passes/setpoints"] = stacked(setpoints, (5,))
    tables["plan/build_from_part"] = np.asarray(plan.build_from_part, dtype="<f8")
    tables["plan/bounds"] = np.asarray(plan.bounds, dtype="<f8")
    tables.update(pieces.piece_tables(plan))
    tables["plan/words"] = np.frombuffer(_words(plan, operations), dtype="u1")
    return tables


_ROWS: dict[str, tuple[str, tuple[int, ...]]] = {
    "layers/index": ("<i4", ()),
    "layers/bottom": ("<f8", (6,)),
    "layers/top": ("<f8", (6,)),
    "layers/areas": ("<f8", (2,)),
    "layers/subcomponent": ("<i4", ()),
    "layers/thickness": ("<f8", (2,)),
    "contours/curve": ("<i4", ()),
    "contours/is_hole": ("u1", ()),
    "contours/parent": ("<i4", ()),
    "contours/deviation": ("<f8", ()),
    "contours/smooth_deviation": ("<f8", ()),
    "walls/curves": ("<i4", (2,)),
    "walls/twist": ("<f8", ()),
    "operations/process": ("u1", ()),
    "operations/layer": ("<i4", ()),
    "operations/numbers": ("<f8", (5,)),
    "passes/tip": ("<i4", ()),
    "passes/axis_curve": ("<i4", ()),
    "passes/axis": ("<f8", (3,)),
    "passes/is_link": ("u1", ()),
    "passes/rapid": ("u1", ()),
}


def _add_layer(layer: Layer, curves: _Curves, rows: dict[str, list[Any]]) -> None:
    rows["layers/index"].append(layer.index)
    rows["layers/bottom"].append(layer.bottom)
    rows["layers/top"].append(layer.top)
    rows["layers/areas"].append((layer.overlap_mm2, layer.overhang_mm2))
    rows["layers/subcomponent"].append(layer.subcomponent)
    rows["layers/thickness"].append(layer.thickness_mm)
    for contour in layer.contours:
        rows["contours/curve"].append(curves.add(contour.curve))
        rows["contours/is_hole"].append(contour.is_hole)
        rows["contours/parent"].append(contour.parent)
        rows["contours/deviation"].append(contour.deviation_mm)
        rows["contours/smooth_deviation"].append(
            np.nan if math.isnan(contour.smooth_deviation_mm) else contour.smooth_deviation_mm
        )
    for wall in layer.walls:
        rows["walls/curves"].append((curves.add(wall.bottom), curves.add(wall.top)))
        rows["walls/twist"].append(wall.twist_rad)
    for operation in layer.operations:
        rows["operations/process"].append(PROCESSES.index(operation.process))
        rows["operations/layer"].append(operation.layer)
        rows["operations/numbers"].append(
            (
                operation.cutter_diameter_mm,
                operation.spindle_rpm,
                operation.interpass_s,
                operation.bead_width_mm,
                operation.bead_height_mm,
            )
        )
        for step in operation.passes:
            moves = isinstance(step.axis, Curve)
            rows["passes/tip"].append(curves.add(step.tip))
            rows["passes/axis_curve"].append(curves.add(step.axis) if isinstance(step.axis, Curve) else -1)
            rows["passes/axis"].append((0.0, 0.0, 0.0) if moves else step.axis)
            rows["passes/is_link"].append(step.is_link)
            rows["passes/rapid"].append(step.rapid)


def _words(plan: Plan, operations: list[Operation]) -> bytes:
    words = {
        "part_name": plan.part_name,
        "mesh_sha256": plan.mesh_sha256,
        "recipe_toml": plan.recipe_toml,
        "material": plan.material,
        "process": plan.process,
        "tolerance_mm": plan.tolerance_mm,
        "findings": list(plan.findings),
        "volumes_mm3": plan.volumes_mm3,
        "books": plan.books,
        "notes": [operation.note for operation in operations],
        **pieces.piece_words(plan),
    }
    return json.dumps(words, sort_keys=True, ensure_ascii=False).encode()


def plan_from(tables: Mapping[str, Table]) -> Plan:
    """The plan of tables as `tables_of` made them.  Raises KeyError, ValueError or IndexError if they do not fit."""

    def read(name: str, first: int, last: int) -> Table:
        return tables[name][first:last]

    words = json.loads(tables["plan/words"].tobytes())
    layers = [layer_from(read, number, words["notes"]) for number in range(len(tables["layers/index"]))]
    return Plan(
        part_name=words["part_name"],
        mesh_sha256=words["mesh_sha256"],
        recipe_toml=words["recipe_toml"],
        material=words["material"],
        process=words["process"],
        tolerance_mm=words["tolerance_mm"],
        build_from_part=np.array(tables["plan/build_from_part"]),
        bounds=np.array(tables["plan/bounds"]),
        layers=tuple(layers),
        findings=tuple(words["findings"]),
        volumes_mm3=words["volumes_mm3"],
        books=words.get("books", {}),
        subcomponents=pieces.subcomponents_from(tables, words),
        setups=pieces.setups_from(tables, words),
        skeleton=pieces.skeleton_from(tables, words),
        candidates=pieces.candidates_from(tables, words),
    )


def layer_from(read: Read, number: int, notes: list[str]) -> Layer:
    """One layer, from its own rows only.

    read : (table, first row, last row + 1) -> rows   notes : of all operations of the plan.
    """
    curves = _read_curves(read, *_range(read, "layers/curve_offset", number))
    contours = [
        Contour(curves[int(curve)], bool(hole), int(parent), float(error), float(smooth_error))
        for curve, hole, parent, error, smooth_error in zip(
            *(read(f"contours/{name}", *_range(read, "layers/contour_offset", number)) for name in _CONTOUR), strict=True
        )
    ]
    walls = _range(read, "layers/wall_offset", number)
    pairs, twists = read("walls/curves", *walls), read("walls/twist", *walls)
    areas = read("layers/areas", number, number + 1)[0]
    least, greatest = (float(v) for v in read("layers/thickness", number, number + 1)[0])
    return Layer(
        index=int(read("layers/index", number, number + 1)[0]),
        bottom=np.array(read("layers/bottom", number, number + 1)[0]),
        top=np.array(read("layers/top", number, number + 1)[0]),
        contours=tuple(contours),
        walls=tuple(
            Wall(curves[int(low)], curves[int(high)], float(twist))
            for (low, high), twist in zip(pairs, twists, strict=True)
        ),
        overlap_mm2=float(areas[0]),
        overhang_mm2=float(areas[1]),
        operations=tuple(
            _operation(read, row, curves, notes[row])
            for row in range(*_range(read, "layers/operation_offset", number))
        ),
        subcomponent=int(read("layers/subcomponent", number, number + 1)[0]),
        overhang=_outlines(read, number),
        thickness_mm=(least, greatest),
    )


_CONTOUR = ("curve", "is_hole", "parent", "deviation", "smooth_deviation")


def _range(read: Read, name: str, number: int) -> tuple[int, int]:
    first, last = read(name, number, number + 2)
    return int(first), int(last)


def _outlines(read: Read, number: int) -> tuple[Table, ...]:
    """The closed outlines of what hangs in a layer."""
    first, last = _range(read, "layers/outline_offset", number)
    at = read("outlines/point_offset", first, last + 1)
    points = read("outlines/points", int(at[0]), int(at[-1]))
    at = at - at[0]
    return tuple(np.array(points[int(at[k]) : int(at[k + 1])]) for k in range(last - first))


def _read_curves(read: Read, first: int, last: int) -> dict[int, Curve]:
    """The curves first ... last - 1 by their number."""
    if first == last:
        return {}
    knot_at, point_at = read("curves/knot_offset", first, last + 1), read("curves/point_offset", first, last + 1)
    knots = read("curves/knots", int(knot_at[0]), int(knot_at[-1]))
    points = read("curves/points", int(point_at[0]), int(point_at[-1]))
    weights = read("curves/weights", int(point_at[0]), int(point_at[-1]))
    degree, rational = read("curves/degree", first, last), read("curves/rational", first, last)
    knot_at, point_at = knot_at - knot_at[0], point_at - point_at[0]
    found = {}
    for k in range(last - first):
        rows = slice(int(point_at[k]), int(point_at[k + 1]))
        found[first + k] = Curve(
            int(degree[k]),
            knots[int(knot_at[k]) : int(knot_at[k + 1])],
            points[rows],
            weights[rows] if rational[k] else None,
        )
    return found


def _operation(read: Read, row: int, curves: dict[int, Curve], note: str) -> Operation:
    first, last = _range(read, "operations/pass_offset", row)
    tip, axis_curve, axis = (read(f"passes/{name}", first, last) for name in ("tip", "axis_curve", "axis"))
    is_link, rapid = read("passes/is_link", first, last), read("passes/rapid", first, last)
    at = read("passes/setpoint_offset", first, last + 1)
    rows = read("passes/setpoints", int(at[0]), int(at[-1]))
    at = at - at[0]
    passes = tuple(
        Pass(
            curves[int(tip[k])],
            curves[int(axis_curve[k])] if axis_curve[k] >= 0 else np.array(axis[k]),
            np.array(rows[int(at[k]) : int(at[k + 1])]),
            bool(is_link[k]),
            bool(rapid[k]),
        )
        for k in range(last - first)
    )
    diameter, rpm, interpass, width, height = (float(v) for v in read("operations/numbers", row, row + 1)[0])
    process = PROCESSES[int(read("operations/process", row, row + 1)[0])]
    layer = int(read("operations/layer", row, row + 1)[0])
    return Operation(process, layer, passes, diameter, rpm, interpass, width, height, note)
