"""Ball milling: the envelope of the passes against the surface they finish; sense of the cut; arcs on and off."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from numpy.typing import NDArray

from planner.errors import RecipeError
from planner.mesh.mesh import Mesh
from planner.nurbs.curve import Curve
from planner.plan import Pass
from planner.process import Settings
from planner.recipe import Recipe, parse_recipe
from planner.toolpath.ball import Milled, ball_passes
from planner.toolpath.motion import axis_at
from planner.toolpath.scallop import Surface, ball_surface, scallop_step
from planner.toolpath.side import upright_passes

Floats = NDArray[np.float64]

SCALLOP_MM = 0.03
RADIUS_MM = 3.0
SPHERE_MM = 12.0
FACETS_MM = 0.03  # of the meshes: their facets' sagitta
RECIPE = Recipe(tolerance_mm=0.2, ball_cutter_diameter_mm=2.0 * RADIUS_MM, scallop_mm=SCALLOP_MM)


def turned(profile: Floats) -> Mesh:
    return Mesh.from_trimesh(trimesh.creation.revolve(profile, sections=64))


def dome() -> Mesh:
    """Half a sphere of 12 mm radius on a cylinder 4 mm high."""
    rise = np.linspace(0.0, 0.5 * np.pi, 40)
    arc = SPHERE_MM * np.column_stack([np.cos(rise), np.sin(rise)]) + [0.0, 4.0]
    arc[-1, 0] = 0.0
    return turned(np.vstack([[[0.0, 0.0], [SPHERE_MM, 0.0]], arc]))


def goblet() -> Mesh:
    """A cone that opens upwards by 35 degrees from 6 mm radius, 10 mm high."""
    return turned(np.array([[0.0, 0.0], [6.0, 0.0], [6.0 + 10.0 * np.tan(np.radians(35.0)), 10.0], [0.0, 10.0]]))


def milled(mesh: Mesh, low: float, high: float) -> tuple[Surface, Milled, Settings]:
    ball = Settings.from_recipe(RECIPE).with_ball_cutter()
    assert ball is not None
    surface = ball_surface(mesh, np.eye(4), (low, high), RADIUS_MM, SCALLOP_MM, 35.0)
    return surface, ball_passes(surface, -np.inf, lambda row: 0.0, ball, None), ball


def centres(passes: list[Pass]) -> Floats:
    """Ball centres along passes, (n, 3) mm."""
    found = []
    for step in passes:
        u = step.tip.sample(3e-3)
        axes = step.axis.evaluate(u) if isinstance(step.axis, Curve) else np.tile(step.axis, (len(u), 1))
        found.append(step.tip.evaluate(u) + RADIUS_MM * axes / np.linalg.norm(axes, axis=1)[:, None])
    return np.vstack(found)


def test_scallop_on_a_plane_is_as_high_as_asked() -> None:
    half = 0.5 * float(scallop_step(RADIUS_MM, SCALLOP_MM))
    assert RADIUS_MM - np.sqrt(RADIUS_MM**2 - half**2) == pytest.approx(SCALLOP_MM, rel=1e-12)


@pytest.mark.parametrize("radius", [8.0, 40.0, -40.0])
def test_scallop_over_a_curve_is_as_high_as_asked_within_a_tenth(radius: float) -> None:
    step = float(scallop_step(RADIUS_MM, SCALLOP_MM, 1.0 / radius))
    out = np.sign(radius)
    turn = 0.5 * step / abs(radius)  # half the angle between the two contacts, seen from the curve's centre
    reach = abs(radius + RADIUS_MM)  # of the ball's centres from there
    cusp = reach * np.cos(turn) - out * np.sqrt(RADIUS_MM**2 - (reach * np.sin(turn)) ** 2)
    assert out * (cusp - abs(radius)) == pytest.approx(SCALLOP_MM, rel=0.1)


def test_dome_is_left_with_scallops_no_higher_than_asked_and_without_gouges() -> None:
    _, made, _ = milled(dome(), 9.0, 13.0)
    assert not made.missed
    away = np.linalg.norm(centres(made.passes) - [0.0, 0.0, 4.0], axis=1)
    assert away.min() >= SPHERE_MM + RADIUS_MM - FACETS_MM  # nowhere into the sphere
    rise, turn = np.meshgrid(np.arcsin(np.linspace(5.6, 8.4, 30) / SPHERE_MM), [0.1, 4.0], indexing="ij")
    out = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1).reshape(-1, 3)
    off = centres(made.passes) - [0.0, 0.0, 4.0]
    left = []
    for ray in out:  # how far outside the sphere the first ball meets the normal
        along = off @ ray
        side2 = (off**2).sum(axis=1) - along**2
        near = side2 < RADIUS_MM**2
        left.append(float((along[near] - np.sqrt(RADIUS_MM**2 - side2[near])).min()) - SPHERE_MM)
    assert max(left) <= 1.2 * SCALLOP_MM + FACETS_MM


def test_wall_that_hangs_over_is_cut_with_the_axis_leaned_off_it() -> None:
    _, made, _ = milled(goblet(), 5.0, 7.0)
    assert made.passes and not made.missed
    lean = [np.degrees(np.arccos(axis_at(step.axis, step.tip.domain[0])[2])) for step in made.passes]
    assert min(lean) >= 35.0 and max(lean) <= 45.0
    points = centres(made.passes)
    wall = 6.0 + points[:, 2] * np.tan(np.radians(35.0))
    away = (np.hypot(points[:, 0], points[:, 1]) - wall) * np.cos(np.radians(35.0))
    assert away.min() >= RADIUS_MM - FACETS_MM


def test_rows_run_clockwise_round_what_stands_and_their_arcs_meet_them_without_a_corner() -> None:
    _, made, ball = milled(dome(), 8.0, 9.0)
    square = shapely.MultiPolygon([shapely.box(-8.0, -8.0, 8.0, 8.0)])
    for step in [*made.passes, *upright_passes(square, 1.0, 0.5, ball)]:
        x, y, _ = step.tip.evaluate(step.tip.sample(0.01)).T
        turned_by = (x[:-1] * np.diff(y) - y[:-1] * np.diff(x)).sum()
        assert turned_by < 0.0  # spindle clockwise, part on the right: climb milling
        joints = step.tip.breaks[1:-1][[0, -1]]  # ends of the arcs on and off
        before = step.tip.derivatives(joints, 1, "left")[1]
        after = step.tip.derivatives(joints, 1, "right")[1]
        before /= np.linalg.norm(before, axis=1)[:, None]
        after /= np.linalg.norm(after, axis=1)[:, None]
        assert (before * after).sum(axis=1).min() > np.cos(np.radians(1.0))


def test_scallop_below_nothing_is_refused_naming_the_field() -> None:
    with pytest.raises(RecipeError, match="scallop_mm"):
        parse_recipe("scallop_mm = -0.1")
