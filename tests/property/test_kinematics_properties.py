"""Inverse kinematics undoes forward kinematics for any chain of three linear and two rotary joints."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from config.cell import load_cell
from planner.kinematics.chain import Chain, ChainJoint
from planner.kinematics.inverse import RotaryPair, both_branches, rotary_angles, tilt_for_spin

LETTERS = ("X", "Y", "Z", "A", "C")
coordinates = st.floats(-1.0, 1.0)
vectors = st.tuples(coordinates, coordinates, coordinates)


def unit(vector: tuple[float, float, float]) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    assume(length > 0.1)
    return np.array(vector) / length


@st.composite
def chains(draw: st.DrawFn) -> Chain:
    """Rotary joints in any direction that is not degenerate, linear ones tilted by a little, joints on any side in any order."""
    ways = [unit(tuple(np.eye(3)[k] + 0.2 * np.array(draw(vectors)))) for k in range(3)]
    first, second = unit(draw(vectors)), unit(draw(vectors))
    assume(np.linalg.norm(np.cross(first, second)) > 0.3)
    joints = [ChainJoint(LETTERS[k], k, False, ways[k], np.zeros(3)) for k in range(3)]
    joints += [
        ChainJoint(LETTERS[3 + k], 3 + k, True, way, 100.0 * np.array(draw(vectors)))
        for k, way in enumerate((first, second))
    ]
    joints = draw(st.permutations(joints))
    split = draw(st.integers(0, 5))
    chain = Chain(LETTERS, tuple(joints[:split]), tuple(joints[split:]))
    assume(abs(np.linalg.det(chain.linear_directions(np.zeros((1, 5)))[0])) > 0.1)
    pair_first, pair_second = chain.rotary
    fixed = pair_first if pair_second in chain.table else pair_second
    assume(np.linalg.norm(np.cross(fixed.direction, [0.0, 0.0, 1.0])) > 0.1)
    return chain


@settings(max_examples=60)
@given(
    chains(), st.lists(st.tuples(vectors, st.floats(-179.0, 179.0), st.floats(-179.0, 179.0)), min_size=1, max_size=8)
)
def test_forward_of_inverse_is_the_identity_on_both_branches(
    chain: Chain, poses: list[tuple[tuple[float, float, float], float, float]]
) -> None:
    joints = np.array([[*(200.0 * np.array(way)), a, c] for way, a, c in poses])
    tool = np.array([10.0, -20.0, -150.0])
    ways = chain.linear_directions(joints)
    assume(np.abs(np.linalg.det(ways)).min() > 0.05)
    tip, axis = chain.forward(joints, tool)
    found, angles = both_branches(chain, tip, axis, tool)
    spin = chain.rotary[RotaryPair.of(chain).spin]
    clear = np.linalg.norm(np.cross(axis, spin.direction), axis=1) > 1e-3
    assert angles.is_reachable.all()
    came_from = np.full((len(joints), 2), np.inf)
    for branch in range(2):
        if np.abs(np.linalg.det(chain.linear_directions(found[:, branch]))).min() < 0.05:
            continue
        tip_again, axis_again = chain.forward(found[:, branch], tool)
        assert np.abs(axis_again - axis)[clear].max(initial=0.0) < 1e-9
        assert np.abs(tip_again - tip).max() < 1e-9
        turn = (found[:, branch, 3:] - joints[:, 3:] + 180.0) % 360.0 - 180.0
        came_from[:, branch] = np.abs(turn).max(axis=1)
    both_clear = clear & np.isfinite(came_from).all(axis=1)
    assert came_from.min(axis=1)[both_clear].max(initial=0.0) < 1e-3


@given(st.sampled_from(["trunnion_tcp", "head_head", "head_table"]), st.floats(-179.0, 179.0))
def test_at_the_singular_pose_any_spin_angle_has_its_tilt(name: str, spin_deg: float) -> None:
    chain = Chain.from_cell(load_cell(name))
    pair = RotaryPair.of(chain)
    spin, tilt = (pair.first, pair.second)[pair.spin], (pair.first, pair.second)[1 - pair.spin]
    axis = np.array([[0.0, 0.0, 1.0]])
    joints = np.zeros((1, 5))
    joints[0, spin.column] = spin_deg
    joints[0, tilt.column] = tilt_for_spin(pair, axis, np.array([spin_deg]))[0]
    assert rotary_angles(pair, axis).is_free.all()
    assert np.abs(chain.forward(joints, np.zeros(3))[1] - axis).max() < 1e-12
