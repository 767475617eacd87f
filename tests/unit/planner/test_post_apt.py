"""APT: six numbers per motion, and what the reader notices; random passes written and read back in every dialect."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.cell import load_cell
from planner.nurbs.curve import Curve
from planner.post.tcp import WRITERS
from planner.post.tcp_text import numbers
from tests.unit.planner.tip_posts import (
    assert_is_the_plan,
    assert_noticed,
    bead_pass,
    hybrid,
    mill_pass,
    sequenced,
    with_nurbs,
    written,
)


@pytest.mark.parametrize("cell", ["trunnion_tcp", "head_head"])
def test_read_back_it_is_the_plan_within_the_cells_tolerances(cell: str) -> None:
    assert_is_the_plan("apt", cell)


def test_every_goto_has_a_tip_and_a_unit_axis() -> None:
    lines = hybrid("apt").program.lines
    moves = np.array([[float(value) for value in line[5:].split(",")] for line in lines if line.startswith("GOTO/")])
    assert moves.shape[1] == 6 and np.allclose(np.linalg.norm(moves[:, 3:], axis=1), 1.0, atol=1e-6)
    assert lines[0].startswith("PARTNO/") and lines[-1] == "FINI"
    assert {"UNITS/MM", "MULTAX/ON", "LOADTL/1", "LOADTL/2"} <= set(lines)


MUTATIONS = {
    "a sign": (lambda t: re.match(r"GOTO/1\d", t), lambda t: t.replace("GOTO/", "GOTO/-")),
    "a feed": (lambda t: t == "FEDRAT/720,MMPM", lambda t: "FEDRAT/721,MMPM"),
    "a gate word": (lambda t: t == "AUXFUN/62", lambda t: "PPRINT/GONE"),
    "RAPID": (lambda t: t == "RAPID", lambda t: "RAPIDLY"),
    "MULTAX": (lambda t: t == "MULTAX/ON", lambda t: "PPRINT/GONE"),
    "the end": (lambda t: t == "FINI", lambda t: "PPRINT/GONE"),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_reader_notices_a_change_of(name: str) -> None:
    find, change = MUTATIONS[name]
    assert_noticed(name, hybrid("apt").with_line(lambda line: bool(find(line)), change))


def random_curve(rng: np.random.Generator, weighted: bool) -> Curve:
    """A NURBS of degree 2 or 3 that winds about, with knots of any multiplicity below full, and weights if asked."""
    degree, count = int(rng.integers(2, 4)), int(rng.integers(5, 10))
    inner = np.sort(rng.choice(np.linspace(0.1, 0.9, 9), count - degree - 1, replace=degree == 3))
    inner = (
        inner[np.append(np.append(True, True), inner[2:] > inner[:-2])[: len(inner)]]
        if degree == 3
        else np.unique(inner)
    )
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    points = np.cumsum(rng.uniform([2.0, -6.0, -0.5], [9.0, 6.0, 0.5], (len(inner) + degree + 1, 3)), axis=0) - [
        20,
        0,
        -6,
    ]
    weights = np.round(rng.uniform(0.5, 1.5, len(points)), 4) if weighted else None
    return Curve(degree, knots, points, weights)


def random_axis(rng: np.random.Generator, tip: Curve) -> Curve:
    """An axis NURBS on the tip's domain, on knots of its own, that leans less than 30 degrees."""
    knots = np.concatenate([np.zeros(tip.degree + 1), [0.45], np.ones(tip.degree + 1)])
    lean = rng.uniform(0.15, 0.35, (len(knots) - tip.degree - 1, 2))
    return Curve(tip.degree, knots, np.column_stack([lean, np.ones(len(lean))]))


@settings(max_examples=3, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_passes_come_back_as_they_were_in_every_dialect(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cell = with_nurbs(load_cell("trunnion_tcp"))
    tip = random_curve(rng, weighted=False)
    for plan in (bead_pass(random_curve(rng, weighted=True)), mill_pass(tip, random_axis(rng, tip))):
        tape = sequenced(plan, cell)
        for dialect in WRITERS:
            report = written(tape, dialect).read()
            assert not report.faults, dialect
            assert report.max_tip_mm <= cell.chord_tolerance_mm and report.max_axis_deg <= cell.axis_tolerance_deg


@given(st.lists(st.floats(-1e5, 1e5), min_size=1), st.integers(1, 7), st.sampled_from(["", "."]))
def test_numbers_say_what_they_stand_for_in_plain_digits(values: list[float], decimals: int, point: str) -> None:
    texts = numbers(np.array(values), decimals, point)
    for value, text in zip(values, texts, strict=True):
        assert re.fullmatch(r"-?\d+(\.\d*)?", text) and len(text.partition(".")[2]) <= decimals
        assert abs(float(text) - value) <= 0.5000001 * 10.0**-decimals + 1e-10


def test_a_rapid_that_turns_is_written_in_small_steps_along_the_way_of_the_axes() -> None:
    made = hybrid("apt")
    table = made.program.table
    rapid = np.flatnonzero([line == "RAPID" for line in made.program.lines])
    joints = np.stack([table["joints_end"][rapid - 1], table["joints_end"][rapid]])
    steps = np.abs(joints[1] - joints[0])[:, 3:].max(axis=1)
    assert steps.max() > 1.0 and steps.max() <= 5.0 + 1e-9
