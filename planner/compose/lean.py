"""The head leaned away from what stands beside a piece, no more than needed, the tip kept on its path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from planner.collide.reach import HeadShape, PointTree, reach
from planner.nurbs.curve import Curve
from planner.plan import Operation, Pass
from planner.toolpath.motion import axis_at
from planner.toolpath.placed import turned_axis

Floats = NDArray[np.float64]

CLEARANCE_MM = 1.0
"""Between head and what stands: beads bulge, and obstacles are points a little apart."""
_STEP_DEG = 5.0  # between leans that are tried
_WAYS = 12  # directions of lean that are tried
_POSES = 60  # of an operation that are looked at
_HEAD = HeadShape()


@dataclass
class Lean:
    """How the head is leaned while a piece is deposited.

    tree : points of what stands, piece frame, mm   most_deg : that the material allows   angle_deg, way : the lean of now
    blocked : layers that no lean makes free, with how deep the head is in, mm
    """

    tree: PointTree
    most_deg: float
    turn: Floats = field(default_factory=lambda: np.eye(3))
    leaned: set[int] = field(default_factory=set)
    angle_deg: float = 0.0
    blocked: dict[int, float] = field(default_factory=dict)

    def away(self, operation: Operation, piece_from_operation: Floats | None = None) -> Operation:
        """The operation with all its axes leaned so far that the head keeps clear; itself where it is clear upright.

        operation : a deposition, without links   piece_from_operation : (4, 4) float, rigid; none: piece frame.
        """
        frame = np.eye(4) if piece_from_operation is None else piece_from_operation
        tips, axes = _poses(operation.passes, frame)
        if not operation.process.is_deposit or self._clearance(tips, axes) >= CLEARANCE_MM:
            return operation
        if not self._is_right(tips, axes):
            self.turn = self._found(tips, axes, operation.layer)
        if np.array_equal(self.turn, np.eye(3)):
            return operation
        self.leaned.add(operation.layer)
        self.angle_deg = max(self.angle_deg, float(np.degrees(np.arccos(np.clip(self.turn[2, 2], -1.0, 1.0)))))
        back = frame[:3, :3].T @ self.turn @ frame[:3, :3]
        return replace(operation, passes=tuple(_turned(step, back) for step in operation.passes))

    @property
    def findings(self) -> list[str]:
        """One line on leaned layers, one on those where the head has no room."""
        told = []
        if self.leaned:
            told.append(f"{len(self.leaned)} layers: the head leans by up to {self.angle_deg:.0f} deg off what stands beside it")
        if self.blocked:
            first, last = min(self.blocked), max(self.blocked)
            told.append(
                f"layers {first}-{last}: an ordinary head comes up to {max(self.blocked.values()):.1f} mm too near to what stands "
                "beside it, however it leans"
            )
        return told

    def _clearance(self, tips: Floats, axes: Floats) -> float:
        found = reach(tips, axes, self.tree, None, _HEAD, enough_mm=2.0 * CLEARANCE_MM)
        return float(found.clearance_mm.min())

    def _is_right(self, tips: Floats, axes: Floats) -> bool:
        """Whether the lean of the operation before is enough for this one too."""
        return not np.array_equal(self.turn, np.eye(3)) and self._clearance(tips, axes @ self.turn.T) >= CLEARANCE_MM

    def _found(self, tips: Floats, axes: Floats, layer: int) -> Floats:
        """(3, 3) float   The least lean that keeps clear; where none does, that which comes nearest to it."""
        best, most = np.eye(3), self._clearance(tips, axes)
        for turn in _leans(self.most_deg):
            leaned = axes @ turn.T
            if float(leaned[:, 2].min()) < np.cos(np.radians(self.most_deg)) - 1e-9:
                continue
            clearance = self._clearance(tips, leaned)
            if clearance > most + 1e-6:
                best, most = turn, clearance
            if clearance >= CLEARANCE_MM:
                return best
        if most < 0.0:
            self.blocked[layer] = max(self.blocked.get(layer, 0.0), -most)
        return best


def _leans(most_deg: float) -> Iterator[Floats]:
    """(3, 3) float each   Turns of the axis, the smallest first."""
    for angle in np.radians(np.arange(_STEP_DEG, most_deg + 1e-9, _STEP_DEG)):
        for number in range(_WAYS):
            way = 2.0 * np.pi * number / _WAYS
            about = np.array([-np.sin(way), np.cos(way), 0.0])
            cross = np.array([[0.0, -about[2], about[1]], [about[2], 0.0, -about[0]], [-about[1], about[0], 0.0]])
            yield np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def _poses(passes: tuple[Pass, ...], frame: Floats) -> tuple[Floats, Floats]:
    """Tips and axes, (n, 3) float each, along all passes, piece frame."""
    each = max(2, _POSES // max(len(passes), 1))
    tips, axes = [], []
    for step in passes:
        u = np.linspace(*step.tip.domain, each)
        tips.append(step.tip.evaluate(u))
        axes.append(np.array([axis_at(step.axis, value) for value in u]) if isinstance(step.axis, Curve) else np.tile(step.axis, (each, 1)))
    turn = frame[:3, :3]
    directions = np.vstack(axes) @ turn.T
    return np.vstack(tips) @ turn.T + frame[:3, 3], directions / np.linalg.norm(directions, axis=1)[:, None]


def _turned(step: Pass, turn: Floats) -> Pass:
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    return replace(step, axis=turned_axis(step.axis, matrix))
