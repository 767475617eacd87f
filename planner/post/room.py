"""Whether the part has room in the cell, before a line is made: build volume and travel."""

from __future__ import annotations

import itertools

import numpy as np

from config.cell import Cell, Tool
from planner.errors import PostError
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import RotaryPair, linear_joints
from planner.plan import Plan
from planner.post.poses import PoseSolver, Rows

_NAMES = "XYZ"
_SLACK_MM = 1e-6


def table_from_build(part_origin_mm: tuple[float, float, float], rotation_deg: float) -> Floats:
    """(4, 4) float: build frame to table frame, turned about z and moved."""
    angle = np.deg2rad(rotation_deg)
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = part_origin_mm
    return matrix


def check_room(plan: Plan, cell: Cell, chain: Chain, placed: Floats, tools: list[Tool]) -> None:
    """Raise PostError if the part, placed by the (4, 4) matrix, leaves the build volume or one of the travels.

    The message names the dimension, by how much, and what to do. Travel is that of the linear axes with each tool
    upright over the corners of the part's box; tilted poses are checked move by move later.
    """
    corners = check_volume(plan.bounds, cell, placed)
    for tool in tools:
        _check_linear_travel(corners, cell, chain, placed, tool)


def check_volume(bounds: Floats, cell: Cell, placed: Floats) -> Floats:
    """Raise PostError if a box, (2, 3) mm in the build frame and placed by the (4, 4) matrix, leaves the cell's build volume.

    Returns the corners of the box in the table frame, (8, 3) mm.
    """
    corners = np.array(list(itertools.product(*np.asarray(bounds, dtype=np.float64).T)))
    corners = corners @ placed[:3, :3].T + placed[:3, 3]
    low, high = np.array(cell.build_volume.min_mm), np.array(cell.build_volume.max_mm)
    least, most = corners.min(axis=0), corners.max(axis=0)
    for k in range(3):
        size, room = most[k] - least[k], high[k] - low[k]
        if size > room + _SLACK_MM:
            raise PostError(
                f"the part is {size:.1f} mm in {_NAMES[k]} on the table, the build volume {room:.1f} mm: {size - room:.1f} mm too large",
                "check the units, turn the part (placement.rotation_deg, build_direction), or take a larger machine",
            )
    over = np.maximum(np.maximum(low - least, most - high), 0.0)
    k = int(np.argmax(over))
    if over[k] > _SLACK_MM:
        way = low[k] - least[k] if least[k] < low[k] else high[k] - most[k]
        raise PostError(
            f"the part leaves the build volume by {over[k]:.1f} mm in {_NAMES[k]} ({least[k]:.1f} ... {most[k]:.1f}, "
            f"volume {low[k]:.1f} ... {high[k]:.1f} mm)",
            f"move placement.part_origin_mm by {way:+.1f} mm in {_NAMES[k]}",
        )
    return corners


def _check_linear_travel(corners: Floats, cell: Cell, chain: Chain, placed: Floats, tool: Tool) -> None:
    upright = np.tile(placed[:3, 2], (len(corners), 1))
    solver = PoseSolver(chain, cell, np.array(tool.tip_mm))
    zeros = np.zeros(len(corners))
    rows = Rows(
        corners, upright, zeros, zeros, np.zeros(len(corners), dtype=np.int64), np.zeros(len(corners), dtype=np.bool_)
    )
    poses = solver.solve(rows, np.zeros(5), ["the corners of the part's box"])
    columns = list(RotaryPair.of(chain).columns)
    joints = np.zeros_like(poses.joints)
    joints[:, columns] = poses.joints[0, columns]
    joints = linear_joints(chain, joints, corners, np.array(tool.tip_mm))
    for joint in chain.linear:
        axis = cell.axis(joint.letter)
        least, most = float(joints[:, joint.column].min()), float(joints[:, joint.column].max())
        over = max(axis.min - least, most - axis.max)
        if over > _SLACK_MM:
            larger = most - least - (axis.max - axis.min)
            what = (
                "take a larger machine or divide the part" if larger > 0 else "move the part (placement.part_origin_mm)"
            )
            raise PostError(
                f"axis {axis.letter}: the part needs {least:.1f} ... {most:.1f} mm with tool {tool.number}, travel is "
                f"{axis.min:g} ... {axis.max:g} mm: {over:.1f} mm too far",
                f"{what}, or take a tool of another length",
            )
