"""A Plan as the console shows it: an overview and one document per layer, made once with the plan and served as they are."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

if TYPE_CHECKING:
    from planner.plan import Layer, Operation, Pass, Plan

CHORD_TOLERANCE_MM = 0.02  # of the drawn line: below a pixel
DECIMALS = 3
OVERVIEW = "plan.json"


def layer_file(index: int) -> str:
    """File name of a layer's document."""
    return f"layer_{index:05d}.json"


def _place(layer: Layer) -> dict[str, Any]:
    """Where a layer lies and what of it rests on nothing; mm, mm², deg, build frame.

    bottom, top : point and unit normal of the bounding planes; z_bottom, z_top, the heights of those points, say where a
    layer is only if its tilt_deg (of the bottom plane from level) is 0
    """
    tilt = math.degrees(math.acos(min(max(float(layer.bottom[5]), -1.0), 1.0)))
    return {
        "index": layer.index,
        "z_bottom": round(float(layer.bottom[2]), 4),
        "z_top": round(float(layer.top[2]), 4),
        "bottom": _rounded(layer.bottom),
        "top": _rounded(layer.top),
        "tilt_deg": round(tilt, 3),
        "thickness_mm": [round(float(value), 4) for value in layer.thickness_mm],
        "subcomponent": layer.subcomponent,
        "overlap_mm2": round(float(layer.overlap_mm2), 3),
        "overhang_mm2": round(float(layer.overhang_mm2), 3),
    }


def _rounded(values: Any, decimals: int = 6) -> list[float]:
    found: list[float] = (np.round(np.asarray(values, dtype=np.float64), decimals) + 0.0).ravel().tolist()
    return found


def _length_mm(operation: Operation) -> float:
    return sum(float(pass_.tip.length) for pass_ in operation.passes if not pass_.is_link)


def overview(plan: Plan) -> dict[str, Any]:
    """The part, how it is divided, and its layers with their operations; lengths in mm without links."""
    from planner.show.division import division_figures

    layers = [
        {
            **_place(layer),
            "operations": [
                {
                    "index": index,
                    "process": operation.process.value,
                    "passes": len(operation.passes),
                    "length_mm": round(_length_mm(operation), 2),
                }
                for index, operation in enumerate(layer.operations)
            ],
        }
        for layer in plan.layers
    ]
    return {
        "part": plan.part_name,
        "material": plan.material,
        "process": plan.process,
        "layers": layers,
        "bounds": np.asarray(plan.bounds).tolist(),
        "build_from_part": np.asarray(plan.build_from_part).tolist(),
        "tolerance_mm": plan.tolerance_mm,
        "findings": list(plan.findings),
        "volumes": dict(plan.volumes_mm3),
        **division_figures(plan),
    }


def _pass(pass_: Pass) -> dict[str, Any]:
    points = pass_.tip.evaluate(pass_.tip.sample(CHORD_TOLERANCE_MM))[:, :3]
    rows = np.atleast_2d(pass_.setpoints)
    return {
        "link": bool(pass_.is_link),
        "laser_w": round(float(rows[:, 2].max()), 1) if rows.size else 0.0,
        "feed_mm_s": round(float(rows[:, 1].max()), 3) if rows.size else 0.0,
        "points": _rounded(points, DECIMALS),
    }


def layer_view(layer: Layer) -> dict[str, Any]:
    """A layer's passes, and closed outlines of what rests on nothing, as polylines: x0, y0, z0, x1, ... in mm, build frame."""
    operations = [
        {
            "index": index,
            "process": operation.process.value,
            "note": operation.note,
            "passes": [_pass(pass_) for pass_ in operation.passes],
        }
        for index, operation in enumerate(layer.operations)
    ]
    overhang = [_rounded(np.vstack([outline, outline[:1]]), DECIMALS) for outline in layer.overhang]
    return {**_place(layer), "overhang": overhang, "operations": operations}


def write_layer(layer: Layer, number: int, folder: Path) -> None:
    """Write one layer's document into the folder; it is there whole or not at all. number : its place in the plan"""
    unfinished = folder / f"{layer_file(number)}.part"
    unfinished.write_bytes(msgspec.json.encode(layer_view(layer)))
    unfinished.rename(folder / layer_file(number))


def write_overview(plan: Plan, folder: Path) -> None:
    """Write the overview beside the layers."""
    (folder / OVERVIEW).write_bytes(msgspec.json.encode(overview(plan)))


def layers_written(folder: Path) -> int:
    """How many layers' documents the folder holds, 0 if it is not there (yet or any more)."""
    return sum(1 for _ in folder.glob("layer_*.json"))
