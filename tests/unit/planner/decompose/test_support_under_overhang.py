"""Sacrificial metal under parts of which something hangs in every way: what it touches, what it carries, how much it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely
import trimesh

from planner.decompose.overhang import hanging_area
from planner.decompose.solids import section, solid_of
from planner.decompose.support import Support, hanging_regions, support_for, supports
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.recipe import Recipe
from tests.unit.planner.decompose.hanging_parts import bridge, hollow, mushroom, shelf
from tests.unit.planner.small_parts import box, frustum

SETTINGS = Settings.from_recipe(Recipe())
LIMIT_DEG = 85.0
LEAN = np.tan(np.radians(SETTINGS.material.deposition.max_overhang_deg))


def of(part: Mesh, limit_deg: float = LIMIT_DEG) -> Support:
    found = supports(part, limit_deg, SETTINGS)
    assert found is not None
    return found


@pytest.mark.parametrize(("make", "hangs_mm2"), [(bridge, 18 * 10), (shelf, 12 * 12), (mushroom, None)])
def test_support_touches_the_part_without_lying_in_it(make: Callable[[], Mesh], hangs_mm2: float | None) -> None:
    part = make()
    found = of(part)
    one, other = solid_of(part), solid_of(found.mesh)
    assert (one ^ other).volume() < 1e-6
    together = one + other
    assert together.volume() == pytest.approx(part.volume + found.volume_mm3, abs=1e-6)
    assert len(together.decompose()) == 1
    assert found.mesh.bounds[0, 2] == 0.0
    if hangs_mm2 is not None:
        assert sum(region.area_mm2 for region in found.hanging) == pytest.approx(hangs_mm2)
        assert f"{hangs_mm2:.0f} mm²" in found.findings[0]


@pytest.mark.parametrize("make", [bridge, mushroom, shelf])
def test_nothing_of_part_and_support_hangs_wider_than_a_bead_bridges(make: Callable[[], Mesh]) -> None:
    part = make()
    whole = solid_of(part) + solid_of(of(part).mesh)
    step = SETTINGS.layer_max_mm
    heights = np.arange(0.0, part.bounds[1, 2] - 0.01, step)
    for low in heights[1:]:
        above, below = section(whole, low + 1e-3), section(whole, low - 1e-3)
        left = shapely.difference(above, shapely.buffer(below, 1.5 * step * LEAN + 0.1))
        assert left.area < 0.1, low


def test_support_is_drawn_in_to_less_than_the_column() -> None:
    for make, column in ((bridge, 18 * 10 * 16), (shelf, 12 * 12 * 10), (mushroom, np.pi * (14**2 - 4**2) * 15)):
        assert of(make()).volume_mm3 < 0.52 * column


def test_same_mesh_gives_the_same_support() -> None:
    assert of(bridge()).mesh.sha256 == of(bridge()).mesh.sha256


def test_walls_that_lean_within_the_limit_need_none() -> None:
    assert support_for(box(10.0, 10.0, 5.0), LIMIT_DEG, SETTINGS) is None
    assert support_for(frustum(5.0, 20.0, 10.0), LIMIT_DEG, SETTINGS) is None
    assert hanging_regions(frustum(5.0, 20.0, 10.0), 30.0, SETTINGS)


def test_underside_that_a_bead_bridges_needs_none() -> None:
    lip = trimesh.boolean.union(
        [
            trimesh.creation.box(bounds=((0, 0, 0), (10, 10, 10))),
            trimesh.creation.box(bounds=((-1, 0, 5), (10, 10, 10))),
        ]
    )
    part = Mesh.from_trimesh(lip)
    assert hanging_area(part, [[0.0, 0.0, 1.0]], None, LIMIT_DEG)[0] == pytest.approx(10.0)
    assert hanging_regions(part, LIMIT_DEG, SETTINGS) == []


def test_point_that_begins_in_the_air_stands_on_a_foot() -> None:
    spike = trimesh.creation.cone(radius=3.0, height=12.0, sections=32)
    spike.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))  # type: ignore[no-untyped-call,unused-ignore]
    spike.apply_translation([8.0, 0.0, 20.0])
    post = trimesh.creation.box(bounds=((-3, -3, 0), (3, 3, 20)))
    top = trimesh.creation.box(bounds=((-3, -3, 20), (11, 3, 24)))
    part = Mesh.from_trimesh(trimesh.boolean.union([post, spike, top]))
    found = of(part)
    assert any("point at (8, 0, 8) mm begins in the air" in line for line in found.findings)
    assert (solid_of(part) ^ solid_of(found.mesh)).volume() < 1e-6


def test_support_in_a_hollow_stands_on_its_floor() -> None:
    found = of(hollow())
    assert found.mesh.bounds[:, 2] == pytest.approx([5.0, 20.0])


def test_support_ends_on_what_stands() -> None:
    block = Mesh.from_trimesh(trimesh.creation.box(bounds=((6.0, -8.0, 0.0), (20.0, 8.0, 4.0))))
    found = supports(shelf(), LIMIT_DEG, SETTINGS, block)
    assert found is not None and found.mesh.bounds[0, 2] == pytest.approx(4.0)
