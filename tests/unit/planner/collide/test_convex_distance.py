"""Distance of convex bodies against analytic cases and against support widths over all directions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from planner.collide.convex import BOX, FRUSTUM, HULL, ROUNDED, point_distance, support
from planner.collide.gjk import signed_distance

Floats = NDArray[np.float64]
Shape = tuple[int, tuple[float, float, float]]

NONE = np.empty((0, 3))
CUBE: Shape = (BOX, (1.0, 1.0, 1.0))
ROD: Shape = (FRUSTUM, (1.0, 1.0, 5.0))
BALL: Shape = (ROUNDED, (4.0, 4.0, 20.0))
SHAPES: list[Shape] = [
    (BOX, (2.0, 3.0, 4.0)),
    (FRUSTUM, (3.0, 3.0, 8.0)),
    (FRUSTUM, (2.0, 5.0, 6.0)),
    (ROUNDED, (3.0, 1.0, 9.0)),
    (FRUSTUM, (3.0, 0.0, 6.0)),
]


def pose(at: ArrayLike, rotation: Floats | None = None) -> Floats:
    return np.ascontiguousarray(np.column_stack([np.eye(3) if rotation is None else rotation, np.array(at, dtype=float)]))


def gap(a: Shape, b: Shape, where: Floats, points: tuple[Floats, Floats] = (NONE, NONE)) -> tuple[float, Floats]:
    at = np.zeros(3)
    found = signed_distance((a[0], b[0]), (np.array(a[1]), np.array(b[1])), points, where, np.inf, at)
    return float(found), at


@pytest.mark.parametrize(
    ("a", "b", "where", "expected"),
    [
        (CUBE, CUBE, pose((3.0, 4.0, 0.0)), np.hypot(1.0, 2.0)),
        (CUBE, CUBE, pose((1.5, 0.2, 0.1)), -0.5),
        (CUBE, CUBE, pose((0.0, 0.0, 0.0)), -2.0),
        (CUBE, CUBE, pose((4.0, 0.0, 0.0), Rotation.from_euler("z", 45, degrees=True).as_matrix()), 3.0 - np.sqrt(2.0)),
        (ROD, CUBE, pose((2.5, 0.0, 2.0)), 0.5),
        (ROD, CUBE, pose((0.0, 0.0, -1.3)), 0.3),
        (ROD, ROD, pose((3.0, -2.5, 2.0), Rotation.from_euler("x", -90, degrees=True).as_matrix()), 1.0),
        (BALL, (BOX, (50.0, 50.0, 5.0)), pose((0.0, 0.0, -4.8)), -0.2),
        (BALL, (BOX, (50.0, 50.0, 5.0)), pose((0.0, 0.0, -6.0), Rotation.from_euler("x", 0, degrees=True).as_matrix()), 1.0),
        ((FRUSTUM, (3.0, 0.0, 4.0)), CUBE, pose((0.0, 0.0, 6.0)), 1.0),
    ],
)
def test_distances_and_depths_are_those_of_geometry(a: Shape, b: Shape, where: Floats, expected: float) -> None:
    assert gap(a, b, where)[0] == pytest.approx(expected, abs=3e-3)


def test_a_tilted_cylinder_meets_a_plate_by_its_rim() -> None:
    lean = np.deg2rad(30.0)
    turned = Rotation.from_euler("x", 30, degrees=True).as_matrix()
    found, at = gap((BOX, (50.0, 50.0, 5.0)), (FRUSTUM, (4.0, 4.0, 20.0)), pose((0.0, 0.0, 6.0), turned))
    assert found == pytest.approx(1.0 - 4.0 * np.sin(lean), abs=3e-3)
    assert np.linalg.norm(at - [0.0, -4.0 * np.cos(lean), 5.0]) < 0.2


def test_distance_of_random_poses_is_the_greatest_width_between_them_over_all_directions() -> None:
    rng = np.random.default_rng(3)
    around = rng.normal(size=(400, 3))
    around /= np.linalg.norm(around, axis=1)[:, None]
    overlaps = 0
    for seed in range(24):
        a, b = SHAPES[rng.integers(5)], SHAPES[rng.integers(5)]
        where = pose(rng.uniform(-9.0, 9.0, 3), Rotation.random(random_state=seed).as_matrix())
        found, _ = gap(a, b, where)
        best = max(refined(a, b, where, around[k]) for k in np.argsort([-width(a, b, where, d) for d in around])[:3])
        assert found == pytest.approx(best, abs=0.01)
        overlaps += found < 0.0
    assert 4 < overlaps < 18


def width(a: Shape, b: Shape, where: Floats, d: Floats) -> float:
    """Room between the planes across d that touch both: at most the distance, or minus the depth."""
    of_a = np.array(support(a[0], np.array(a[1]), NONE, *d))
    of_b = where[:, :3] @ np.array(support(b[0], np.array(b[1]), NONE, *(-where[:, :3].T @ d))) + where[:, 3]
    return float(d @ (of_b - of_a))


def refined(a: Shape, b: Shape, where: Floats, d: Floats) -> float:
    """The width made as large as it gets near a direction: steps to and fro that get shorter."""
    rng = np.random.default_rng(0)
    best, size = width(a, b, where, d), 0.1
    while size > 1e-4:
        tries = d + size * rng.normal(size=(10, 3))
        tries /= np.linalg.norm(tries, axis=1)[:, None]
        widths = [width(a, b, where, way) for way in tries]
        k = int(np.argmax(widths))
        if widths[k] > best:
            best, d = widths[k], tries[k]
        else:
            size *= 0.5
    return best


def test_points_are_as_far_from_a_body_as_the_body_from_a_body_without_size() -> None:
    rng = np.random.default_rng(5)
    dot: Shape = (BOX, (0.0, 0.0, 0.0))
    for shape in SHAPES:
        for point in rng.uniform(-8.0, 8.0, (30, 3)):
            signed = float(point_distance(shape[0], np.array(shape[1]), NONE, *point))
            assert gap(shape, dot, pose(point))[0] == pytest.approx(signed, abs=5e-3)


def test_a_hull_is_as_far_as_the_box_that_its_corners_span() -> None:
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    rng = np.random.default_rng(6)
    for seed in range(20):
        where = pose(rng.uniform(-4.0, 4.0, 3), Rotation.random(random_state=seed).as_matrix())
        hull = gap((HULL, (0.0, 0.0, 0.0)), SHAPES[1], where, (corners, NONE))[0]
        assert hull == pytest.approx(gap(CUBE, SHAPES[1], where)[0], abs=5e-3)


def test_a_distance_beyond_what_is_enough_is_a_lower_bound_above_it() -> None:
    at = np.zeros(3)
    bound = signed_distance((BOX, BOX), (np.ones(3), np.ones(3)), (NONE, NONE), pose((30.0, 20.0, 0.0)), 5.0, at)
    assert 5.0 < bound <= np.hypot(28.0, 18.0)
