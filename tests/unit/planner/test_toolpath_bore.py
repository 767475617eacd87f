"""Holes whose roof hangs: found, built full, and bored from the side without touching anything else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from planner.decompose.bores import Bore, filled, hanging_bores, has_way_in
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.pipeline import plan
from planner.plan import Operation, Pass, Process
from planner.process import Settings
from planner.recipe import Recipe
from planner.toolpath.bore import bore_pass, borings

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"
SETTINGS = Settings.from_recipe(Recipe())


@pytest.fixture(scope="module")
def bearing() -> Mesh:
    mesh = load(PARTS / "bearing.stl", "mm")
    return mesh.transformed(np.array([[1, 0, 0, -27.5], [0, 1, 0, -14.5], [0, 0, 1, 0], [0, 0, 0, 1.0]]))


@pytest.fixture(scope="module")
def bore(bearing: Mesh) -> Bore:
    (found,) = hanging_bores(bearing, 30.0, 35.0)
    return found


def points_and_axis(step: Pass) -> tuple[np.ndarray, np.ndarray]:
    return step.tip.evaluate(step.tip.sample(0.005)), np.asarray(step.axis)


def test_the_bore_of_the_bearing_is_found_with_its_measures(bore: Bore) -> None:
    assert bore.mouth == pytest.approx([0.0, -14.5, 25.0], abs=1e-3)
    assert bore.axis == pytest.approx([0.0, -1.0, 0.0], abs=1e-6)
    assert (bore.radius_mm, bore.depth_mm, bore.is_through) == (pytest.approx(9.5), pytest.approx(19.5), False)


def test_the_bearing_without_its_bore_is_the_closed_sum_of_both(bearing: Mesh, bore: Bore) -> None:
    solid = filled(bearing, [bore])
    assert solid.is_closed
    assert solid.volume - bearing.volume == pytest.approx(np.pi * 9.5**2 * 19.5, rel=2e-3)


def test_a_bore_along_the_build_direction_hangs_nowhere(bearing: Mesh) -> None:
    lying = bearing.transformed(np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]]))
    assert hanging_bores(lying, 30.0, 35.0) == []


def test_a_boss_is_no_bore() -> None:
    bar = trimesh.creation.cylinder(5.0, 20.0, sections=64, transform=trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    assert hanging_bores(Mesh.from_trimesh(bar), 30.0, 35.0) == []


def test_the_cutter_leaves_exactly_the_bore(bore: Bore) -> None:
    points, axis = points_and_axis(bore_pass(bore, SETTINGS))
    depth = -(points - bore.mouth) @ bore.axis
    away = np.linalg.norm(points - bore.mouth + depth[:, None] * bore.axis, axis=1)
    assert axis == pytest.approx(bore.axis)
    assert depth.max() == pytest.approx(bore.depth_mm, abs=1e-4)
    assert away.max() + SETTINGS.cutter_radius_mm == pytest.approx(bore.radius_mm, abs=1e-4)
    turns = np.unwrap(np.arctan2(points[:, 0] - bore.mouth[0], points[:, 2] - bore.mouth[2]))
    last = (depth > bore.depth_mm - 1e-4) & (away > bore.radius_mm - SETTINGS.cutter_radius_mm - 1e-4)
    assert np.ptp(turns[last]) > 2.0 * np.pi


def test_a_wall_before_the_mouth_leaves_no_way_in(bearing: Mesh, bore: Bore) -> None:
    solid = filled(bearing, [bore])
    wall = trimesh.creation.box((4.0, 2.0, 60.0), transform=trimesh.transformations.translation_matrix([0, -30, 30]))
    both = Mesh(
        np.vstack([solid.vertices, wall.vertices]), np.vstack([solid.facets, np.asarray(wall.faces) + len(solid.vertices)])
    )
    assert has_way_in(solid, bore)
    assert not has_way_in(both, bore)
    found, notes = borings(both, [bore], SETTINGS)
    assert not found
    assert "no cutter comes in" in notes[0]


def test_the_tool_turns_beside_the_part_and_goes_straight_in(bearing: Mesh) -> None:
    made = plan(bearing, Recipe(layer_height_mm=0.8, build_direction=(0.0, 0.0, 1.0)), part_name="bearing")
    (bored,) = (found for found in made.operations if found.note == "bore")
    assert bored.process is Process.MILL_SIDE
    assert bored is made.operations[-1]
    assert any("bored from the side" in text for text in made.findings)
    assert_outside(bored, made.bounds)


def assert_outside(operation: Operation, bounds: np.ndarray) -> None:
    low, high = bounds
    for step in operation.passes:
        if not step.is_link:
            continue
        for u in np.linspace(*step.tip.domain, 200):
            tip = step.tip.evaluate([u])[0]
            is_turned = not isinstance(step.axis, np.ndarray) and abs(step.axis.evaluate([u])[0][2]) < 0.999 * np.linalg.norm(
                step.axis.evaluate([u])[0]
            )
            assert tip[2] > high[2] or tip[1] < low[1]
            assert not is_turned or tip[1] < low[1]
