"""Distances of solids against analytic values and brute force."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.machine.against_solids import pair_distance
from sim.machine.bodies import BOX, FRUSTUM, HULL, MESH, Body, body_distance, pack
from sim.machine.facets import hull_shell, shell_of

EYE = np.eye(3, 4)


def at(x: float, y: float, z: float, rotation: np.ndarray | None = None) -> np.ndarray:
    pose = np.eye(3, 4)
    pose[:, 3] = x, y, z
    if rotation is not None:
        pose[:, :3] = rotation
    return pose


def gap(a: Body, b: Body, pose_a: np.ndarray, pose_b: np.ndarray) -> float:
    place = np.zeros(3)
    return float(pair_distance(pack([a, b]), 0, 1, pose_a, pose_b, 0.0, place))


def box(x: float, y: float, z: float) -> Body:
    return Body("box", 0, BOX, (0.5 * x, 0.5 * y, 0.5 * z), EYE)


def cylinder(radius: float, length: float, end: float | None = None) -> Body:
    return Body("cylinder", 0, FRUSTUM, (radius, radius if end is None else end, length), EYE)


def ball(radius: float) -> Body:
    mesh = trimesh.creation.icosphere(4, radius)
    return Body("ball", 0, HULL, (0.0, 0.0, 0.0), EYE, hull_shell(np.asarray(mesh.vertices)))


def cup() -> Body:
    """A block of 40 x 40 x 20 with a pocket of 20 x 20 x 10 in its top, centred on the origin in x and y, bottom at z = 0."""
    block, pocket = trimesh.creation.box((40, 40, 20)), trimesh.creation.box((20, 20, 20))
    block.apply_translation((0, 0, 10))
    pocket.apply_translation((0, 0, 20))
    mesh = block.difference(pocket)
    return Body("cup", 0, MESH, (0.0, 0.0, 0.0), EYE, shell_of(np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(mesh.vertices), False))


def turn(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def test_boxes_side_by_side_are_as_far_apart_as_their_faces() -> None:
    assert gap(box(2, 2, 2), box(4, 4, 4), at(0, 0, 0), at(8, 0.3, 0)) == pytest.approx(5.0, abs=2e-4)


def test_boxes_corner_to_corner_are_as_far_apart_as_their_corners() -> None:
    assert gap(box(2, 2, 2), box(2, 2, 2), at(0, 0, 0), at(5, 6, 4)) == pytest.approx(np.sqrt(9 + 16 + 4), abs=2e-4)


def test_overlapping_boxes_are_parted_by_the_shortest_way() -> None:
    assert gap(box(10, 10, 10), box(10, 10, 10), at(0, 0, 0), at(8.5, 1, 2)) == pytest.approx(-1.5, abs=1e-3)


def test_balls_are_as_far_apart_as_their_centres_less_their_radii() -> None:
    assert gap(ball(3), ball(5), at(0, 0, 0), at(6, 8, 0)) == pytest.approx(2.0, abs=0.03)
    assert gap(ball(3), ball(5), at(0, 0, 0), at(6, 0, 0)) == pytest.approx(-2.0, abs=0.03)


def test_crossed_cylinders_and_a_cone_over_a_plate_keep_their_analytic_gap() -> None:
    lying = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    assert gap(cylinder(3, 40), cylinder(2, 40), at(0, 0, -20), at(-20, 9, 0, lying)) == pytest.approx(4.0, abs=2e-4)
    assert gap(cylinder(6, 60, 25), box(100, 100, 10), at(0, 0, 13), at(0, 0, -5)) == pytest.approx(13.0, abs=2e-4)


def test_a_cone_beside_a_wall_is_nearest_at_its_wide_end() -> None:
    assert gap(cylinder(6, 60, 25), box(10, 200, 200), at(0, 0, 0), at(40, 0, 0)) == pytest.approx(10.0, abs=2e-4)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_random_poses_agree_with_the_sampled_surface(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = [box(*rng.uniform(2, 20, 3)), cylinder(rng.uniform(1, 10), rng.uniform(2, 20), rng.uniform(0, 10))]
    a, b = shapes[rng.integers(2)], shapes[rng.integers(2)]
    pose_a, pose_b = at(0, 0, 0, turn(rng)), at(*rng.uniform(-20, 20, 3), turn(rng))
    found = gap(a, b, pose_a, pose_b)
    solids = pack([a, b])
    points = rng.uniform(-30, 30, size=(800, 3))
    each = np.array([
        [body_distance(solids, n, *(pose[:, :3].T @ (point - pose[:, 3]))) for n, pose in ((0, pose_a), (1, pose_b))] for point in points
    ])  # fmt: skip
    both, together = each.max(axis=1), each.sum(axis=1)
    if found > 0.0:
        assert both.min() >= 0.5 * found - 1e-3  # no point is nearer to both than half the gap
        assert together.min() >= found - 1e-3
    if both.min() < -0.05:
        assert found < 0.0 and -found >= -together.min() - 1e-3  # the two are at least as deep in each other as the balls round any point


@pytest.mark.parametrize("body", [box(6, 8, 10), cylinder(4, 10, 2)], ids=["box", "cone"])
def test_signed_distance_of_a_shape_is_that_of_its_fine_mesh(body: Body) -> None:
    rng = np.random.default_rng(1)
    if body.kind == BOX:
        mesh = trimesh.creation.box((6, 8, 10))
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        shell, slack = shell_of(vertices, faces, vertices, False), 1e-9
    else:
        angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
        rings = [np.column_stack((r * np.cos(angle), r * np.sin(angle), np.full(len(angle), z))) for r, z in ((4, 0), (2, 10))]
        shell, slack = hull_shell(np.vstack(rings)), 1e-4
    twin = pack([body, Body("twin", 0, MESH, (0.0, 0.0, 0.0), EYE, shell)])
    for point in rng.uniform(-8, 12, size=(400, 3)):
        assert body_distance(twin, 0, *point) == pytest.approx(body_distance(twin, 1, *point), abs=slack)


def test_a_pin_in_the_pocket_of_a_concave_solid_is_free_and_hits_its_wall_and_floor() -> None:
    pin = cylinder(3, 30)
    assert gap(cup(), pin, EYE, at(0, 0, 12)) == pytest.approx(2.0, abs=2e-4)
    assert gap(pin, cup(), at(5, 0, 14), EYE) == pytest.approx(2.0, abs=2e-4)
    assert gap(cup(), pin, EYE, at(8, 0, 14)) == pytest.approx(-1.0, abs=0.02)
    assert gap(cup(), cylinder(1, 2), EYE, at(15, 0, 8)) < -3.0  # wholly inside the wall
    assert gap(cup(), cup(), EYE, at(0, 0, 25)) == pytest.approx(5.0, abs=2e-4)
