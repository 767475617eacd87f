"""Figures of a plan by layer and by process: lengths, times at the programmed feed, powder; what pages show and compare."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from planner.plan import Layer, Pass, Plan

RAPID_MM_S = 100.0  # links without a feed of their own, as in the planner's heat balance
_KINDS = ("deposit_mm", "mill_mm", "deposit_s", "mill_s", "link_s", "powder_g")


def figures_of(plan: Plan) -> dict[str, Any]:
    """Per layer: place, direction, lengths (mm), times (s) and powder (g); totals by process with their tools.

    Times are at the programmed feed, without acceleration, tool changes and waits: those are the program's.
    """
    processes: dict[tuple[str, float], dict[str, Any]] = {}
    layers = [_layer(layer, processes) for layer in plan.layers]
    totals = {kind: round(math.fsum(layer[kind] for layer in layers), 3) for kind in _KINDS}
    return {
        "part": plan.part_name,
        "material": plan.material,
        "layers": layers,
        "processes": list(processes.values()),
        "totals": totals,
        "volumes_mm3": {name: round(float(value), 3) for name, value in plan.volumes_mm3.items()},
    }


def _layer(layer: Layer, processes: dict[tuple[str, float], dict[str, Any]]) -> dict[str, Any]:
    sums = dict.fromkeys(_KINDS, 0.0)
    for operation in layer.operations:
        kind = "deposit" if operation.process.is_deposit else "mill"
        key = operation.process.value, operation.cutter_diameter_mm
        row = processes.setdefault(
            key, {"process": key[0], "cutter_diameter_mm": key[1], "operations": 0, "passes": 0, "length_mm": 0.0, "time_s": 0.0}
        )
        row["operations"] += 1
        for item in operation.passes:
            length, time_s, powder_g = _pass(item)
            sums["powder_g"] += powder_g
            if item.is_link:
                sums["link_s"] += time_s
                continue
            sums[f"{kind}_mm"] += length
            sums[f"{kind}_s"] += time_s
            row["passes"] += 1
            row["length_mm"] = round(row["length_mm"] + length, 3)
            row["time_s"] = round(row["time_s"] + time_s, 3)
    return {
        "index": layer.index,
        "subcomponent": layer.subcomponent,
        "z_top_mm": round(float(layer.top[2]), 4),
        "direction": [round(float(value), 4) + 0.0 for value in layer.bottom[3:]],
        "thickness_mm": [round(float(value), 4) for value in layer.thickness_mm],
        **{kind: round(value, 3) for kind, value in sums.items()},
    }


def _pass(item: Pass) -> tuple[float, float, float]:
    """Length (mm), time (s) and powder (g) of one pass."""
    length, rows = item.tip.length, item.setpoints
    stretch = np.maximum(np.append(rows[1:, 0], length) - rows[:, 0], 0.0)
    time_s = stretch / np.where(rows[:, 1] > 0.0, rows[:, 1], RAPID_MM_S)
    return length, float(time_s.sum()), float((time_s * rows[:, 3]).sum() / 60.0)
