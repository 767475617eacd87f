"""Forward of inverse is the identity for any chain: tilted and nutating rotaries, linear joints that are not square, singular poses."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from planner.kinematics.chain import Chain, ChainJoint, Floats, rotated
from planner.kinematics.inverse import RotaryPair, angle_about, both_branches, rotary_angles

LETTERS = ("X", "Y", "Z", "B", "C")
UP = np.array([0.0, 0.0, 1.0])
SQUARE = (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), UP)
NUTATING = (np.array([0.0, 0.5**0.5, 0.5**0.5]), np.array([0.5**0.5, 0.0, 0.5**0.5]), np.array([-0.5, 0.5**0.5, 0.5]))
coordinates = st.floats(-1.0, 1.0)
vectors = st.tuples(coordinates, coordinates, coordinates)
turns = st.one_of(st.floats(-180.0, 180.0), st.sampled_from((-180.0, -90.0, 0.0, 90.0, 180.0)), st.floats(-1e-6, 1e-6))


def unit(vector: tuple[float, float, float]) -> Floats:
    """The direction of a vector long enough to have one."""
    length = float(np.linalg.norm(vector))
    assume(length > 0.1)
    return np.asarray(np.array(vector, dtype=np.float64) / length, dtype=np.float64)


@st.composite
def directions(draw: st.DrawFn) -> Floats:
    """Any, along one of the machine's, or at 45 degrees to its z."""
    kind = draw(st.integers(0, 2))
    if kind == 0:
        return unit(draw(vectors))
    sign: float = draw(st.sampled_from((-1.0, 1.0)))
    return np.asarray(sign * draw(st.sampled_from(SQUARE if kind == 1 else NUTATING)), dtype=np.float64)


@st.composite
def chains(draw: st.DrawFn, aligns: bool = False) -> Chain:
    """Five joints in any order on any side, the linear ones up to 20 degrees from square; aligns : the tool can stand along the spin joint."""
    order, split = draw(st.permutations(range(5))), draw(st.integers(0, 5))
    places = [place for place, k in enumerate(order) if k >= 3]
    tilt_first = places[1] < split  # both on the table: the one that carries the part is the spin
    tilt = draw(directions())
    spin = rotated(UP[None, :], tilt, np.array([draw(turns)]))[0] if aligns else draw(directions())
    assume(np.linalg.norm(np.cross(spin, tilt)) > 0.3 and np.linalg.norm(np.cross(tilt, UP)) > 0.1)
    rotary = [tilt, spin] if tilt_first else [spin, tilt]
    ways = [unit(tuple(np.eye(3)[k] + 0.2 * np.array(draw(vectors)))) for k in range(3)]
    joints = []
    for k in order:
        if k < 3:
            joints.append(ChainJoint(LETTERS[k], k, False, ways[k], np.zeros(3)))
        else:
            joints.append(ChainJoint(LETTERS[k], k, True, rotary.pop(0), 300.0 * np.array(draw(vectors))))
    chain = Chain(LETTERS, tuple(joints[:split]), tuple(joints[split:]))
    assume(abs(np.linalg.det(chain.linear_directions(np.zeros((1, 5)))[0])) > 0.1)
    return chain


poses_drawn = st.lists(st.tuples(vectors, turns, turns), min_size=1, max_size=6)
tools = st.tuples(st.floats(-90.0, 90.0), st.floats(-90.0, 90.0), st.floats(-250.0, -50.0))


def check_both(chain: Chain, tip: Floats, axis: Floats, tool: Floats) -> Floats:
    """Both branches give tip and axis back to 1e-9; returns them, (n, 2, 5), with NaN where the linear joints do not span space."""
    found, angles = both_branches(chain, tip, axis, tool)
    assert angles.is_reachable.all()
    for branch in range(2):
        spans = np.asarray(np.isfinite(found[:, branch]).all(axis=1))
        ways = chain.linear_directions(np.where(spans[:, None], found[:, branch], 0.0))
        spans &= np.abs(np.linalg.det(ways)) > 0.05
        found[~spans, branch] = np.nan
        tip_again, axis_again = chain.forward(found[spans, branch], tool)
        assert np.abs(axis_again - axis[spans]).max(initial=0.0) < 1e-9
        assert np.abs(tip_again - tip[spans]).max(initial=0.0) < 1e-9
    return found


@settings(max_examples=40, deadline=None)
@given(chains(), poses_drawn, tools)
def test_forward_of_inverse_is_the_identity_on_both_branches_of_any_chain(
    chain: Chain, poses: list[tuple[tuple[float, float, float], float, float]], tool: tuple[float, float, float]
) -> None:
    joints = np.array([[*(200.0 * np.array(way)), b, c] for way, b, c in poses])
    tip, axis = chain.forward(joints, np.array(tool))
    found = check_both(chain, tip, axis, np.array(tool))
    pair = RotaryPair.of(chain)
    spin = chain.rotary[pair.spin]
    angle_deg = np.rad2deg(np.arcsin(np.clip(np.linalg.norm(np.cross(axis, spin.direction), axis=1), 0.0, 1.0)))
    gap = np.abs(found[:, 0, 3:] - found[:, 1, 3:]).max(axis=1)
    clear = (angle_deg > 0.1) & np.isfinite(found).all(axis=(1, 2)) & (gap > 0.1) & (gap < 359.9)
    turn = (found[:, :, 3:] - joints[:, None, 3:] + 180.0) % 360.0 - 180.0
    assert np.abs(turn).max(axis=2).min(axis=1)[clear].max(initial=0.0) < 1e-6, "one of the branches is where it came from"


@settings(max_examples=30, deadline=None)
@given(chains(aligns=True), vectors, st.sampled_from((-1.0, 1.0)), vectors, st.floats(0.0, 1e-6), tools)
def test_at_and_near_the_singular_pose_the_inverse_still_gives_tip_and_axis(
    chain: Chain,
    tip: tuple[float, float, float],
    sense: float,
    aside: tuple[float, float, float],
    off: float,
    tool: tuple[float, float, float],
) -> None:
    pair = RotaryPair.of(chain)
    spin = (pair.first, pair.second)[pair.spin].direction
    axis = unit(tuple(sense * spin + off * np.array(aside)))[None, :]
    assume(rotary_angles(pair, axis).is_reachable.all())
    assert check_both(chain, 200.0 * np.array([tip]), axis, np.array(tool)).shape == (1, 2, 5)


@settings(max_examples=30, deadline=None)
@given(chains(), turns, st.floats(-1e-5, 1e-5), st.sampled_from((0.0, 180.0)), vectors, tools)
def test_where_both_branches_meet_at_the_edge_of_what_the_rotaries_reach_the_inverse_is_exact(
    chain: Chain, spin_deg: float, off_deg: float, side_deg: float, way: tuple[float, float, float], tool: tuple[float, float, float]
) -> None:
    pair = RotaryPair.of(chain)
    tilt, spin = (pair.first, pair.second) if pair.spin == 1 else (pair.second, pair.first)
    sense = pair.sense[1 - pair.spin] * (-1.0 if pair.spin == 1 else 1.0)
    edge = angle_about(tilt.direction, UP[None, :], spin.direction[None, :])[0]  # brings the tool into the plane of both joints
    joints = np.zeros((1, 5))
    joints[0, :3] = 100.0 * np.array(way)
    joints[0, tilt.column] = sense * (edge + side_deg) + off_deg
    joints[0, spin.column] = spin_deg
    tip, axis = chain.forward(joints, np.array(tool))
    lifted = rotated(UP[None, :], tilt.direction, np.array([edge + side_deg]))[0]
    assert abs(lifted @ np.cross(tilt.direction, spin.direction)) < 1e-9
    assert check_both(chain, tip, axis, np.array(tool)).shape == (1, 2, 5)
