"""Placement from touched points: centre of rotation, substrate plane, part origin, tool length. Least squares, with what is left over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Joint, Tool
from planner.kinematics.chain import Chain

Floats = NDArray[np.float64]

LEAST_TURN_DEG = 60.0  # over less of a turn the centre is read out of the noise
SAME_DEG = 0.01  # by which axes that are to stand still may differ
SPREAD_MM = 5.0  # least extent of points across their line: fewer make no plane


class TouchOffError(Exception):
    """Points that tell nothing. `message` is one line, `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


@dataclass(frozen=True)
class Touched:
    """One touched point. joints : machine coordinates per axis letter, mm or deg; tool : number of the one that touched"""

    joints: dict[str, float]
    tool: int


@dataclass(frozen=True)
class Found:
    """value : (3,) mm   what was measured   before : (3,) mm   what stands   residuals_mm : per point   tilt_deg : of a plane"""

    value: tuple[float, float, float]
    before: tuple[float, float, float]
    residuals_mm: tuple[float, ...]
    tilt_deg: float = 0.0

    @property
    def residual_mm(self) -> float:
        """Greatest of the residuals."""
        return max(self.residuals_mm, default=0.0)

    @property
    def shift_mm(self) -> tuple[float, float, float]:
        """From what stands to what was measured."""
        x, y, z = (after - was for after, was in zip(self.value, self.before, strict=True))
        return x, y, z


def tool_of(cell: Cell, number: int) -> Tool:
    """Tool by number. Raises TouchOffError."""
    tool = next((tool for tool in cell.tools if tool.number == number), None)
    if tool is None:
        raise TouchOffError(f"there is no tool T{number}", f"tools: {', '.join(f'T{tool.number}' for tool in cell.tools)}")
    return tool


def centre_of_rotation(cell: Cell, letter: str, points: Sequence[Touched]) -> Found:
    """Point on the rotary axis `letter`: one mark on the table, touched at three or more of its angles; all other rotary axes at 0.

    The mark q turns with the table: tip_i = c + R_i (q - c). With a rotary head the mark stands and the tip t turns:
    q = l_i + c + R_i (t - c), l_i being where the linear axes are. Both are linear in c and q; c moves across the axis only, from where
    it stands. Raises TouchOffError.
    """
    joint = next((one for one in (*cell.kinematics.table, *cell.kinematics.head) if one.axis == letter), None)
    if joint is None or cell.axis(letter).kind != "rotary":
        raise TouchOffError(f"{letter} is no rotary axis of this machine", "name one that turns")
    if len(points) < 3:
        raise TouchOffError(f"{len(points)} point(s): three or more are needed", "touch the same mark at other angles")
    _check_others(cell, letter, points)
    angles = np.array([point.joints[letter] for point in points])
    if np.ptp(angles) < LEAST_TURN_DEG:
        line = f"{letter} was turned by {np.ptp(angles):.0f} deg: {LEAST_TURN_DEG:.0f} deg or more are needed"
        raise TouchOffError(line, "touch the mark at angles farther apart")
    linear = np.array([_linear(cell, point) for point in points])
    tips = np.array([tool_of(cell, point.tool).tip_mm for point in points])
    before = np.array(cell.placement.pivots_mm.get(letter, joint.point_mm))
    centre, left = _solve(joint, before, angles, linear, tips, is_head=joint in cell.kinematics.head)
    return Found(_three(centre), _three(before), tuple(np.linalg.norm(left, axis=1).tolist()))


def _solve(joint: Joint, before: Floats, angles: Floats, linear: Floats, tips: Floats, *, is_head: bool) -> tuple[Floats, Floats]:
    """Centre (3,) and what is left over (n, 3)."""
    direction = np.array(joint.direction)
    across = np.linalg.svd(direction[None, :])[2][1:].T  # (3, 2) base of the plane across the axis
    eye, blocks, rights = np.eye(3), [], []
    for angle, place, tip in zip(angles, linear, tips, strict=True):
        turn = _turn(direction, float(np.deg2rad(angle)))
        if is_head:  # q - (I - R) c = l + R t
            blocks.append(np.hstack([-(eye - turn) @ across, eye]))
            rights.append(place + turn @ tip + (eye - turn) @ before)
        else:  # (I - R) c + R q = l + t
            blocks.append(np.hstack([(eye - turn) @ across, turn]))
            rights.append(place + tip - (eye - turn) @ before)
    matrix, right = np.vstack(blocks), np.concatenate(rights)
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    left = (right - matrix @ solution).reshape(-1, 3)
    return before + across @ solution[:2], left


def substrate_plane(cell: Cell, points: Sequence[Touched]) -> Found:
    """Part origin on the plane through three or more points of the plate, below where it stands. Raises TouchOffError."""
    if len(points) < 3:
        raise TouchOffError(f"{len(points)} point(s): three or more are needed", "touch the plate at other places, far apart")
    tips = _in_table(cell, points)
    extent = np.linalg.svd(tips[:, :2] - tips[:, :2].mean(axis=0), compute_uv=False)
    if extent[1] < SPREAD_MM:
        raise TouchOffError("the points lie on one line: they make no plane", "touch the plate at places that span a triangle")
    matrix = np.column_stack([tips[:, :2], np.ones(len(tips))])
    slope = np.linalg.lstsq(matrix, tips[:, 2], rcond=None)[0]
    before = np.array(cell.placement.part_origin_mm)
    steep = float(np.hypot(slope[0], slope[1]))
    value = np.array([before[0], before[1], slope @ [before[0], before[1], 1.0]])
    left = np.abs(tips[:, 2] - matrix @ slope) / np.hypot(1.0, steep)
    return Found(_three(value), _three(before), tuple(left.tolist()), float(np.degrees(np.arctan(steep))))


def part_origin(cell: Cell, points: Sequence[Touched]) -> Found:
    """Part origin in x and y at the mean of the points; its height stays. Raises TouchOffError."""
    if not points:
        raise TouchOffError("no point: one or more are needed", "put the tip where the part's origin is to be")
    tips = _in_table(cell, points)
    before, mean = np.array(cell.placement.part_origin_mm), tips.mean(axis=0)
    left = np.linalg.norm(tips[:, :2] - mean[:2], axis=1)
    return Found((float(mean[0]), float(mean[1]), float(before[2])), _three(before), tuple(left.tolist()))


def tool_length(cell: Cell, number: int, block_mm: float, points: Sequence[Touched]) -> Found:
    """Tip of a tool whose end stands on a gauge block of `block_mm` on the substrate, from the gauge point.

    A deposition head touches with its nozzle, which is its stand-off above the tip. Raises TouchOffError.
    """
    tool = tool_of(cell, number)
    if not points:
        raise TouchOffError("no point: one or more are needed", "lower the tool onto the gauge block or the feeler")
    if any(point.tool != number for point in points):
        raise TouchOffError(f"a point was touched with another tool than T{number}", f"put T{number} in and touch again")
    off = tool.nozzle.standoff_mm if tool.kind == "deposition" else 0.0
    upright = [letter for letter in cell.letters if letter != "C" and cell.axis(letter).kind == "rotary"]
    for letter in upright:
        if any(abs(point.joints[letter]) > SAME_DEG for point in points):
            raise TouchOffError(f"{letter} does not stand at 0: the tool has to stand upright on the plate", f"turn {letter} to 0")
    ends = _in_table(cell, points)[:, 2] + off
    by = cell.placement.part_origin_mm[2] + block_mm - ends
    x, y, z = tool.tip_mm
    return Found((x, y, z + float(by.mean())), tool.tip_mm, tuple(np.abs(by - by.mean()).tolist()))


def _in_table(cell: Cell, points: Sequence[Touched]) -> Floats:
    """(n, 3) mm, tips in the table frame by the chain as it stands."""
    chain = Chain.from_cell(cell)

    def tip(point: Touched) -> Floats:
        joints = np.array([[point.joints[letter] for letter in cell.letters]])
        tips: Floats = chain.forward(joints, np.array(tool_of(cell, point.tool).tip_mm))[0]
        return np.asarray(tips[0])

    return np.array([tip(point) for point in points])


def _linear(cell: Cell, point: Touched) -> Floats:
    """(3,) mm   What the linear joints of the head, less those of the table, move the tip by against the table."""
    way = np.zeros(3)
    for joints, sense in ((cell.kinematics.head, 1.0), (cell.kinematics.table, -1.0)):
        for joint in joints:
            if cell.axis(joint.axis).kind == "linear":
                way += sense * point.joints[joint.axis] * np.array(joint.direction)
    return way


def _check_others(cell: Cell, letter: str, points: Sequence[Touched]) -> None:
    for other in cell.letters:
        if other == letter or cell.axis(other).kind != "rotary":
            continue
        if any(abs(point.joints[other]) > SAME_DEG for point in points):
            raise TouchOffError(f"{other} does not stand at 0 in every point", f"turn {other} to 0, then touch at several angles of {letter}")


def _turn(direction: Floats, angle: float) -> Floats:
    """(3, 3) rotation about a unit vector by `angle` (rad), right-handed (Rodrigues)."""
    x, y, z = direction
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def _three(vector: Floats | Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector)
    return x, y, z
