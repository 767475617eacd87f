"""A Plan as the console shows it: an overview, one drawing per layer and one of the whole, made once with the plan and served as they are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from cellctl.planning.geometry import layer_document, layer_geometry, place_of

if TYPE_CHECKING:
    from planner.plan import Layer, Operation, Plan

OVERVIEW = "plan.json"
WHOLE = "whole.v2.bin"
"""Drawings of another version have other names: a folder without this file is made anew from its plan."""


def layer_file(index: int) -> str:
    """File name of a layer's drawing."""
    return f"layer_{index:05d}.v2.bin"


def _length_mm(operation: Operation) -> float:
    return sum(float(pass_.tip.length) for pass_ in operation.passes if not pass_.is_link)


def overview(plan: Plan) -> dict[str, Any]:
    """The part, how it is divided, and its layers with their operations; lengths in mm without links."""
    from planner.show.division import division_figures

    layers = [
        {
            **place_of(layer),
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


def layer_view(content: bytes) -> bytes:
    """A layer's drawing as JSON: its passes, and closed outlines of what rests on nothing, as polylines in mm, build frame.

    Raises ContainerError.
    """
    return msgspec.json.encode(layer_document(content))


def put(content: bytes, target: Path) -> None:
    """Write a file; it is there whole or not at all."""
    unfinished = target.with_name(f"{target.name}.part")
    unfinished.write_bytes(content)
    unfinished.replace(target)


def write_layer(layer: Layer, number: int, folder: Path) -> None:
    """Write one layer's drawing into the folder. number : its place in the plan"""
    put(layer_geometry(layer), folder / layer_file(number))


def write_overview(plan: Plan, folder: Path) -> None:
    """Write the overview and the drawing of the whole beside the layers, which are there."""
    put(msgspec.json.encode(overview(plan)), folder / OVERVIEW)
    write_whole(folder, len(plan.layers), float(np.linalg.norm(np.ptp(np.asarray(plan.bounds), axis=0))))


def write_whole(folder: Path, layers: int, diagonal_mm: float) -> None:
    """Write the drawing of all layers, from theirs. diagonal_mm : of the part"""
    from cellctl.planning.thinning import whole_geometry

    def contents() -> Iterator[bytes]:
        for number in range(layers):
            yield (folder / layer_file(number)).read_bytes()

    put(whole_geometry(contents(), layers, diagonal_mm), folder / WHOLE)


def layers_written(folder: Path) -> int:
    """How many layers' drawings the folder holds, 0 if it is not there (yet or any more)."""
    return sum(1 for _ in folder.glob("layer_*.v2.bin"))
