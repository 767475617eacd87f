"""Blocks as text: what is written is read back as it was meant, arcs and splines included, by a parser that shares nothing with the writer."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.errors import PostError
from planner.post.blocks import Script, write
from planner.post.read_blocks import GRBLHAL, LINUXCNC, Grammar, Reading, read
from planner.post.read_curves import de_boor
from planner.post.tape import Move
from planner.post.words import Words, decimal, feed_word
from planner.program import LineKind, Program

Floats = NDArray[np.float64]

LETTERS = ("X", "Y", "Z", "A", "C")
OFFSET = np.array([1.0, -2.0, -420.0, 0.0, 90.0])
WORDS = Words(LETTERS, np.array([3, 3, 3, 4, 4]), OFFSET)
LINES_PER_S = 50_000


def program_of(lines: tuple[str, ...], kind: LineKind = LineKind.PROCESS) -> Program:
    """What the parser looks at of a Program."""
    table = np.zeros(len(lines), dtype=[("kind", "u1")])
    table["kind"] = kind
    return cast(Program, SimpleNamespace(lines=lines, table=table, axis_letters=LETTERS, work_offset=OFFSET))


def read_lines(lines: tuple[str, ...], grammar: Grammar = GRBLHAL, kind: LineKind = LineKind.PROCESS) -> Reading:
    return read(program_of(lines, kind), grammar)


def script_of(joints: Floats, bulge: Floats | None = None, by_time: bool = False, named: int = 0b11111) -> Script:
    n = len(joints) - 1
    counts = WORDS.counts(joints)
    way = np.linalg.norm(np.diff(WORDS.joints(counts), axis=0), axis=1)
    names = np.zeros(n, dtype=np.uint8)
    names[0] = named
    return Script(
        counts, np.full(n, Move.FEED, dtype=np.uint8), np.full(n, by_time), np.full(n, 0.5), way, names,
        np.zeros(n) if bulge is None else bulge, [None] * n,
    )  # fmt: skip


def wander(n: int, seed: int = 1) -> Floats:
    return np.cumsum(np.random.default_rng(seed).normal(size=(n + 1, 5)), axis=0)


@given(st.lists(st.integers(-99_999_999, 99_999_999), min_size=5, max_size=5), st.booleans())
@settings(max_examples=60, deadline=None)
def test_any_number_is_written_and_read_as_the_same_number(counts: list[int], by_time: bool) -> None:
    joints = np.vstack([np.zeros(5), WORDS.joints(np.array([counts]))])
    script = script_of(joints, by_time=by_time)
    lines = write(WORDS, script, 256)
    assert np.array_equal(WORDS.counts(read_lines(lines).joints[1:]), script.counts[1:])
    for letter, count, places in zip(LETTERS, counts, WORDS.decimals.tolist(), strict=True):
        assert f"{letter}{decimal(count, places)}" in lines[0]


def test_feeds_come_back_as_times_by_length_and_by_time() -> None:
    joints = wander(200)
    for by_time in (False, True):
        reading = read_lines(write(WORDS, script_of(joints, by_time=by_time), 256))
        assert np.allclose(reading.time_s[1:], 0.5, rtol=2e-4)  # five digits of the feed


def test_an_arc_comes_back_with_its_sweep_and_both_ends_on_its_circle() -> None:
    draw = np.random.default_rng(5)
    turns = draw.uniform(-np.pi, np.pi, 60)
    joints = np.zeros((61, 5))
    joints[1:, :2] = np.cumsum(draw.normal(scale=20.0, size=(60, 2)), axis=0)
    turns[0] = 0.0  # the first move leads to where the arcs begin
    bulge = np.tan(turns / 4.0)
    reading = read_lines(write(WORDS, script_of(joints, bulge), 256))
    arcs = reading.arcs
    assert arcs.lines.tolist() == list(range(1, 60))
    assert np.abs(arcs.sweep - turns[1:]).max() < 2e-3
    for share, point in ((0.0, reading.joints[:-1]), (1.0, reading.joints[1:])):
        ends = reading.at(arcs.lines, share)[:, :2]
        assert np.abs(ends - point[arcs.lines][:, :2]).max() < 1e-3  # rounding of I, J and of the ends
    middle = reading.at(arcs.lines, 0.5)[:, :2]
    chord = np.diff(WORDS.joints(WORDS.counts(joints)), axis=0)[1:, :2]
    left = np.column_stack([-chord[:, 1], chord[:, 0]])
    there = WORDS.joints(WORDS.counts(joints))[1:-1, :2] + 0.5 * chord - 0.5 * bulge[1:, None] * left
    assert np.abs(middle - there).max() < 2e-3


def test_an_end_beside_its_circle_is_refused() -> None:
    with pytest.raises(PostError, match="line 2: the arc's end is not on its circle"):
        read_lines(("N1G94G1X0Y0Z0A0C0F600", "N2G2X10Y1I5"))


def test_a_nurbs_is_read_as_the_curve_of_its_poles() -> None:
    lines = (
        "N1G94G1X0Y0Z5A0C0F600", "N2 G94G5.2X0Y1P0.707107L3F300", "N3 X1Y1P1", "N4 G5.3", "N5G1X2",
    )  # fmt: skip
    reading = read_lines(lines, LINUXCNC)
    quarter = reading.at(np.array([1, 2, 3]), 0.5)[:, :2] - OFFSET[:2] - [1.0, 0.0]
    assert np.abs(np.linalg.norm(quarter, axis=1) - 1.0).max() < 1e-6  # a quarter circle about (1, 0)
    assert reading.time_s[1:4].sum() == pytest.approx(np.pi / 2.0 / 300.0 * 60.0, rel=1e-3)
    assert reading.is_motion.all() and np.allclose(reading.joints[4, :2] - OFFSET[:2], [1.0, 1.0])
    with pytest.raises(PostError, match="cannot be read back"):
        read_lines(lines, GRBLHAL)


def test_de_boor_is_the_polynomial_between_its_knots_and_passes_through_both_ends() -> None:
    poles = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 2.0], [4.0, 0.0]])
    u = np.linspace(0.0, 1.0, 9)
    bernstein = np.column_stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3])
    assert np.allclose(de_boor(poles, np.ones(4), 4, u), bernstein @ poles, atol=1e-14)
    longer = np.random.default_rng(2).normal(size=(9, 2))
    ends = de_boor(longer, np.ones(9), 4, np.array([0.0, 6.0]))
    assert np.allclose(ends, longer[[0, -1]], atol=1e-14)


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("N2G1X1.2.3F1", "line 2 cannot be read back"),
        ("N3G1X1F1", "line 2 cannot be read back"),
        ("N2G1X1F1;fast", "line 2 cannot be read back"),
        ("N2G38.2X1F1G91", "line 2 cannot be read back"),
        ("N2G93G1X1", "line 2 has no feed"),
        ("N2G1X1 (open", "line 2 cannot be read back"),
    ],
)
def test_what_this_dialect_does_not_write_cannot_be_read_back(line: str, fault: str) -> None:
    with pytest.raises(PostError, match=fault):
        read_lines(("N1G94G1X0Y0Z0A0C0F600", line))


def test_behind_a_macro_that_moves_nothing_is_known_until_all_axes_are_named() -> None:
    lines = ("N1G0X0Y0Z0A0C0", "N2 G53 G0 Z0", "N3G0X5")
    joints = read_lines(lines, kind=LineKind.TOOL).joints
    assert np.isnan(joints[2]).all() and np.isnan(joints[3, 1:]).all() and joints[3, 0] == 5.0 + OFFSET[0]


def test_a_line_too_long_for_the_controller_is_refused_with_what_to_do() -> None:
    with pytest.raises(PostError, match=r"line 1 has .* characters, the controller takes fewer than 40"):
        write(WORDS, script_of(np.array([np.zeros(5), np.full(5, 1234.5678)])), 40)


def test_feed_words_have_five_digits() -> None:
    assert [feed_word(value) for value in (720.0, 123456.0, 0.0123456)] == ["F720", "F123456", "F0.012346"]


def test_writing_and_reading_take_more_than_fifty_thousand_blocks_a_second() -> None:
    joints = wander(20_000)
    lines = write(WORDS, script_of(joints), 256)
    read_lines(lines)  # both kernels are compiled now
    for work in (lambda: write(WORDS, script_of(joints), 256), lambda: read_lines(lines)):
        started = time.process_time()
        work()
        assert len(lines) / (time.process_time() - started) > LINES_PER_S
