"""Skeletons against axes that are known: where limbs end, where they join, how thick they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike, NDArray

import config
from planner.decompose.skeleton import skeleton
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.plan import Skeleton
from tests.unit.planner.decompose.bent_parts import bend, boxed, finer, rough, straight, swept, united, without

Floats = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])
PARTS = Path(config.__file__).parent / "parts"


def degrees(graph: Skeleton) -> NDArray[np.int64]:
    return np.bincount(graph.edges.reshape(-1), minlength=len(graph.nodes))


def ends(graph: Skeleton) -> Floats:
    """(k, 3) float, mm   Nodes with one edge."""
    return graph.nodes[degrees(graph) == 1]


def assert_ends_near(graph: Skeleton, expected: ArrayLike, within_mm: float) -> None:
    """Every end expected is met by one end, and there are no others."""
    wanted, found = np.asarray(expected, dtype=np.float64), ends(graph)
    assert len(found) == len(wanted), found
    apart = np.linalg.norm(found[:, None, :] - wanted[None, :, :], axis=2)
    assert sorted(apart.argmin(axis=1).tolist()) == list(range(len(wanted)))
    assert apart.min(axis=1).max() < within_mm, found


def assert_one_graph(graph: Skeleton) -> None:
    label = np.arange(len(graph.nodes))
    for _ in range(len(label)):
        low = np.minimum(label[graph.edges[:, 0]], label[graph.edges[:, 1]])
        before = label.copy()
        np.minimum.at(label, graph.edges[:, 0], low)
        np.minimum.at(label, graph.edges[:, 1], low)
        if (label == before).all():
            break
    assert (label == 0).all()


def away_from(graph: Skeleton, start: ArrayLike, end: ArrayLike) -> Floats:
    """(n,) float, mm   Distance of each node from a line segment."""
    first, way = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64) - np.asarray(start, dtype=np.float64)
    share = np.clip((graph.nodes - first) @ way / (way @ way), 0.0, 1.0)
    return np.asarray(np.linalg.norm(graph.nodes - first - share[:, None] * way, axis=1))


def tee() -> Mesh:
    return united([straight([0, 0, 0], [0, 0, 35], 5.0), straight([-25, 0, 35], [25, 0, 35], 5.0)])


def branching() -> Mesh:
    limbs = [straight([0, 0, 24], [20 * side, 0, 50], 5.0) for side in (-1, 1)]
    return united([straight([0, 0, 0], [0, 0, 25], 5.0), *limbs])


def test_cylinder_has_its_axis_and_its_radius() -> None:
    graph = skeleton(straight([3, 4, 0], [3, 4, 40], 5.0), UP)
    assert_ends_near(graph, [(3, 4, 0), (3, 4, 40)], 0.01)
    assert np.linalg.norm(graph.nodes[:, :2] - (3, 4), axis=1).max() < 0.01
    assert graph.radii == pytest.approx(5.0, abs=0.02)


def test_cone_grows_thinner_along_its_axis() -> None:
    graph = skeleton(swept([[0, 0, 0], [0, 0, 40]], [10.0, 5.0]), UP)
    inner = (graph.nodes[:, 2] > 8.0) & (graph.nodes[:, 2] < 32.0)
    assert graph.radii[inner] == pytest.approx(10.0 - graph.nodes[inner, 2] / 8.0, abs=0.1)


def test_axis_of_a_quarter_torus_is_its_circle_whatever_the_direction() -> None:
    for direction in (UP, -UP, np.array([0.0, 1.0, 0.3])):
        graph = skeleton(bend(20.0, 5.0), direction)
        assert_ends_near(graph, [(0, 0, 0), (20, 0, 20)], 0.6)
        aside = np.hypot(np.hypot(graph.nodes[:, 0] - 20.0, graph.nodes[:, 2]) - 20.0, graph.nodes[:, 1])
        assert aside.max() < 0.1


def test_branching_of_three_cylinders_joins_where_their_axes_meet() -> None:
    graph = skeleton(branching(), UP)
    assert_ends_near(graph, [(0, 0, 0), (20, 0, 50), (-20, 0, 50)], 0.1)
    joint = graph.nodes[degrees(graph) == 3]
    assert len(joint) == 1
    assert np.linalg.norm(joint[0] - (0, 0, 24)) < 1.0
    limbs = [((0, 0, 0), (0, 0, 30)), ((0, 0, 24), (20, 0, 50)), ((0, 0, 24), (-20, 0, 50))]
    assert np.min([away_from(graph, *limb) for limb in limbs], axis=0).max() < 0.6


def test_level_arms_of_a_tee_have_branches_of_their_own_with_their_true_radius() -> None:
    graph = skeleton(tee(), UP)
    assert_ends_near(graph, [(0, 0, 0), (-25, 0, 35), (25, 0, 35)], 0.1)
    assert np.linalg.norm(graph.nodes[degrees(graph) == 3] - (0, 0, 35), axis=1) == pytest.approx([0.0], abs=0.3)
    assert graph.radii == pytest.approx(5.0, abs=0.15)


def test_cross_has_four_ends_and_one_joint() -> None:
    graph = skeleton(united([tee(), straight([0, 0, 34], [0, 0, 60], 5.0)]), UP)
    assert_ends_near(graph, [(0, 0, 0), (-25, 0, 35), (25, 0, 35), (0, 0, 60)], 0.1)
    assert np.linalg.norm(graph.nodes[degrees(graph) > 2] - (0, 0, 35), axis=1).max() < 0.5


def test_axis_of_a_tube_with_side_branches_runs_in_its_bores() -> None:
    outer = [straight([0, 0, 0], [0, 0, 60], 10.0), straight([0, 0, 20], [28, 0, 20], 6.0), straight([0, 0, 40], [0, -25, 48], 6.0)]
    bores = [straight([0, 0, -1], [0, 0, 61], 8.0), straight([0, 0, 20], [29, 0, 20], 4.5)]
    bores.append(straight([0, 0, 40], [0, -27.5, 48.8], 4.5))
    graph = skeleton(without(united(outer), bores), UP)
    assert_ends_near(graph, [(0, 0, 0), (0, 0, 60), (28, 0, 20), (0, -25, 48)], 0.2)
    joints = graph.nodes[degrees(graph) == 3]
    assert np.sort(joints[:, 2]) == pytest.approx([20.0, 40.0], abs=0.5)
    ring = np.sqrt(10.0**2 - 8.0**2)
    main = (np.hypot(graph.nodes[:, 0], graph.nodes[:, 1]) < 0.1) & (graph.nodes[:, 2] < 10.0)
    assert graph.radii[main] == pytest.approx(ring, abs=0.1)


def test_double_arc_is_a_stem_with_two_arms_in_one_plane() -> None:
    graph = skeleton(load(PARTS / "double_arc.stl"), UP)
    assert_ends_near(graph, [(0, 0, 0), (32.87, 0, 47.6), (-32.87, 0, 47.6)], 0.15)
    assert (degrees(graph) == 3).sum() == 1
    assert np.abs(graph.nodes[:, 1]).max() < 0.05
    assert_one_graph(graph)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, -1, 0), (0, 1, 0), (0, 0, -1)])
def test_hinge_has_five_ends_block_two_knuckles_and_two_pins(direction: tuple[float, float, float]) -> None:
    graph = skeleton(load(PARTS / "hinge.stl"), np.array(direction, dtype=np.float64))
    limbs = [(12, 0, 22), (48, 0, 22), (15, 36, 0), (45, 36, 0)]
    apart = np.linalg.norm(ends(graph)[:, None, :] - np.array(limbs)[None, :, :], axis=2)
    assert apart.min(axis=0).max() < 0.2
    assert len(apart) == 5
    pins = (graph.nodes[:, 2] < 14.0) & (graph.nodes[:, 2] > 1.0)
    assert graph.radii[pins] == pytest.approx(5.0, abs=0.05)
    assert_one_graph(graph)


def test_legs_of_a_table_are_branches_of_its_top() -> None:
    legs = [straight([x, y, 0], [x, y, 31], 3.0) for x in (6, 54) for y in (6, 34)]
    graph = skeleton(united([boxed([0, 0, 30], [60, 40, 36]), *legs]), UP)
    assert_ends_near(graph, [(6, 6, 0), (6, 34, 0), (54, 6, 0), (54, 34, 0), (30, 20, 36)], 0.1)


def test_ring_is_a_closed_way_round_its_hole() -> None:
    graph = skeleton(without(straight([0, -4, 20], [0, 4, 20], 20.0), [straight([0, -5, 20], [0, 5, 20], 14.0)]), UP)
    assert (degrees(graph) == 2).all()
    assert len(graph.edges) == len(graph.nodes)
    assert np.hypot(graph.nodes[:, 0], graph.nodes[:, 2] - 20.0) == pytest.approx(17.0, abs=0.6)


def test_boss_of_one_bead_is_a_branch_of_its_block() -> None:
    graph = skeleton(united([boxed([0, 0, 0], [60, 40, 20]), straight([20, 20, 19], [20, 20, 24], 1.5)]), UP)
    assert np.linalg.norm(ends(graph) - (20, 20, 24), axis=1).min() < 0.1
    assert len(ends(graph)) == 2


@pytest.mark.parametrize("make", [tee, branching])
def test_finer_and_rough_copies_have_the_same_graph(make: object) -> None:
    assert callable(make)
    part = make()
    first, other = skeleton(part, UP), skeleton(rough(finer(part, 2.0), 0.03), UP)
    assert_ends_near(other, ends(first), 0.4)
    assert np.sort(degrees(other)[degrees(other) > 2]).tolist() == np.sort(degrees(first)[degrees(first) > 2]).tolist()


def test_bodies_that_overlap_or_are_there_twice_count_once() -> None:
    stem, bar = straight([0, 0, 0], [0, 0, 35], 5.0), straight([-25, 0, 35], [25, 0, 35], 5.0)
    vertices = np.vstack([stem.vertices, bar.vertices, bar.vertices])
    first, second = len(stem.vertices), len(stem.vertices) + len(bar.vertices)
    graph = skeleton(Mesh(vertices, np.vstack([stem.facets, bar.facets + first, bar.facets + second])), UP)
    assert_ends_near(graph, [(0, 0, 0), (-25, 0, 35), (25, 0, 35)], 0.1)


def test_turned_part_has_the_same_skeleton_turned() -> None:
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.3, 0.6, 0.1]))[:3, :3]
    graph = skeleton(Mesh(tee().vertices @ turn.T, tee().facets), turn @ UP)
    assert_ends_near(graph, np.array([(0, 0, 0), (-25, 0, 35), (25, 0, 35)]) @ turn.T, 0.3)


def test_same_part_gives_the_same_skeleton_to_the_last_bit() -> None:
    first, second = (skeleton(branching(), UP) for _ in range(2))
    assert first.nodes.tobytes() == second.nodes.tobytes()
    assert first.radii.tobytes() == second.radii.tobytes()
    assert first.edges.tobytes() == second.edges.tobytes()
