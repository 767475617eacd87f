"""Operations carried from one frame into another by a rigid motion: tip curves and tool axes alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.curve import Curve
from planner.plan import Operation, Pass

Floats = NDArray[np.float64]


def in_build(operation: Operation, build_from_layer: Floats) -> Operation:
    """The operation with all its passes in another frame.

    build_from_layer : (4, 4) float, rigid   from the frame of the passes (a layer's, a piece's) to that wanted, mm.
    Tips move, axes turn; set-points and everything else stay.
    """
    return replace(operation, passes=tuple(pass_in_build(step, build_from_layer) for step in operation.passes))


def pass_in_build(step: Pass, build_from_layer: Floats) -> Pass:
    """One pass in another frame, as `in_build`."""
    return replace(step, tip=step.tip.transformed(build_from_layer), axis=turned_axis(step.axis, build_from_layer))


def turned_axis(axis: Floats | Curve, build_from_layer: Floats) -> Floats | Curve:
    """A tool axis, constant or along a curve, in another frame: turned, not moved."""
    if not isinstance(axis, Curve):
        return np.asarray(build_from_layer[:3, :3] @ axis)
    turn = np.eye(4)
    turn[:3, :3] = build_from_layer[:3, :3]
    return axis.transformed(turn)
