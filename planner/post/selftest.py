"""Signs and pivots of a machine, tried on the machine: a cube and a ball touched from five directions, and the readings to expect.

A wrong sense of a rotary joint or a pivot that was never measured makes every tilted pass wrong while each axis by itself is
right. A touch probe sees it: the same ball, touched with the tool leaned in five directions, has to be found in one place.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Placement
from planner.errors import PostError, ReachError
from planner.kinematics.chain import TOOL_AXIS, Chain
from planner.kinematics.inverse import both_branches, linear_joints
from planner.kinematics.limits import excess
from planner.post.room import table_from_build

Floats = NDArray[np.float64]

FIRST_TURN_DEG = 2.0
"""Of the first stage: with a wrong sense the ball is then at most some millimetres away from where it is expected."""
LEANS_DEG = (45.0, 30.0, 20.0)
"""Of the tool in the second stage: the largest with which all touches lie within the travels."""
APPROACH_MM = 12.0
BEYOND_MM = 8.0
_NEAR_FEED_MM_MIN = 600.0
_PROBE_FEED_MM_MIN = 60.0
_DIRECTIONS = ("up", "+x", "-x", "+y", "-y")


@dataclass(frozen=True)
class Artefact:
    """Cube and ball on the plate, in the build frame, mm, and the probe that touches them.

    cube_mm : centre of the cube, its edges along x, y and z   edge_mm : its edge
    ball_mm : centre of the ball, on a stem from below   ball_diameter_mm : its diameter
    probe_length_mm : from the gauge point to the centre of the probe's ball   probe_ball_mm : diameter of that ball
    """

    cube_mm: tuple[float, float, float] = (-25.0, -25.0, 12.5)
    edge_mm: float = 25.0
    ball_mm: tuple[float, float, float] = (25.0, 25.0, 40.0)
    ball_diameter_mm: float = 25.0
    probe_length_mm: float = 120.0
    probe_ball_mm: float = 4.0

    def __post_init__(self) -> None:
        for name in ("edge_mm", "ball_diameter_mm", "probe_length_mm", "probe_ball_mm"):
            if not getattr(self, name) > 0.0:
                raise PostError(f"self-test: {name} is {getattr(self, name):g}", "give a length above 0 mm")
        half = 0.5 * self.edge_mm
        inside = np.clip(np.array(self.ball_mm) - self.cube_mm, -half, half) + self.cube_mm
        gap = float(np.linalg.norm(inside - self.ball_mm)) - 0.5 * self.ball_diameter_mm
        if gap < APPROACH_MM + self.probe_ball_mm:
            raise PostError(
                f"self-test: cube and ball are {gap:.1f} mm apart, the probe needs {APPROACH_MM + self.probe_ball_mm:.1f} mm",
                "set them farther apart",
            )


@dataclass(frozen=True)
class Touch:
    """One touch of the probe.

    stage : 1 senses, 2 pivots   direction : of the tool, in words   body : "ball" or "cube"
    normal : (3,) outward normal of the face or of the ball where it is touched, build frame
    axis : (3,) the tool's, build frame   tip_mm : (3,) centre of the probe's ball when it touches, build frame
    joints : (5,) the reading to expect, machine coordinates   near, beyond : (5,) where the touch begins, and where it gives up
    """

    stage: int
    direction: str
    body: str
    normal: Floats
    axis: Floats
    tip_mm: Floats
    joints: Floats
    near: Floats
    beyond: Floats


@dataclass(frozen=True)
class SelfTest:
    """The probe program, its touches in order, and with what it was made."""

    cell: Cell
    chain: Chain
    placed: Floats
    artefact: Artefact
    lean_deg: float
    touches: tuple[Touch, ...]
    lines: tuple[str, ...] = field(default=())

    @property
    def probe_tip_mm(self) -> Floats:
        """(3,) float, mm, from the gauge point."""
        return np.array([0.0, 0.0, -self.artefact.probe_length_mm])


def make_selftest(cell: Cell, placement: Placement | None = None, artefact: Artefact | None = None) -> SelfTest:
    """The self-test of a cell: first each rotary joint alone by two degrees, then the tool leaned in five directions.

    Raises PostError (ReachError) if the touches do not lie within the travels, even with the least lean.
    """
    placement, artefact = placement or cell.placement, artefact or Artefact()
    chain = Chain.from_cell(cell, placement)
    placed = table_from_build(placement.part_origin_mm, placement.rotation_deg)
    first = _first_stage(cell, chain, placed, artefact)
    worst = ""
    for lean in LEANS_DEG:
        second, worst = _second_stage(cell, chain, placed, artefact, lean)
        if not worst:
            touches = (*first, *second)
            test = SelfTest(cell, chain, placed, artefact, lean, touches)
            return SelfTest(cell, chain, placed, artefact, lean, touches, _lines(test))
    raise ReachError(
        f"self-test of cell {cell.name}: {worst}, with the tool leaned by {LEANS_DEG[-1]:g} deg",
        "set cube and ball nearer to the middle of the travels, or take a shorter probe",
    )


def _first_stage(cell: Cell, chain: Chain, placed: Floats, artefact: Artefact) -> list[Touch]:
    """The ball from above and from four sides: all rotary joints at zero, then each alone by a little, then both."""
    touches: list[Touch] = []
    poses = [("all at zero", np.zeros(5))]
    both = np.zeros(5)
    for joint in chain.rotary:
        turn = FIRST_TURN_DEG if cell.axis(joint.letter).max >= FIRST_TURN_DEG else -FIRST_TURN_DEG
        pose = np.zeros(5)
        pose[joint.column] = both[joint.column] = turn
        poses.append((f"{joint.letter} {turn:+g}", pose))
    poses.append(("both", both))
    for name, pose in poses:
        axis_table = chain.forward(pose[None, :], np.zeros(3))[1][0]
        axis = placed[:3, :3].T @ axis_table
        for normal in (axis, *_around(axis)):
            touches.append(_touch(1, name, "ball", normal, axis, pose, chain, placed, artefact))
    over = excess(cell.axes, np.array([pose for item in touches for pose in (item.near, item.joints, item.beyond)]))
    if over.any():
        letter = cell.letters[int(np.argmax(over.max(axis=0)))]
        raise ReachError(
            f"self-test of cell {cell.name}: axis {letter} would leave its travel by {over.max():.1f} with the tool upright over the ball",
            "set cube and ball nearer to the middle of the travels (placement), or take a shorter probe",
        )
    return touches


def _second_stage(
    cell: Cell, chain: Chain, placed: Floats, artefact: Artefact, lean_deg: float
) -> tuple[list[Touch], str]:
    """Ball and cube with the tool upright and leaned to four sides; and what keeps it from being done, empty if nothing does."""
    touches: list[Touch] = []
    s, c = float(np.sin(np.deg2rad(lean_deg))), float(np.cos(np.deg2rad(lean_deg)))
    ways = {"up": (0.0, 0.0), "+x": (1.0, 0.0), "-x": (-1.0, 0.0), "+y": (0.0, 1.0), "-y": (0.0, -1.0)}
    for name in _DIRECTIONS:
        x, y = ways[name]
        axis = np.array([s * x, s * y, c]) if name != "up" else TOOL_AXIS
        faces = [TOOL_AXIS, *(np.array([*ways[side], 0.0]) for side in _DIRECTIONS[1:] if name in ("up", side))]
        wanted = [("ball", normal) for normal in (axis, *_around(axis))] + [("cube", face) for face in faces]
        pose = _rotary(cell, chain, placed, axis, [_contact(body, n, artefact) for body, n in wanted], artefact)
        if pose is None:
            return [], f"no pose leans the tool towards {name} within the travels"
        touches += [_touch(2, name, body, n, axis, pose, chain, placed, artefact) for body, n in wanted]
    return touches, ""


def _rotary(
    cell: Cell, chain: Chain, placed: Floats, axis: Floats, tips: list[Floats], artefact: Artefact
) -> Floats | None:
    """(5,) joints whose rotary ones give the axis, with all tips (and the ways to them) within the travels; None if there are none."""
    reach = np.array(tips) @ placed[:3, :3].T + placed[:3, 3]
    length = np.array([0.0, 0.0, -artefact.probe_length_mm])
    poses, found = both_branches(chain, reach[:1], (placed[:3, :3] @ axis)[None, :], length)
    if not found.is_reachable.all():
        return None
    best, least = None, np.inf
    for branch in range(2):
        pose = poses[0, branch].copy()
        if found.is_free[0]:
            spin = chain.rotary[1] if chain.rotary[1] in chain.table else chain.rotary[0]
            if abs(float(spin.direction @ TOOL_AXIS)) > 1.0 - 1e-9:
                pose[spin.column] = 0.0
        joints = linear_joints(chain, np.tile(pose, (len(reach), 1)), reach, length)
        margin = np.array([APPROACH_MM if axis.kind == "linear" else 0.0 for axis in cell.axes])
        over = excess(cell.axes, joints + margin).max() + excess(cell.axes, joints - margin).max()
        way = float(np.abs(pose[[joint.column for joint in chain.rotary]]).sum())
        if over <= 0.0 and way < least:
            best, least = pose, way
    return best


def _contact(body: str, normal: Floats, artefact: Artefact) -> Floats:
    """(3,) mm, build frame: centre of the probe's ball when it touches a body where its normal is this."""
    radius = 0.5 * artefact.probe_ball_mm
    if body == "ball":
        return np.asarray(np.array(artefact.ball_mm) + (0.5 * artefact.ball_diameter_mm + radius) * normal)
    return np.asarray(np.array(artefact.cube_mm) + (0.5 * artefact.edge_mm + radius) * normal)


def _touch(
    stage: int,
    direction: str,
    body: str,
    normal: Floats,
    axis: Floats,
    pose: Floats,
    chain: Chain,
    placed: Floats,
    artefact: Artefact,
) -> Touch:
    tip = _contact(body, normal, artefact)
    tips = np.array([tip, tip + APPROACH_MM * normal, tip - BEYOND_MM * normal])
    length = np.array([0.0, 0.0, -artefact.probe_length_mm])
    joints = linear_joints(chain, np.tile(pose, (3, 1)), tips @ placed[:3, :3].T + placed[:3, 3], length)
    return Touch(stage, direction, body, np.asarray(normal), np.asarray(axis), tip, *joints)


def _around(axis: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Four unit vectors at right angles to an axis and to each other, or against each other."""
    other = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
    u = np.cross(axis, other)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    return u, -u, v, -v


def _lines(test: SelfTest) -> tuple[str, ...]:
    """G-code for grbl and grblHAL: every touch is a G38.3 and is answered by a [PRB:...] line."""
    cell, chain = test.cell, test.chain
    offset = np.array([cell.placement.work_offset.get(letter, 0.0) for letter in cell.letters])
    lift, top = _retracting(cell, chain)

    def words(joints: Floats, columns: list[int]) -> str:
        return " ".join(f"{cell.letters[k]}{joints[k] - offset[k]:.4f}" for k in columns)

    every = list(range(len(cell.letters)))
    others = [k for k in every if k != lift]
    linear = [joint.column for joint in chain.linear]
    lines = [
        f"(SELF-TEST OF CELL {_said(cell.name)})",
        f"(PROBE: LENGTH {test.artefact.probe_length_mm:g}, BALL D{test.artefact.probe_ball_mm:g}; LEAN {test.lean_deg:g} DEG)",
        "G21 G90 G94 G54 G49",
    ]
    stage = 1
    for number, touch in enumerate(test.touches, start=1):
        up = touch.near.copy()
        up[lift] = top
        lines.append(f"G0 {words(up, [lift])}")
        if touch.stage != stage:
            stage = touch.stage
            lines.append(f"M0 (COMPARE TOUCHES 1 TO {number - 1} BEFORE GOING ON)")
        lines.append(f"({number}: TOOL {_said(touch.direction)}, {touch.body.upper()})")
        lines.append(f"G0 {words(up, others)}")
        lines.append(f"G1 {words(touch.near, [lift])} F{_NEAR_FEED_MM_MIN:g}")
        lines.append(f"G38.3 {words(touch.beyond, linear)} F{_PROBE_FEED_MM_MIN:g}")
        lines.append(f"G1 {words(touch.near, linear)} F{_NEAR_FEED_MM_MIN:g}")
    up = test.touches[-1].near.copy()
    up[lift] = top
    return (*lines, f"G0 {words(up, [lift])}", "M2")


def _retracting(cell: Cell, chain: Chain) -> tuple[int, float]:
    """Column of the linear joint that takes the tool up best, and the end of its travel there."""
    lifts = chain.linear_directions(np.zeros((1, 5)))[0] @ TOOL_AXIS
    joint = chain.linear[int(np.argmax(np.abs(lifts)))]
    axis = cell.axis(joint.letter)
    return joint.column, axis.max if lifts.max() >= -lifts.min() else axis.min


def _said(text: str) -> str:
    """Text that may stand in a comment."""
    return text.upper().replace("(", "").replace(")", "")
