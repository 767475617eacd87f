from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.report.chart import LEFT, RIGHT, WIDTH, Frame, Scale, path, spanning, ticks


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_round_evenly_spaced_and_inside(low: float, span: float) -> None:
    found = ticks(low, low + span)
    assert 2 <= len(found) <= 14
    step = found[1] - found[0]
    mantissa = step / 10.0 ** math.floor(math.log10(step) + 1e-6)
    assert min(abs(mantissa - value) for value in (1.0, 2.0, 5.0, 10.0)) < 1e-3 + 1e-6 * abs(low) / step
    assert all(low - 1e-6 * step <= value <= low + span + 1e-6 * step for value in found)


def test_scale_maps_its_ends_to_the_frame_and_keeps_what_lies_beyond_at_the_edge() -> None:
    frame = Frame(Scale(2.0, 4.0), Scale(0.1, 10.0, log=True), 100.0, 20.0)
    assert frame.px(np.array([2.0, 3.0, 4.0, 9.0])) == pytest.approx([LEFT, (LEFT + WIDTH - RIGHT) / 2, WIDTH - RIGHT, WIDTH - RIGHT])
    assert frame.py(np.array([0.1, 1.0, 10.0, 0.0])) == pytest.approx([120.0, 70.0, 20.0, 120.0])


def test_scale_of_values_that_are_no_numbers_or_all_equal_is_still_a_scale() -> None:
    for values in (np.full(3, np.nan), np.zeros(4), np.array([])):
        scale = spanning(values, "x")
        assert scale.low < scale.high and len(scale.marks) >= 2


def test_gap_in_the_values_is_a_gap_in_the_line() -> None:
    assert path(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([5.0, 6.0, np.nan, 7.0, 8.0])) == "M0 5L1 6M3 7L4 8"


def test_points_on_a_level_are_left_out_and_the_ends_stay() -> None:
    x = np.arange(1000.0)
    drawn = path(x, np.where(x < 500, 1.0, 2.0))
    assert drawn == "M0 1L499 1L500 2L999 2"


def test_bars_are_drawn_between_foot_and_top() -> None:
    frame = Frame(Scale(0.0, 10.0), Scale(0.0, 10.0), 100.0, 0.0, width=LEFT + RIGHT + 100.0)
    data = dict(frame.bars(np.array([2.0]), np.array([4.0]), np.array([0.0]), np.array([5.0]), "bar").attributes)["d"]
    assert [float(word) for word in re.findall(r"[0-9.]+", data)] == pytest.approx([LEFT + 20, 100, LEFT + 40, 50, LEFT + 20])
