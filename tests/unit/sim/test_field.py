"""The sparse field against a dense array that gets the same values, and against planes and spheres."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, METAL, Field, mark_at, put, settle, value_at
from sim.process.solid import unite

CELL, BAND = 0.25, 0.75
ORIGIN = np.array([-3.0, -2.0, 1.0])
CELLS = (24, 20, 30)  # rounded up to 24, 24, 32


def box(*corner: int) -> NDArray[np.int64]:
    return np.array(corner, dtype=np.int64)


def filled(field: Field, values: NDArray[np.float64], mark: int = 0) -> Field:
    """Write a dense array cell by cell."""
    field.reserve(box(0, 0, 0), box(*field.shape))
    for i, j, k in np.ndindex(*values.shape):
        put(field.blocks, i, j, k, float(values[i, j, k]), mark)
    settle(field.blocks, box(0, 0, 0), box(*field.shape))
    return field


def grid(field: Field) -> NDArray[np.float64]:
    """Cell centres, (nx, ny, nz, 3), mm."""
    return field.origin + field.cell_mm * np.stack(np.meshgrid(*(np.arange(n) for n in field.shape), indexing="ij"), axis=-1)


def ball(radius: float = 1.7) -> tuple[Field, NDArray[np.float64]]:
    field = Field(ORIGIN, CELL, BAND, CELLS)
    values = np.linalg.norm(grid(field) - [0.0, 0.9, 4.8], axis=-1) - radius
    return filled(field, values, 4), values


def test_empty_field_is_air_without_blocks() -> None:
    field = Field(ORIGIN, CELL, BAND, CELLS)
    assert field.shape == (24, 24, 32)
    assert len(field.occupied()) == 0
    assert value_at(field.blocks, 3, 4, 5) == BAND
    assert (field.dense((0, 0, 0), field.shape) == BAND).all()
    assert list(field.slabs(8)) == []


def test_window_holds_what_was_put_and_air_beyond_the_grid() -> None:
    field, values = ball()
    assert np.array_equal(field.dense((0, 0, 0), field.shape), np.clip(values, -BAND, BAND).astype(np.float32))
    window = field.dense((-3, 5, 7), (26, 26, 40))
    assert window.shape == (29, 21, 33)
    assert np.array_equal(window[3:27, :19, :25], field.dense((0, 5, 7), (24, 24, 32)))
    assert (window[:3] == np.float32(BAND)).all() and (window[:, :, 25:] == np.float32(BAND)).all()


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.integers(-2, 25), st.integers(-2, 25), st.integers(-2, 33), st.floats(-1.0, 1.0)), max_size=60))
def test_cells_hold_what_was_put_last_as_a_dense_array_does(writes: list[tuple[int, int, int, float]]) -> None:
    field = Field(ORIGIN, CELL, BAND, CELLS)
    dense = np.full(field.shape, BAND, dtype=np.float32)
    field.reserve(box(0, 0, 0), box(*field.shape))
    for n, (i, j, k, value) in enumerate(writes):
        put(field.blocks, i, j, k, value, n)
        if min(i, j, k) >= 0 and i < 24 and j < 24 and k < 32:
            dense[i, j, k] = np.float32(np.clip(value, -BAND, BAND))
        if n % 7 == 0:
            settle(field.blocks, box(0, 0, 0), box(*field.shape))
    assert np.array_equal(field.dense((0, 0, 0), field.shape), dense)
    assert all(value_at(field.blocks, i, j, k) == dense[i, j, k] for i, j, k in [(0, 0, 0), (23, 23, 31), (8, 7, 16)])


def test_blocks_that_became_uniform_go_back_and_are_used_again() -> None:
    field = Field(ORIGIN, CELL, BAND, CELLS)
    filled(field, np.full(field.shape, -BAND))
    assert (field.blocks.directory == METAL).all()
    assert len(field.occupied()) == 0
    used = field.memory_bytes
    filled(field, np.full(field.shape, BAND))
    assert (field.blocks.directory == AIR).all()
    assert field.memory_bytes == used


def test_room_grows_and_what_is_written_stays() -> None:
    field = Field(np.zeros(3), 1.0, 3.0, (80, 80, 80))
    corners = [(i, j, k) for i in range(0, 80, BLOCK) for j in range(0, 80, BLOCK) for k in range(0, 80, BLOCK)]
    for n, (i, j, k) in enumerate(corners):
        field.reserve(box(i, j, k), box(i + 1, j + 1, k + 1))
        put(field.blocks, i, j, k, 0.001 * n, n)
    assert len(field.occupied()) == len(corners) == 1000
    for n, (i, j, k) in enumerate(corners):
        assert value_at(field.blocks, i, j, k) == pytest.approx(0.001 * n)
        assert mark_at(field.blocks, i, j, k) == n


def test_block_without_room_is_refused() -> None:
    field = Field(np.zeros(3), 1.0, 3.0, (80, 80, 80))
    with pytest.raises(RuntimeError, match="reserve"):
        for n in range(0, 80, BLOCK):
            for m in range(0, 80, BLOCK):
                put(field.blocks, n, m, 0, 0.0, 0)


def test_distance_and_gradient_of_a_ball() -> None:
    field, _ = ball()
    angle = np.linspace(0.0, 6.0, 50)
    away = np.column_stack([np.cos(angle), np.sin(angle) * np.cos(3.0 * angle), np.sin(angle) * np.sin(3.0 * angle)])
    points = np.array([0.0, 0.9, 4.8]) + 1.8 * away
    assert np.abs(field.distance(points) - 0.1).max() < 0.1 * CELL
    assert np.abs(field.gradient(points) - away).max() < 0.05
    assert (field.marks(points) == 4).all()


def test_slabs_hold_all_metal_once_and_meet_in_one_layer() -> None:
    field, values = ball()
    low, high = field.metal_box()
    metal = 0
    for first, slab in field.slabs(5):
        assert slab.shape[:2] == tuple(high[:2] - low[:2])
        assert np.array_equal(slab, field.dense((low[0], low[1], first), (high[0], high[1], first + slab.shape[2])))
        metal += int((slab[:, :, 0 if first == low[2] else 1 :] < 0.0).sum())
    assert metal == int((values < 0.0).sum())


def test_restored_field_is_the_field_that_was_kept() -> None:
    field, _ = ball()
    state = field.snapshot()
    before = field.dense((0, 0, 0), field.shape)
    filled(field, np.full(field.shape, -BAND))
    field.restore(state)
    assert np.array_equal(field.dense((0, 0, 0), field.shape), before)
    again = field.snapshot()
    assert all(np.array_equal(state[name], again[name]) for name in state)
    with pytest.raises(ValueError, match="snapshot"):
        Field(ORIGIN, CELL, BAND, (8, 8, 8)).restore(state)


def test_memory_grows_with_the_surface() -> None:
    used = []
    for size in (40, 80):
        field = Field(np.zeros(3), 1.0, 3.0, (size, size, size))
        middle, radius = 0.5 * size, 0.4 * size
        unite(field, lambda points, middle=middle, radius=radius: np.linalg.norm(points - middle, axis=1) - radius)  # type: ignore[misc]
        used.append(field.occupied().shape[0])
    assert used[1] / used[0] < 5.0  # a dense grid: 8
