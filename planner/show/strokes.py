"""Passes as plain polylines with a kind, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.plan import Layer, Pass, Process

Floats = NDArray[np.float64]

CHORD_MM = 0.02
KINDS = ("contour", "hatch", "overhang", "lead", "face", "side", "link", "rapid")
"""What a stroke is; `lead` is a depositing pass with the laser off."""
COLOURS = {
    "contour": "#d9480f",
    "hatch": "#f59f00",
    "overhang": "#c2255c",
    "lead": "#ced4da",
    "face": "#1098ad",
    "side": "#1c7ed6",
    "link": "#adb5bd",
    "rapid": "#868e96",
}
_OF_PROCESS = {
    Process.DEPOSIT_CONTOUR: "contour",
    Process.DEPOSIT_FILL: "hatch",
    Process.DEPOSIT_OVERHANG: "overhang",
    Process.MILL_FACE: "face",
    Process.MILL_SIDE: "side",
    Process.MILL_SCALLOP: "side",
}


@dataclass(frozen=True)
class Stroke:
    """One polyline.  kind : one of KINDS   points : (n, 3) float, mm, build frame   width_mm : of the bead or cutter."""

    kind: str
    points: Floats
    width_mm: float


def layer_strokes(layer: Layer) -> list[Stroke]:
    """All strokes of a layer in the order in which they are run."""
    found = []
    for operation in layer.operations:
        width = operation.bead_width_mm if operation.process.is_deposit else operation.cutter_diameter_mm
        for step in operation.passes:
            found.extend(_strokes(step, operation.process, width))
    return found


def _strokes(step: Pass, process: Process, width_mm: float) -> list[Stroke]:
    u = step.tip.sample(CHORD_MM)
    if step.is_link:
        return [Stroke("rapid" if step.rapid else "link", step.tip.evaluate(u), 0.0)]
    if not process.is_deposit or len(step.setpoints) == 1:
        return [Stroke(_OF_PROCESS[process], step.tip.evaluate(u), width_mm)]
    cuts = step.tip.at_arc_length(step.setpoints[1:, 0])
    u = np.unique(np.concatenate([u, cuts]))
    points = step.tip.evaluate(u)
    edges = [0, *np.searchsorted(u, cuts), len(u) - 1]
    return [
        Stroke(_OF_PROCESS[process] if row[2] > 0.0 else "lead", points[low : high + 1], width_mm)
        for row, low, high in zip(step.setpoints, edges[:-1], edges[1:], strict=True)
        if high > low
    ]
