"""Planes that touch a surface along rings and ridges: the area there is the limit from the side that was asked for."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from planner.mesh import Mesh
from planner.slicing import Section, slice_mesh
from planner.slicing.slicer import Side
from planner.slicing.thickness import layer_heights
from tests.unit.planner.smooth_surfaces import RING, TUBE, torus

Floats = NDArray[np.float64]
STEP = 1e-5  # mm, between the planes beside a touching plane, whose areas are straight lines up to the next vertex
Z = np.array([0.0, 0.0, 1.0])
X = np.array([1.0, 0.0, 0.0])
SIDES: tuple[Side, ...] = ("above", "below")
TURNS = (
    np.eye(3),
    np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0,
)  # the second: 60 degrees about (1, 1, 1)


def placed(mesh: Mesh, turn: Floats, shift: float = 0.0) -> Mesh:
    return Mesh(mesh.vertices @ turn.T + shift, mesh.facets)


def with_cavity(void: Mesh) -> Mesh:
    """A block around a body that is taken out of it."""
    block = trimesh.creation.box(bounds=void.bounds + np.array([[-1.0], [1.0]]))
    return Mesh(
        np.vstack([void.vertices, block.vertices]), np.vstack([void.facets[:, ::-1], block.faces + len(void.vertices)])
    )


def joined(*meshes: Mesh) -> Mesh:
    """All in one mesh, nothing united."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.vstack([mesh.vertices for mesh in meshes]),
        np.vstack([mesh.facets + n for mesh, n in zip(meshes, first, strict=False)]),
    )


def cut_at(mesh: Mesh, level: float, normal: Floats, side: Side) -> Section:
    return slice_mesh(mesh, [[*(level * normal), *normal]], side)[0]


def checked(mesh: Mesh, level: float, normal: Floats, side: Side) -> Section:
    """The section, after its area was compared with the limit of those of planes beside it."""
    section = cut_at(mesh, level, normal, side)
    away = STEP if side == "above" else -STEP
    near, far = (cut_at(mesh, level + steps * away, normal, side).area_mm2 for steps in (1, 2))
    assert section.area_mm2 == pytest.approx(2.0 * near - far, abs=1e-6)
    shape = section.to_shapely()
    assert shape.is_valid
    assert shape.area == pytest.approx(section.area_mm2, abs=1e-6)
    for loop in section.loops:
        assert (section.loops[loop.parent].is_hole != loop.is_hole) if loop.parent >= 0 else not loop.is_hole
    return section


@pytest.mark.parametrize("sides", [(12, 8), (48, 24)])
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("shift", [0.0, 123.456])
def test_a_lying_torus_is_cut_into_nothing_where_its_lowest_and_highest_ring_touch_the_plane(
    sides: tuple[int, int], turn: Floats, shift: float
) -> None:
    ring, normal = placed(torus(*sides).mesh, turn, shift), turn @ Z
    middle = float(shift * normal.sum())
    for level in (middle - TUBE, middle + TUBE):
        for side in SIDES:
            assert checked(ring, level, normal, side).loops == []


def test_the_layers_of_a_lying_torus_of_few_facets_end_on_its_rings() -> None:
    for rule in ("facet", "ruled"):
        heights = layer_heights(torus(12, 8).mesh, Z, 0.3, 0.1, 2.0, rule=rule)
        assert (heights[0], heights[-1]) == (-TUBE, TUBE)


@pytest.mark.parametrize("turn", TURNS)
def test_a_standing_torus_has_the_area_of_the_side_at_every_height_of_its_vertices(turn: Floats) -> None:
    upright, normal = torus(12, 8).mesh, turn @ X
    mesh = placed(upright, turn)
    assert {RING - TUBE, RING + TUBE} <= set(np.round(upright.vertices[:, 0], 9).tolist())
    for level in np.unique(np.round(upright.vertices[:, 0], 9)).tolist():
        for side in SIDES:
            checked(mesh, level, normal, side)


@pytest.mark.parametrize("turn", TURNS)
def test_a_ring_shaped_cavity_leaves_the_section_whole_where_it_touches_the_plane(turn: Floats) -> None:
    ring = torus(12, 8).mesh
    block = placed(with_cavity(ring), turn)
    low, high = ring.bounds + np.array([[-1.0], [1.0]])
    for level in (-TUBE, TUBE):
        for side in SIDES:
            (loop,) = checked(block, level, turn @ Z, side).loops
            assert loop.area_mm2 == pytest.approx(float(np.prod((high - low)[:2])))


def test_rings_in_rings_and_the_same_ring_twice_are_all_cut_into_nothing() -> None:
    ring = torus(12, 8).mesh
    small = Mesh(ring.vertices * np.array([0.3, 0.3, 1.0]), ring.facets)
    core = Mesh.from_trimesh(trimesh.creation.cylinder(radius=2.0, height=2.0 * TUBE + 2.0, sections=16))
    pillar = float(0.5 * 16 * 2.0**2 * np.sin(2.0 * np.pi / 16))
    rows = [Mesh(ring.vertices + np.array([100.0 * i, 0.0, 0.0]), ring.facets) for i in range(30)]
    for level in (-TUBE, TUBE):
        for side in SIDES:
            assert checked(joined(ring, small), level, Z, side).loops == []
            assert cut_at(joined(ring, ring, ring), level, Z, side).loops == []
            assert checked(joined(*rows), level, Z, side).loops == []
            (loop,) = checked(joined(ring, core, small), level, Z, side).loops
            assert loop.area_mm2 == pytest.approx(pillar)
            assert loop.parent == -1


def test_a_ring_of_finite_width_stays_however_near_the_plane_comes_to_touching() -> None:
    ring = torus(12, 8).mesh
    out = TUBE * np.sqrt(0.5) / (TUBE - TUBE * np.sqrt(0.5))  # mm outwards and inwards per mm of height
    for gap in (1e-3, 1e-5, 1e-6):
        for level, side in zip((-TUBE + gap, TUBE - gap), SIDES, strict=True):
            section = cut_at(ring, level, Z, side)
            assert sorted(loop.is_hole for loop in section.loops) == [False, True]
            wide, narrow = RING + gap * out, RING - gap * out
            true_area = 0.5 * 12 * np.sin(np.pi / 6) * (wide**2 - narrow**2)  # of two polygons of 12 corners
            assert section.area_mm2 == pytest.approx(true_area, rel=1e-6)


def terrain(heights: Floats, is_turned: NDArray[np.bool_]) -> Mesh:
    """A block whose top has these heights (n, m) on a grid of 1 mm; is_turned: which squares have the other diagonal."""
    n, m = heights.shape
    x, y = np.meshgrid(np.arange(float(n)), np.arange(float(m)), indexing="ij")
    top = np.column_stack([x.ravel(), y.ravel(), heights.ravel()])
    number = np.arange(n * m).reshape(n, m)
    a, b, c, d = (part.reshape(-1, 1) for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    first = np.where(is_turned.reshape(-1, 1), np.hstack([a, b, d]), np.hstack([a, b, c]))
    second = np.where(is_turned.reshape(-1, 1), np.hstack([b, c, d]), np.hstack([a, c, d]))
    rim = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    following, low = np.roll(rim, -1), n * m
    up = np.vstack([first, second])
    wall = [np.column_stack([rim + low, following + low, following]), np.column_stack([rim + low, following, rim])]
    base = np.column_stack([top[:, :2], np.full(low, -1.0)])
    return Mesh(np.vstack([top, base]), np.vstack([up, up[:, ::-1] + low, *wall]))


def ridges(cells: int, is_gap: NDArray[np.bool_]) -> tuple[Floats, NDArray[np.bool_]]:
    """Heights of a net of ridges 2 mm high round square basins, and the diagonals that leave no level facet.

    is_gap : (2, cells, cells + 1) bool, ridges along x and along y that have a notch in their middle
    """
    heights = np.ones((2 * cells + 3, 2 * cells + 3))
    heights[1:-1:2, 1:-1:2] = 2.0
    heights[2:-1:2, 1:-1:2] = np.where(is_gap[0], 1.0, 2.0)
    heights[1:-1:2, 2:-1:2] = np.where(is_gap[1].T, 1.0, 2.0)
    square = np.add.outer(np.arange(2 * cells + 2), np.arange(2 * cells + 2))
    return heights, square % 2 == 1


@pytest.mark.parametrize("cells", [1, 2, 4])
@pytest.mark.parametrize("turn", TURNS)
def test_a_net_of_ridges_or_of_grooves_is_cut_into_nothing_or_everything_where_it_touches(
    cells: int, turn: Floats
) -> None:
    heights, is_turned = ridges(cells, np.zeros((2, cells, cells + 1), dtype=bool))
    net = placed(terrain(heights, is_turned), turn)
    grooves = placed(terrain(2.0 - heights, is_turned), turn)
    whole = float((2 * cells + 2) ** 2)
    assert [checked(net, 2.0, turn @ Z, side).area_mm2 for side in SIDES] == [0.0, 0.0]
    assert cut_at(net, 2.0, turn @ Z, "below").loops == []
    (loop,) = checked(grooves, 0.0, turn @ Z, "below").loops
    assert loop.area_mm2 == pytest.approx(whole)
    assert checked(grooves, 0.0, turn @ Z, "above").area_mm2 == pytest.approx(whole)


@settings(max_examples=60, deadline=None)
@given(
    gaps=arrays.arrays(np.bool_, (2, 3, 4)), wild=st.integers(0, 2**32 - 1), cavity=st.booleans(), turned=st.booleans()
)
def test_any_terrain_has_at_its_own_heights_the_area_just_beside_them(
    gaps: NDArray[np.bool_], wild: int, cavity: bool, turned: bool
) -> None:
    heights, is_turned = ridges(3, gaps)
    rng = np.random.default_rng(wild)
    changed = rng.random(heights.shape) < rng.choice([0.0, 0.05, 0.5])
    heights[changed] = rng.integers(0, 3, int(changed.sum()))
    mesh = terrain(heights, is_turned ^ (rng.random(is_turned.shape) < rng.choice([0.0, 0.2])))
    turn = TURNS[int(turned)]
    mesh = placed(with_cavity(mesh) if cavity else mesh, turn)
    for level in (0.0, 1.0, 2.0):
        for side in SIDES:
            assert checked(mesh, level, turn @ Z, side).area_mm2 >= 0.0
