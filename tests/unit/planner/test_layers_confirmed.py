"""Layers whose walls were measured: few, within the cusp, cut where the part changes; along turning planes as well."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from planner.errors import PlanningError, RecipeError
from planner.matching import measured_walls
from planner.mesh import Mesh, load
from planner.slicing.confirm import Wanted
from planner.slicing.deviation import wall_deviations
from planner.slicing.stations import planes_on, straight_stations
from planner.slicing.thickness import confirmed_layers, critical_heights, layer_heights, layer_planes

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"
UP = (0.0, 0.0, 1.0)


def ball(radius: float, subdivisions: int = 5) -> Mesh:
    return Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius))


def levels(mesh: Mesh, heights: np.ndarray) -> np.ndarray:
    return straight_stations(mesh, np.array(UP)).planes(heights)


@pytest.mark.parametrize(
    ("radius", "delta", "most"), [pytest.param(23.0, 0.04, 30, marks=pytest.mark.slow), (20.0, 0.08, 20)]
)
def test_a_sphere_takes_few_ruled_layers_and_each_is_worth_its_cusp(radius: float, delta: float, most: int) -> None:
    mesh = ball(radius, 6)
    found = confirmed_layers(mesh, UP, Wanted(delta, 1e-3, 5.0, "ruled", "both", 35.0))
    assert len(found.deviation_mm) <= most
    chord = radius * np.sin(0.5 * np.diff(np.arcsin(np.clip(found.stations / radius, -1.0, 1.0))))
    sagitta = radius - np.sqrt(radius**2 - chord**2)  # of the true sphere, not of the facets
    assert sagitta[1:-1].max() <= delta * 1.02
    assert sagitta.max() <= delta * 1.15  # the wall of a cap begins on a small ring, not at the pole
    assert found.deviation_mm.max() <= delta
    assert found.mean_share(delta) >= 0.5


def torus(is_standing: bool) -> Mesh:
    body = trimesh.creation.torus(10.0, 3.0, major_sections=40, minor_sections=20)
    vertices = np.asarray(body.vertices)
    return Mesh.from_trimesh(trimesh.Trimesh(vertices[:, [2, 1, 0]], body.faces[:, ::-1]) if is_standing else body)


@pytest.mark.parametrize("name", ["lying torus", "standing torus", "cone"])
def test_built_ruled_walls_keep_the_cusp_both_ways_and_layers_that_only_it_limits_use_half_of_it(name: str) -> None:
    delta = 0.25 if name == "standing torus" else 0.1
    mesh = torus(name == "standing torus")
    if name == "cone":
        mesh = Mesh.from_trimesh(trimesh.creation.cone(radius=10.0, height=10.0, sections=128))
    found = confirmed_layers(mesh, UP, Wanted(delta, 0.02, 5.0, "ruled", "both", 35.0))
    planes = levels(mesh, found.stations)
    built = np.array([layer.deviation.max_mm for layer in measured_walls(mesh, planes[:-1], planes[1:])])
    assert built.max() <= delta and found.deviation_mm.max() <= delta
    assert name == "cone" or found.mean_share(delta) >= 0.5


def test_a_sphere_takes_few_extruded_layers_and_each_is_worth_its_cusp() -> None:
    delta, radius = 0.32, 20.0  # a quarter of the layers of delta = 0.08, whose count the bench shows
    mesh = ball(radius)
    found = confirmed_layers(mesh, UP, Wanted(delta, 1e-3, 5.0, "extruded", "both", 35.0))
    assert len(found.deviation_mm) <= 1.05 * 252 / 4
    wide = np.sqrt(np.maximum(radius**2 - found.stations**2, 0.0))
    corners = np.hypot(
        np.maximum(wide[1:], wide[:-1]), np.where(wide[1:] < wide[:-1], found.stations[1:], found.stations[:-1])
    )
    assert corners.max() - radius <= delta * 1.01
    assert found.deviation_mm.max() <= delta
    assert found.deviation_mm.mean() >= 0.5 * delta


@pytest.mark.parametrize(("rule", "direction"), [("extruded", (0.0, 0.0, 1.0)), ("ruled", (0.6, 0.0, 0.8))])
def test_a_coarse_sphere_is_its_facets(rule: str, direction: tuple[float, float, float]) -> None:
    mesh = Mesh.from_trimesh(trimesh.creation.uv_sphere(radius=20.0, count=[24, 48]))
    found = confirmed_layers(mesh, direction, Wanted(0.3, 1e-3, 5.0, rule, "both", 35.0))  # type: ignore[arg-type]
    assert found.deviation_mm.max() <= 0.3
    assert found.deviation_mm.mean() >= 0.15


def test_one_sided_walls_count_only_what_lies_on_their_side() -> None:
    mesh = ball(10.0, 4)
    upper = levels(mesh, np.array([2.0, 3.0, 4.0]))
    outside = wall_deviations(mesh, upper, "extruded", "outside").deviation_mm
    inside = wall_deviations(mesh, upper, "extruded", "inside").deviation_mm
    wide = np.sqrt(100.0 - np.array([2.0, 3.0, 4.0]) ** 2)
    np.testing.assert_allclose(outside, np.hypot(wide[:-1], [3.0, 4.0]) - 10.0, atol=0.03)
    np.testing.assert_allclose(inside, 10.0 - np.hypot(wide[1:], [2.0, 3.0]), atol=0.03)


def test_a_ruled_wall_of_a_cone_lies_on_it_and_an_extruded_one_by_its_slope() -> None:
    cone = Mesh.from_trimesh(trimesh.creation.cone(radius=10.0, height=10.0, sections=128))
    planes = levels(cone, np.array([0.0, 2.0, 4.0, 6.0]))
    assert wall_deviations(cone, planes, "ruled").deviation_mm.max() < 1e-3
    np.testing.assert_allclose(wall_deviations(cone, planes, "extruded").deviation_mm, np.sqrt(2.0), rtol=5e-3)


def test_a_prism_takes_the_thickest_layers_under_both_rules() -> None:
    box = Mesh.from_trimesh(trimesh.creation.box((5, 5, 10)))
    for rule in ("extruded", "ruled"):
        np.testing.assert_allclose(layer_heights(box, UP, 0.05, 0.3, 1.0, rule=rule), np.linspace(-5, 5, 11))


def test_ruled_layers_end_at_a_level_sharp_edge() -> None:
    house = trimesh.creation.cylinder(10.0, 8.0, sections=64).apply_translation([0, 0, 4.0])
    roof = trimesh.creation.cone(10.0, 6.0, sections=64).apply_translation([0, 0, 8.0])
    mesh = Mesh.from_trimesh(trimesh.boolean.union([house, roof], engine="manifold"))
    heights = layer_heights(mesh, UP, 0.05, 0.1, 20.0, rule="ruled")
    np.testing.assert_allclose(heights, [0.0, 8.0, 14.0], atol=1e-5)


@pytest.mark.parametrize(("direction", "wanted"), [(UP, [-3.0, 3.0]), ((1.0, 0.0, 0.0), [-13.0, -7.0, 7.0, 13.0])])
def test_a_torus_changes_where_it_begins_opens_closes_and_ends(
    direction: tuple[float, float, float], wanted: list[float]
) -> None:
    ring = Mesh.from_trimesh(trimesh.creation.torus(10.0, 3.0, major_sections=96, minor_sections=48))
    np.testing.assert_allclose(critical_heights(ring, direction), wanted, atol=1e-9)
    heights = layer_heights(ring, direction, 0.4, 0.01, 3.0, rule="extruded")
    for height in wanted:
        assert np.abs(heights - height).min() < 1e-9


def test_a_level_ring_that_only_goes_on_is_no_change() -> None:
    for mesh in (ball(5.0, 3), Mesh.from_trimesh(trimesh.creation.uv_sphere(radius=5.0, count=[12, 24]))):
        np.testing.assert_allclose(critical_heights(mesh, UP), [-5.0, 5.0])


def test_the_bounds_win_and_the_deviation_tells() -> None:
    found = confirmed_layers(ball(10.0, 4), UP, Wanted(0.01, 0.5, 1.0, "extruded", "both", 35.0))
    assert np.diff(found.stations).min() >= 0.5 - 1e-9
    assert found.deviation_mm.max() > 0.01


@pytest.mark.parametrize(("name", "delta"), [("pipe", 0.04), ("bearing", 0.08), ("hinge", 0.08)])
def test_ruled_walls_of_the_parts_keep_the_cusp_where_layers_may_be_thinner(name: str, delta: float) -> None:
    found = confirmed_layers(load(PARTS / f"{name}.stl"), UP, Wanted(delta, 0.02, 5.0, "ruled", "both", 35.0))
    thickness = np.diff(found.stations)
    assert ((found.deviation_mm <= delta) | (thickness < 0.04)).all()
    assert thickness.min() >= 0.02 - 1e-9


def test_planes_that_turn_through_a_bend_lie_closest_on_its_outside_as_far_as_the_cusp_allows() -> None:
    bend = swept_bend(20.0, 4.0, 48, 32)
    angles = np.linspace(-0.05, 0.5 * np.pi + 0.05, 9)
    path = np.zeros((9, 6))
    path[:, 3], path[:, 5] = -np.sin(angles), np.cos(angles)
    path[:, 0], path[:, 2] = 20.0 * np.cos(angles), 20.0 * np.sin(angles)
    planes = layer_planes(bend, path, 0.2, 0.1, 1.5, rule="extruded")
    turned = np.arctan2(-planes[:, 3], planes[:, 5])
    np.testing.assert_allclose(turned[[0, -1]], [0.0, 0.5 * np.pi], atol=1e-6)
    outermost = 24.0 * np.diff(turned)
    assert outermost.max() <= 1.5 * 1.02
    assert wall_deviations(bend, planes, "extruded").deviation_mm.max() <= 0.2 + 1e-9
    ruled = layer_planes(bend, path, 0.05, 0.1, 5.0, rule="ruled")
    assert max(layer.deviation.max_mm for layer in measured_walls(bend, ruled[:-1], ruled[1:])) <= 0.05
    assert len(ruled) < len(planes)


def test_straight_planes_given_as_a_path_are_the_straight_layers() -> None:
    mesh = ball(5.0, 3)
    path = np.array([[0, 0, -6.0, 0, 0, 1], [0, 0, 6.0, 0, 0, 1]])
    planes = layer_planes(mesh, path, 0.1, 0.01, 2.0, rule="ruled")
    heights = layer_heights(mesh, UP, 0.1, 0.01, 2.0, rule="ruled")
    assert abs(len(planes) - len(heights)) <= 1
    assert max(layer.deviation.max_mm for layer in measured_walls(mesh, planes[:-1], planes[1:])) <= 0.1
    np.testing.assert_allclose(planes_on(path, np.array([0.5]))[0], [0, 0, 0, 0, 0, 1])


def test_a_path_that_misses_the_part_or_folds_in_it_is_refused() -> None:
    mesh = ball(5.0, 2)
    with pytest.raises(RecipeError, match="the way of planes"):
        layer_planes(mesh, [[0, 0, 0, 0, 0, 1], [0, 0, 6, 0, 0, 1]], 0.1, 0.1, 1.0)
    with pytest.raises(RecipeError, match="the way of planes"):
        folded = [[0, 0, -6, 0, 0, 1], [0, 0, 0, 0, 0, 1], [2, 0, 0, 1, 0, 0], [9, 0, 0, 1, 0, 0]]
        layer_planes(mesh, folded, 0.1, 0.1, 1.0)


def test_level_faces_that_no_layers_fit_between_are_refused() -> None:
    boxes = [
        trimesh.creation.box(bounds=np.array([[10.0 * i, 0.0, 0.0], [10.0 * i + 10.0, 10.0, top]]))
        for i, top in enumerate((4.0, 4.2, 9.0))
    ]
    stairs = Mesh.from_trimesh(trimesh.boolean.union(boxes, engine="manifold"))
    with pytest.raises(PlanningError, match=r"0\.2 mm between the level faces"):
        layer_heights(stairs, UP, 0.05, 0.3, 1.0, rule="extruded")


def swept_bend(radius: float, tube: float, steps: int, around: int) -> Mesh:
    """A quarter of a torus about the y axis, closed by lids: from (radius, 0, 0) to (0, 0, radius)."""
    turn, ring = np.linspace(0.0, 0.5 * np.pi, steps + 1), np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    away = radius + tube * np.cos(ring)
    points = np.stack(
        [np.outer(np.cos(turn), away), np.outer(np.ones(steps + 1), tube * np.sin(ring)), np.outer(np.sin(turn), away)],
        axis=2,
    ).reshape(-1, 3)
    number = np.arange((steps + 1) * around).reshape(steps + 1, around)
    a, b = number[:-1].ravel(), np.roll(number, -1, axis=1)[:-1].ravel()
    c, d = np.roll(number, -1, axis=1)[1:].ravel(), number[1:].ravel()
    lids = [np.column_stack([np.full(around - 2, row[0]), row[1:-1], row[2:]]) for row in (number[0], number[-1])]
    facets = np.concatenate([np.c_[a, b, c], np.c_[a, c, d], lids[0][:, ::-1], lids[1]])
    mesh = Mesh(points, facets)
    return mesh if mesh.volume > 0.0 else Mesh(points, facets[:, ::-1])
