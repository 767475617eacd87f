"""What the probe's readings say of a machine: which rotary joint turns the wrong way, where its pivot really is.

The zero of a rotary joint is not told apart from its pivot by touches of one ball and one cube: a level set on the table, or the
probe swept along an edge, shows it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from planner.errors import PostError
from planner.kinematics.chain import TOOL_AXIS, Chain, ChainJoint
from planner.post.selftest import SelfTest, Touch

Floats = NDArray[np.float64]

AGREES_MM = 0.02
"""Rest of all touches below which the chain as it was tried is that of the machine; a touch trigger probe repeats to 1-5 um."""
_PRB = re.compile(r"\[PRB:([-0-9.,]+):([01])\]")
_SENSES: tuple[tuple[float, float], ...] = tuple(product((1.0, -1.0), (1.0, -1.0)))
_STIFF = 1e-4  # of a correction, per mm: keeps those at zero of which the touches say nothing


@dataclass(frozen=True)
class Judgement:
    """What the readings come to.

    rest_mm : root mean square of what the cell file leaves unexplained, over the touches
    turned : letters of rotary joints that turn against the cell file   missed : numbers of touches that met nothing, from 1
    pivots_mm : letter -> (3,) by how much its pivot is off, across its direction
    explained_mm : rest when all that is put right   lines : one each, for a person
    """

    rest_mm: float
    turned: tuple[str, ...]
    missed: tuple[int, ...]
    pivots_mm: dict[str, Floats]
    explained_mm: float
    lines: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether the cell file describes the machine."""
        return self.rest_mm <= AGREES_MM and not self.missed


def read_readings(text: str, test: SelfTest) -> list[Floats | None]:
    """Readings in the order of the touches from what the control said; None: touched nothing.

    text : lines with `[PRB:x,y,z,a,c:1]`, machine coordinates, others are passed over. Raises PostError.
    """
    readings: list[Floats | None] = []
    for values, touched in _PRB.findall(text):
        joints = np.array([float(value) for value in values.split(",")])
        if len(joints) != len(test.cell.letters):
            raise PostError(
                f"reading {len(readings) + 1} has {len(joints)} axes, cell {test.cell.name} has {len(test.cell.letters)}",
                "give the readings of this cell",
            )
        readings.append(joints if touched == "1" else None)
    first = sum(touch.stage == 1 for touch in test.touches)
    if len(readings) not in (first, len(test.touches)):
        raise PostError(
            f"{len(readings)} readings, the self-test has {first} touches in its first stage and {len(test.touches)} in all",
            "give all [PRB:...] lines of one run, in order, and no others",
        )
    return readings


def judge(test: SelfTest, readings: Sequence[Floats | None]) -> Judgement:
    """Senses of the rotary joints by the first stage, with the pivots as the cell file says; pivots by all touches.

    Raises PostError if nothing at all was touched.
    """
    touched = [(touch, joints) for touch, joints in zip(test.touches, readings, strict=False) if joints is not None]
    missed = tuple(k + 1 for k, joints in enumerate(readings) if joints is None)
    if len(touched) < 5:
        raise PostError(
            f"{len(touched)} of {len(readings)} touches met something",
            "check where cube, ball and probe are, and the work offset",
        )
    rest = _rest(_fit(test, touched, (1.0, 1.0), is_free=False)[1])
    first = [item for item in touched if item[0].stage == 1]
    senses = min(_SENSES, key=lambda pair: _rest(_fit(test, first, pair, is_free=False)[1]))
    is_whole = len(readings) > sum(touch.stage == 1 for touch in test.touches)
    found, residuals = _fit(test, touched, senses, is_free=is_whole)
    explained = _rest(residuals)
    rotary = test.chain.rotary
    turned = tuple(joint.letter for joint, sense in zip(rotary, senses, strict=True) if sense < 0.0)
    pivots = {joint.letter: _across(joint) @ found[6 + 2 * k : 8 + 2 * k] for k, joint in enumerate(rotary)}
    lines = _lines(test, rest, turned, missed, pivots, explained, readings)
    return Judgement(rest, turned, missed, pivots, explained, lines)


def _fit(
    test: SelfTest, touched: list[tuple[Touch, Floats]], senses: tuple[float, float], *, is_free: bool
) -> tuple[Floats, Floats]:
    """Corrections (10,) and residuals (n,), mm: places of ball and cube (3 each), pivots (2 each).

    is_free : otherwise the artefacts' places alone are fitted.
    """
    free = 10 if is_free else 6
    joints = np.array([reading for _, reading in touched])
    with_cube = any(touch.body == "cube" for touch, _ in touched)

    def residuals(values: Floats) -> Floats:
        found = np.zeros(10)
        found[:free] = values
        off = _off(test, touched, joints, senses, found)
        return np.concatenate([off, _STIFF * values[6:], np.zeros(0) if with_cube else _STIFF * values[3:6]])

    solved = least_squares(residuals, np.zeros(free), method="lm" if len(touched) > free else "trf")
    found = np.zeros(10)
    found[:free] = solved.x
    return found, _off(test, touched, joints, senses, found)


def _off(
    test: SelfTest, touched: list[tuple[Touch, Floats]], joints: Floats, senses: tuple[float, float], found: Floats
) -> Floats:
    """(n,) mm: how far each reading's probe is off the surface that it touched, seen by the corrected chain."""
    rotary = test.chain.rotary
    corrected = {
        joint.letter: replace(
            joint,
            direction=sense * joint.direction,
            point=joint.point + _across(joint) @ found[6 + 2 * k : 8 + 2 * k],
        )
        for k, (joint, sense) in enumerate(zip(rotary, senses, strict=True))
    }
    chain = Chain(
        test.chain.letters,
        tuple(corrected.get(joint.letter, joint) for joint in test.chain.table),
        tuple(corrected.get(joint.letter, joint) for joint in test.chain.head),
    )
    tips = chain.forward(joints, test.probe_tip_mm)[0]
    build_from_table = np.linalg.inv(test.placed)
    tips = tips @ build_from_table[:3, :3].T + build_from_table[:3, 3]
    artefact = test.artefact
    radius = 0.5 * artefact.probe_ball_mm
    to_ball = np.linalg.norm(tips - (artefact.ball_mm + found[:3]), axis=1) - (0.5 * artefact.ball_diameter_mm + radius)
    normals = np.array([touch.normal for touch, _ in touched])
    from_cube = np.einsum("ij,ij->i", tips - (artefact.cube_mm + found[3:6]), normals)
    is_ball = np.array([touch.body == "ball" for touch, _ in touched])
    return np.asarray(np.where(is_ball, to_ball, from_cube - (0.5 * artefact.edge_mm + radius)))


def _across(joint: ChainJoint) -> Floats:
    """(3, 2) two unit vectors at right angles to a joint's direction: along it a pivot may lie anywhere."""
    other = TOOL_AXIS if abs(joint.direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = np.cross(joint.direction, other)
    u /= np.linalg.norm(u)
    return np.column_stack([u, np.cross(joint.direction, u)])


def _rest(residuals: Floats) -> float:
    return float(np.sqrt(np.mean(residuals**2)))


def _lines(
    test: SelfTest,
    rest: float,
    turned: tuple[str, ...],
    missed: tuple[int, ...],
    pivots: dict[str, Floats],
    explained: float,
    readings: Sequence[Floats | None],
) -> tuple[str, ...]:
    first = sum(touch.stage == 1 for touch in test.touches)
    stage = "first stage" if len(readings) <= first else "both stages"
    if rest <= AGREES_MM and not missed:
        return (f"{stage}: the cell file describes this machine: {rest:.4f} mm rest over {len(readings)} touches",)
    lines = [f"{stage}: the cell file does not describe this machine: {rest:.3f} mm rest over {len(readings)} touches"]
    if missed:
        lines.append(f"touches that met nothing: {', '.join(map(str, missed))}")
    lines += [f"joint {letter} turns the other way: negate its direction in [[kinematics]]" for letter in turned]
    if len(readings) > first:
        for letter, way in pivots.items():
            if np.abs(way).max() > AGREES_MM:
                x, y, z = (f"{value:+.3f}" for value in way)
                lines.append(f"pivot of {letter}: move placement.pivots_mm by x {x} y {y} z {z} mm")
    elif not turned:
        lines.append("senses are right; pivots are told by the second stage")
    lines.append(f"with that put right {explained:.4f} mm rest")
    return tuple(lines)
