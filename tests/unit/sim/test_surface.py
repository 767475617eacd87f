"""The surface of the as-built: closed and manifold whatever the metal looks like, and with the volume that it should have."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim.process import marching_table
from sim.process.field import BLOCK, Field
from sim.process.stock import Stock
from sim.process.surface import built_mesh, field_mesh
from tests.unit.sim.metal_bench import MATERIAL, UP, plate, track, vector

Array = NDArray[np.float64]
BAND_CELLS = 3.0


def field_of(values: Array, cell_mm: float = 1.0) -> Field:
    """A field that holds the values, clipped to its band; cell (0, 0, 0) at the origin."""
    field = Field(np.zeros(3), cell_mm, BAND_CELLS * cell_mm, values.shape)
    whole = np.full(field.shape, field.band_mm, dtype=np.float32)
    whole[tuple(slice(0, n) for n in values.shape)] = np.clip(values, -field.band_mm, field.band_mm)
    entries = [n // BLOCK for n in field.shape]
    blocks = whole.reshape(entries[0], BLOCK, entries[1], BLOCK, entries[2], BLOCK).transpose(0, 2, 4, 1, 3, 5).reshape(-1, BLOCK, BLOCK, BLOCK)
    low, high = blocks.min(axis=(1, 2, 3)), blocks.max(axis=(1, 2, 3))
    directory = np.where(low == field.band_mm, -1, np.where(high == -field.band_mm, -2, 0)).astype(np.int32)
    mixed = directory == 0
    directory[mixed] = np.arange(mixed.sum())
    field.restore({"directory": directory.reshape(entries), "value": blocks[mixed], "mark": np.zeros((mixed.sum(), *blocks.shape[1:]), np.int16)})
    return field


def grid(shape: tuple[int, int, int], cell_mm: float = 1.0) -> Array:
    """(3, nx, ny, nz) float, mm   Cell centres."""
    return np.stack(np.meshgrid(*(cell_mm * np.arange(n) for n in shape), indexing="ij"))


def ball(points: Array, centre: Array, radius: float) -> Array:
    return np.asarray(np.linalg.norm(points - centre[:, None, None, None], axis=0) - radius)


def box(points: Array, centre: Array, half: Array) -> Array:
    out = np.abs(points - centre[:, None, None, None]) - half[:, None, None, None]
    return np.asarray(np.linalg.norm(np.maximum(out, 0.0), axis=0) + np.minimum(out.max(axis=0), 0.0))


def closed(vertices: Array, facets: NDArray[np.int64]) -> trimesh.Trimesh:
    """The mesh, after checking that each edge has two facets that run it in opposite directions, and each vertex one fan."""
    surface = trimesh.Trimesh(vertices, facets, process=False)
    if not len(facets):
        assert not len(vertices)
        return surface
    assert surface.is_watertight
    assert surface.is_winding_consistent
    assert np.array_equal(np.unique(facets), np.arange(len(vertices)))
    sides = np.sort(facets[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(sides, axis=0, return_counts=True)[1] == 2).all()
    links = facets[:, [1, 2, 0]], facets[:, [2, 0, 1]]
    after = dict(zip(zip(facets.ravel().tolist(), links[0].ravel().tolist(), strict=True), links[1].ravel().tolist(), strict=True))
    some = np.random.default_rng(1).permutation(len(vertices))[:200]
    fans = np.bincount(facets.ravel(), minlength=len(vertices))
    first = dict(zip(facets.ravel().tolist(), links[0].ravel().tolist(), strict=True))
    for vertex in some.tolist():
        begin = other = first[vertex]
        for _ in range(int(fans[vertex])):
            other = after[vertex, other]
        assert other == begin
        other = after[vertex, begin]
        steps = 1
        while other != begin:
            other, steps = after[vertex, other], steps + 1
        assert steps == fans[vertex]
    return surface


def test_every_pattern_of_a_cube_gives_facets_whose_open_sides_are_those_of_its_faces() -> None:
    for case in range(256):
        facets = marching_table.FACET_EDGES[case, : marching_table.FACET_COUNT[case]]
        sides = [(int(f[n]), int(f[(n + 1) % 3])) for f in facets for n in range(3)]
        assert len(sides) == len(set(sides))
        left = {side for side in sides if (side[1], side[0]) not in sides}
        wanted = {(chain[n - 1], chain[n]) for chain in marching_table.loops(case) for n in range(len(chain))}
        assert left in (wanted, {(b, a) for a, b in wanted})


@pytest.mark.parametrize("seed", range(4))
def test_noise_has_a_closed_manifold_surface(seed: int) -> None:
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, (18, 17, 19))
    noise[np.abs(noise) < 0.1] = 0.0
    surface = closed(*field_mesh(field_of(noise)))
    assert surface.volume > 0.0


def test_ball_has_its_volume_and_its_radius() -> None:
    points = grid((40, 44, 41), 0.25)
    centre = np.array([4.9, 5.3, 5.0])
    surface = closed(*field_mesh(field_of(ball(points, centre, 3.7), 0.25)))
    assert surface.volume == pytest.approx(4.0 / 3.0 * np.pi * 3.7**3, rel=0.003)
    assert np.abs(np.linalg.norm(surface.vertices - centre, axis=1) - 3.7).max() < 0.02 * 0.25
    outward = np.einsum("ij,ij->i", surface.face_normals, surface.triangles_center - centre)
    assert (outward > 0.0).all()


def test_metal_at_the_edge_of_the_grid_is_closed_there() -> None:
    surface = closed(*field_mesh(field_of(np.full((16, 8, 24), -3.0))))
    assert surface.volume == pytest.approx(16.0 * 8.0 * 24.0, rel=0.02)


@pytest.mark.parametrize(("half_mm", "error_mm"), [(0.3, 0.04), (0.14, 0.07)])  # thinner than two cells: the ridge between is cut
def test_thin_wall_has_two_sides(half_mm: float, error_mm: float) -> None:
    points = grid((24, 24, 24), 0.25)
    wall = box(points, np.array([2.9, 2.9, 2.9]), np.array([half_mm, 2.0, 2.0]))
    surface = closed(*field_mesh(field_of(wall, 0.25)))
    assert surface.volume == pytest.approx(2.0 * half_mm * 16.0, abs=error_mm * 16.0)
    assert surface.body_count == 1


def test_boxes_that_touch_along_an_edge_stay_two_closed_bodies() -> None:
    inside = np.full((16, 16, 16), 1.0)
    inside[3:8, 3:8, 3:8] = inside[8:12, 8:12, 3:8] = -1.0
    surface = closed(*field_mesh(field_of(inside)))
    assert surface.body_count == 2


def test_without_metal_there_is_no_facet() -> None:
    vertices, facets = field_mesh(field_of(np.full((8, 8, 8), 3.0)))
    assert vertices.shape == facets.shape == (0, 3)


def test_surface_read_back_from_a_file_is_still_closed(tmp_path_factory: pytest.TempPathFactory) -> None:
    flat = np.full((16, 16, 16), 1.0)
    flat[3:12, 3:12, 3:12] = 0.0
    flat[4:11, 4:11, 4:11] = -1.0
    flat[5, 5, 10] = 1.0
    path = tmp_path_factory.mktemp("surface") / "part.stl"
    trimesh.Trimesh(*field_mesh(field_of(flat, 0.1)), process=False).export(path)
    assert trimesh.load_mesh(path).is_watertight


solids = st.lists(
    st.tuples(st.booleans(), *[st.integers(0, 44).map(lambda n: 0.1 * n)] * 3, *[st.integers(4, 15).map(lambda n: 0.1 * n)] * 3),
    min_size=1,
    max_size=5,
)


@settings(max_examples=20, deadline=None)
@given(solids, st.sampled_from([-np.inf, 0.5, 0.9, 2.05]))
def test_union_of_balls_and_boxes_is_closed_and_whole_holds_the_filled_cells(shapes: list[tuple[bool, *tuple[float, ...]]], base_mm: float) -> None:
    cell = 0.2
    points = grid((24, 24, 24), cell)
    value = np.full(points.shape[1:], 9.0)
    for round_one, *rest in shapes:
        centre, half = np.array(rest[:3]), np.array(rest[3:])
        value = np.minimum(value, ball(points, centre, half[0]) if round_one else box(points, centre, half))
    surface = closed(*field_mesh(field_of(value, cell), base_mm))
    if np.isneginf(base_mm):  # a base may cut off a slice that is thinner than a cell
        filled = np.clip(0.5 - value / cell, 0.0, 1.0).sum() * cell**3
        assert surface.volume == pytest.approx(filled, abs=0.3 * cell * surface.area + 0.05)


def test_stock_after_beads_and_cuts_is_closed_and_holds_its_volume() -> None:
    stock = plate(16.0)
    for n in range(3):
        track(stock, vector(-5.0, 1.6 * n, 0.0), vector(5.0, 1.6 * n, 0.0))
    track(stock, vector(-5.0, 0.0, 0.8), vector(5.0, 2.0, 0.8))
    stock.cut(vector(0.0, -9.0, 0.3), vector(0.0, 9.0, 0.3), UP, UP, 1.5, 0.0, 30.0)
    surface = closed(*built_mesh(stock, 0.0))
    assert surface.volume == pytest.approx(stock.volume_mm3(), rel=0.02)
    closed(*built_mesh(stock, -np.inf))


def test_block_in_a_stock_reaches_from_the_base_to_its_top() -> None:
    stock = Stock(np.array([[-6.0, -5.0, -1.0], [6.0, 5.0, 5.0]]), 0.25, MATERIAL)
    stock.fill_box(np.array([[-5.0, -4.0, -1.0], [5.0, 4.0, 3.1]]))
    surface = closed(*built_mesh(stock, 0.1))
    assert surface.volume == pytest.approx(10.0 * 8.0 * 3.0, rel=0.008)
    assert surface.bounds == pytest.approx(np.array([[-5.0, -4.0, 0.1], [5.0, 4.0, 3.1]]), abs=1e-3)
