"""Support milled away: what the cutter sweeps against the part that must stand and the metal that must go."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planner.collide.reach import CutterShape, reach
from planner.decompose.solids import section, solid_of
from planner.decompose.support import Support, supports
from planner.mesh.mesh import Mesh
from planner.plan import Process
from planner.process import Settings
from planner.recipe import Recipe
from planner.toolpath.clear import Cleared, clearing, default_directions
from tests.unit.planner.decompose.hanging_parts import high_bridge, hollow, shelf

Floats = NDArray[np.float64]

SETTINGS = Settings.from_recipe(Recipe())
PART = high_bridge()
WAYS = np.array([[0.0, 1.0, 0.0], [0.0, -np.cos(np.radians(20.0)), np.sin(np.radians(20.0))]])


def of(part: Mesh) -> Support:
    found = supports(part, 85.0, SETTINGS)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def support() -> Support:
    return of(PART)


@pytest.fixture(scope="module")
def cleared(support: Support) -> Cleared:
    return clearing(support.mesh, PART, SETTINGS, WAYS)


def poses(cleared: Cleared, spacing_mm: float = 0.5) -> tuple[Floats, Floats]:
    """Tips and axes of all passes in the piece's frame."""
    tips, axes = [], []
    for step in cleared.clearings:
        for run in step.operation.passes:
            arcs = np.linspace(0.0, run.tip.length, max(2, int(run.tip.length / spacing_mm)))
            local = run.tip.evaluate(run.tip.at_arc_length(arcs))
            tips.append(local @ step.piece_from_clearing[:3, :3].T + step.piece_from_clearing[:3, 3])
            axes.append(np.tile(step.direction, (len(arcs), 1)))
    return np.vstack(tips), np.vstack(axes)


def test_cutter_cuts_neither_part_nor_plate(cleared: Cleared) -> None:
    tips, axes = poses(cleared)
    shape = CutterShape(radius_mm=SETTINGS.cutter_radius_mm)
    around = reach(tips, axes, PART, SETTINGS.recipe.substrate_mm, shape, enough_mm=2.0)
    assert around.clearance_mm.min() > -0.02


def test_cutter_sweeps_the_support_that_is_said_to_go(support: Support, cleared: Cleared) -> None:
    assert cleared.left_mm3 < 0.06 * support.volume_mm3 and cleared.stuck_mm3 == 0.0
    whole = solid_of(support.mesh)
    chance = np.random.default_rng(3)
    found = []
    for z in np.arange(0.5, 32.0, 3.0):
        inside = section(whole, float(z))
        xy = chance.uniform([-9.0, -4.0], [9.0, 4.0], (40, 2))
        xy = xy[shapely.contains_xy(inside, xy[:, 0], xy[:, 1])]
        found.append(np.column_stack([xy, np.full(len(xy), z)]))
    points = np.vstack(found)
    away, _ = cKDTree(cleared.left).query(points)
    points = points[away > 1.0]
    tips, axes = poses(cleared, 1.0)
    swept = np.zeros(len(points), dtype=np.bool_)
    for first in range(0, len(tips), 4000):
        away = points[:, None, :] - tips[None, first : first + 4000]
        height = (away * axes[None, first : first + 4000]).sum(axis=2)
        across = np.sqrt(np.maximum((away**2).sum(axis=2) - height**2, 0.0))
        swept |= ((height > -0.02) & (across < SETTINGS.cutter_radius_mm + 0.05)).any(axis=1)
    assert len(points) > 200 and swept.mean() > 0.98


def test_underside_is_finished_by_the_flank_of_a_level_cutter(cleared: Cleared) -> None:
    tips, axes = poses(cleared)
    level = tips[(np.abs(axes[:, 2]) < 1e-9) & (tips[:, 1] < 3.9)]
    assert level[:, 2].max() == pytest.approx(32.0 - SETTINGS.cutter_radius_mm, abs=0.02)


def test_volumes_add_up_and_operations_are_marked(support: Support, cleared: Cleared) -> None:
    removed = sum(step.removed_mm3 for step in cleared.clearings)
    assert removed + cleared.left_mm3 == pytest.approx(support.volume_mm3, rel=1e-3)
    for step in cleared.clearings:
        assert step.operation.process is Process.MILL_SIDE and step.operation.note == "support"
        assert not any(run.is_link for run in step.operation.passes)
        frame = step.piece_from_clearing
        assert frame[:3, 2] == pytest.approx(step.direction)
        assert frame[:3, :3] @ frame[:3, :3].T == pytest.approx(np.eye(3))


def test_steps_are_no_deeper_than_the_material_allows(cleared: Cleared) -> None:
    depth = SETTINGS.material.milling.axial_depth_mm
    for step in cleared.clearings:
        heights = np.unique(np.round([run.tip.evaluate([run.tip.domain[0]])[0, 2] for run in step.operation.passes], 6))
        assert np.diff(heights).max() <= depth + 1e-6


def test_support_in_a_closed_hollow_stays_and_one_line_says_where() -> None:
    found = of(hollow())
    result = clearing(found.mesh, hollow(), SETTINGS, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    assert result.clearings == () and result.stuck_mm3 == pytest.approx(found.volume_mm3)
    assert result.left_mm3 == pytest.approx(found.volume_mm3)
    assert len(result.findings) == 1 and "no cutter reaches it" in result.findings[0]


def test_plate_below_a_low_shelf_keeps_the_holder_off() -> None:
    found = of(shelf())
    result = clearing(found.mesh, shelf(), SETTINGS, [[1.0, 0.0, 0.0]])
    assert result.left_mm3 > 0.8 * found.volume_mm3


def test_directions_never_come_from_below() -> None:
    ways = default_directions()
    assert (ways[:, 2] >= 0.0).all()
    assert np.linalg.norm(ways, axis=1) == pytest.approx(1.0)
