"""The probe program for signs and pivots, run against machines that are not as their cell file says. The machine is the twin's chain."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from config.cell import Cell, load_cell
from planner.errors import PostError
from planner.post.selftest import Artefact, SelfTest, make_selftest
from planner.post.selftest_readings import judge, read_readings
from sim.cnc.chain import Chain as TrueChain

Floats = NDArray[np.float64]
CELLS = ("trunnion_tcp", "trunnion_rtu", "head_table", "head_head")
WORD = re.compile(r"([A-Z])(-?\d+\.?\d*)")


def machine(cell: Cell, probe_mm: float, letter: str = "", sense: float = 1.0, shift: tuple[float, ...] = ()) -> Cell:
    """The cell with a probe as tool 99, and one rotary joint turning otherwise or elsewhere than its file says."""

    def other(joint):  # type: ignore[no-untyped-def]
        if joint.axis != letter:
            return joint
        point = cell.placement.pivots_mm.get(letter, joint.point_mm)
        moved = tuple(a + b for a, b in zip(point, shift or (0.0, 0.0, 0.0), strict=True))
        return joint.model_copy(update={"direction": tuple(sense * v for v in joint.direction), "point_mm": moved})

    chains = cell.kinematics
    probe = cell.tools[0].model_copy(update={"number": 99, "tip_mm": (0.0, 0.0, -probe_mm)})
    kinematics = chains.model_copy(
        update={"table": tuple(map(other, chains.table)), "head": tuple(map(other, chains.head))}
    )
    placement = cell.placement.model_copy(update={"pivots_mm": {}})
    return cell.model_copy(update={"kinematics": kinematics, "tools": (*cell.tools, probe), "placement": placement})


def room(chain: TrueChain, joints: Floats, test: SelfTest) -> Floats:
    """(n,) mm between the probe's ball and the nearer of ball and cube."""
    artefact, r = test.artefact, 0.5 * test.artefact.probe_ball_mm
    tips = (chain.tip_in_table(joints, 99) - test.placed[:3, 3]) @ test.placed[:3, :3]
    ball = np.linalg.norm(tips - artefact.ball_mm, axis=1) - 0.5 * artefact.ball_diameter_mm
    outside = np.maximum(np.abs(tips - artefact.cube_mm) - 0.5 * artefact.edge_mm, 0.0)
    return np.asarray(np.minimum(ball, np.linalg.norm(outside, axis=1)) - r)


def run(test: SelfTest, true: Cell) -> str:
    """What the control would answer: each G38.3 of the text moved on the true chain until the probe's ball meets ball, cube or nothing."""
    chain, cell = TrueChain(true), test.cell
    offset = np.array([cell.placement.work_offset.get(letter, 0.0) for letter in cell.letters])
    here = np.zeros(len(cell.letters))
    out = []
    for line in test.lines:
        code = re.sub(r"\(.*\)", "", line)
        if not code.startswith(("G0", "G1", "G38.3")):
            continue
        goal = here.copy()
        for letter, value in WORD.findall(code.split(" ", 1)[1]):
            if letter in cell.letters:
                k = cell.letters.index(letter)
                goal[k] = float(value) + offset[k]
        if code.startswith("G38.3"):
            low, high = 0.0, 1.0
            for _ in range(4):  # the first of a hundred places that is in metal, four times finer
                shares = np.linspace(low, high, 101)
                way = here + shares[:, None] * (goal - here)
                met = np.flatnonzero(room(chain, way, test) <= 0.0)
                if met.size == 0:
                    break
                low, high = shares[max(met[0] - 1, 0)], shares[met[0]]
            at = here + high * (goal - here)
            out.append(f"[PRB:{','.join(f'{value:.4f}' for value in at)}:{int(met.size > 0)}]")
            here = at.copy()
        else:
            here = goal
    return "ok\n".join(out)


def half(test: SelfTest, text: str) -> str:
    """The answers of the first stage."""
    return "\n".join(text.split("ok\n")[: sum(touch.stage == 1 for touch in test.touches)])


@pytest.mark.parametrize("name", CELLS)
def test_readings_of_the_machine_of_the_file_are_the_expected_ones(name: str) -> None:
    cell = load_cell(name)
    test = make_selftest(cell)
    text = run(test, machine(cell, test.artefact.probe_length_mm))
    readings = read_readings(text, test)
    expected = np.array([touch.joints for touch in test.touches])
    assert np.abs(np.array(readings) - expected).max() < 2e-3
    assert len({touch.direction for touch in test.touches if touch.stage == 2}) == 5
    found = judge(test, readings)
    assert found.agrees and found.rest_mm < 2e-3 and len(found.lines) == 1


@pytest.mark.parametrize("name", CELLS)
def test_a_rotary_joint_that_turns_the_other_way_is_named_by_the_first_stage(name: str) -> None:
    cell = load_cell(name)
    test = make_selftest(cell)
    for joint in test.chain.rotary:
        text = half(test, run(test, machine(cell, test.artefact.probe_length_mm, joint.letter, -1.0)))
        found = judge(test, read_readings(text, test))
        assert found.turned == (joint.letter,) and not found.agrees, (joint.letter, found.lines)


@pytest.mark.parametrize("name", CELLS)
def test_a_pivot_that_lies_elsewhere_is_found_by_the_second_stage(name: str) -> None:
    cell = load_cell(name)
    test = make_selftest(cell)
    for joint in test.chain.rotary:
        shift = np.array([0.31, -0.22, 0.17])
        shift -= (shift @ joint.direction) * joint.direction
        true = machine(cell, test.artefact.probe_length_mm, joint.letter, shift=tuple(shift))
        found = judge(test, read_readings(run(test, true), test))
        assert not found.agrees and found.turned == () and found.explained_mm < 0.01, found.lines
        told = found.pivots_mm[joint.letter]
        others = [way for letter, way in found.pivots_mm.items() if letter != joint.letter]
        assert np.abs(told - shift).max() < 0.03 and np.abs(others).max() < 0.03, found.pivots_mm


def test_readings_that_do_not_belong_to_the_test_are_refused_in_one_line() -> None:
    test = make_selftest(load_cell("trunnion_tcp"))
    with pytest.raises(PostError, match="1 readings, the self-test has 20 touches"):
        read_readings("[PRB:1,2,3,4,5:1]", test)
    with pytest.raises(PostError, match="has 3 axes, cell trunnion-tcp has 5"):
        read_readings("[PRB:1,2,3:1]", test)
    with pytest.raises(PostError, match="0 of 20 touches met something"):
        judge(test, [None] * 20)


def test_cube_and_ball_too_near_to_each_other_are_refused() -> None:
    with pytest.raises(PostError, match="apart, the probe needs"):
        Artefact(ball_mm=(-5.0, -25.0, 12.5))
