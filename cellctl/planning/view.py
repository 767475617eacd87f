"""A Plan as the console shows it: an overview and one document per layer, made once with the plan and served as they are."""

from __future__ import annotations

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


def _heights(layer: Layer) -> dict[str, Any]:
    """z of the bounding planes at the layer's middle, mm, build frame."""
    return {"index": layer.index, "z_bottom": round(float(layer.bottom[2]), 4), "z_top": round(float(layer.top[2]), 4)}


def _length_mm(operation: Operation) -> float:
    return sum(float(pass_.tip.length) for pass_ in operation.passes if not pass_.is_link)


def overview(plan: Plan) -> dict[str, Any]:
    """The part and its layers with their operations; lengths in mm without links."""
    layers = [
        {
            **_heights(layer),
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
    }


def _pass(pass_: Pass) -> dict[str, Any]:
    points = np.round(pass_.tip.evaluate(pass_.tip.sample(CHORD_TOLERANCE_MM))[:, :3], DECIMALS) + 0.0
    rows = np.atleast_2d(pass_.setpoints)
    return {
        "link": bool(pass_.is_link),
        "laser_w": round(float(rows[:, 2].max()), 1) if rows.size else 0.0,
        "feed_mm_s": round(float(rows[:, 1].max()), 3) if rows.size else 0.0,
        "points": points.ravel().tolist(),
    }


def layer_view(layer: Layer) -> dict[str, Any]:
    """A layer's passes as polylines: x0, y0, z0, x1, ... in mm, build frame."""
    operations = [
        {
            "index": index,
            "process": operation.process.value,
            "note": operation.note,
            "passes": [_pass(pass_) for pass_ in operation.passes],
        }
        for index, operation in enumerate(layer.operations)
    ]
    return {**_heights(layer), "operations": operations}


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
