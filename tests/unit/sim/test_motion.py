"""Motion of the simulated CNC against closed formulas and invariants: limits kept, ends met, the same path for any step."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from config import Cell, load_cell
from sim.cnc import lookahead as la
from sim.cnc.actions import FEED, INVERSE_TIME, RAPID
from sim.cnc.arcs import segments
from sim.cnc.chain import Chain
from sim.cnc.firmware import Firmware
from sim.cnc.motion import Motion

CELL: Cell = load_cell("trunnion_tcp")
X_ACCELERATION = 1500.0
STILL = 5e-3  # mm/s: what is left of a speed a nanometre before the end


def new_motion(capacity: int = 100) -> Motion:
    return Motion(CELL.axes, capacity, [0.0] * 5)


def drive(motion: Motion, dt: float) -> NDArray[np.float64]:
    """All pieces until the buffer is empty."""
    pieces = [np.zeros((0, la.PIECE_COLUMNS))]
    while motion.count:
        motion.begin()
        motion.advance(dt, False, -1)
        pieces.append(motion.pieces.copy())
    return np.concatenate(pieces)


def duration(pieces: NDArray[np.float64]) -> float:
    return float(pieces[:, la.DURATION].sum())


def test_one_move_takes_the_time_of_its_trapezoid() -> None:
    motion = new_motion()
    motion.append([100, 0, 0, 0, 0], FEED, 6000, 1)
    v, a = 100.0, X_ACCELERATION
    assert duration(drive(motion, 0.007)) == pytest.approx(100 / v + v / a, abs=1e-6)


def test_a_short_move_takes_the_time_of_its_triangle() -> None:
    motion = new_motion()
    motion.append([1, 0, 0, 0, 0], RAPID, 0, 1)
    assert duration(drive(motion, 1.0)) == pytest.approx(2 * math.sqrt(1 / X_ACCELERATION), abs=1e-6)


def test_inverse_time_moves_take_their_time_but_for_the_ramps() -> None:
    motion = new_motion()
    motion.append([10, 0, 0, 5, 20], INVERSE_TIME, 2.0, 1)
    assert duration(drive(motion, 0.01)) == pytest.approx(2.0, rel=0.02)


def test_collinear_blocks_are_passed_without_slowing() -> None:
    motion = new_motion()
    for k in range(1, 51):
        motion.append([k * 2.0, 0, 0, 0, 0], FEED, 6000, k)
    assert duration(drive(motion, 0.005)) == pytest.approx(100 / 100.0 + 100 / X_ACCELERATION, abs=1e-6)


def test_a_reversal_comes_to_a_standstill() -> None:
    motion = new_motion()
    motion.append([10, 0, 0, 0, 0], FEED, 6000, 1)
    motion.append([0, 0, 0, 0, 0], FEED, 6000, 2)
    pieces = drive(motion, 0.001)
    turn = np.flatnonzero(pieces[:, la.PIECE_LINE] == 1)[-1]
    assert pieces[turn, la.PIECE_SPEED] == pytest.approx(0.0, abs=STILL)


speeds = st.floats(0.01, 250.0)


@given(speeds, speeds, st.floats(1.0, 2000.0), st.floats(1e-9, 50.0), st.floats(-1e-6, 1e-6))
def test_a_block_is_left_after_a_few_phases_whatever_the_speeds(
    nominal: float, exit_speed: float, acceleration: float, room: float, off: float
) -> None:
    exit_speed = min(exit_speed, nominal)
    v = max(math.sqrt(exit_speed**2 + 2 * acceleration * room) * (1.0 + off), 0.0)
    for _ in range(8):
        if room <= la.PLACE_EPS:
            break
        a, duration = la.next_phase(v, acceleration, room, nominal, exit_speed, False)
        room -= v * duration + 0.5 * a * duration**2
        v = max(v + a * duration, 0.0)
    assert room <= la.PLACE_EPS


points = st.lists(
    st.tuples(*(st.floats(-50, 50) for _ in range(3)), *(st.floats(-30, 30) for _ in range(2))), min_size=2, max_size=25
)


@given(points, st.floats(60, 12000))
def test_limits_are_kept_and_every_end_is_met(targets: list[tuple[float, ...]], feed: float) -> None:
    motion = new_motion()
    for k, target in enumerate(targets):
        motion.append(target, FEED, feed, k + 1)
    pieces = drive(motion, 0.02)
    dt = pieces[:, la.DURATION][:, None]
    start, end = pieces[:, la.FROM : la.FROM + 5], pieces[:, la.TO : la.TO + 5]
    limits = np.array([axis.max_velocity for axis in CELL.axes])
    long = dt[:, 0] > 1e-6
    assert np.all(np.abs(end - start)[long] <= limits * dt[long] * (1 + 1e-6) + 1e-9)
    assert np.abs(end[:-1] - start[1:]).max(initial=0.0) < 1e-9
    assert np.allclose(motion.position, targets[-1], atol=la.LENGTH_MIN)
    for line, target in enumerate(targets, 1):
        rows = np.flatnonzero(pieces[:, la.PIECE_LINE] == line)
        if len(rows):
            assert np.allclose(end[rows[-1]], target, atol=1e-8)


@given(points)
def test_speed_never_jumps_more_than_the_acceleration_allows(targets: list[tuple[float, ...]]) -> None:
    motion = new_motion()
    for k, target in enumerate(targets):
        motion.append(target, FEED, 3000, k + 1)
    speed = 0.0
    while motion.count:
        motion.begin()
        motion.advance(0.003, False, -1)
        for piece in motion.pieces:
            fastest = 1500.0 * math.sqrt(5)
            assert abs(piece[la.PIECE_SPEED] - speed) <= fastest * piece[la.DURATION] + 1e-6
            speed = piece[la.PIECE_SPEED]
    assert speed == pytest.approx(0.0, abs=STILL)


@pytest.mark.parametrize("dt", [0.0007, 0.005, 0.13, 5.0])
def test_every_step_size_gives_the_same_path_and_time(dt: float) -> None:
    def ends(step: float) -> tuple[float, NDArray[np.float64]]:
        motion = new_motion()
        for k in range(80):
            motion.append([20 * math.cos(k / 9), 20 * math.sin(k / 9), k * 0.1, k * 0.5, k], FEED, 2000, k + 1)
        pieces = drive(motion, step)
        last = [np.flatnonzero(pieces[:, la.PIECE_LINE] == n)[-1] for n in range(1, 81)]
        time = np.cumsum(pieces[:, la.DURATION])[last]
        return duration(pieces), np.column_stack((time, pieces[last][:, la.TO : la.TO + 5]))

    total, table = ends(dt)
    reference, expected = ends(0.01)
    assert total == pytest.approx(reference, abs=1e-6)
    assert np.allclose(table, expected, atol=1e-6)


def test_rotary_moves_are_cut_so_that_the_tip_path_stays_near_the_pieces() -> None:
    motion = new_motion()
    motion.append([0, 0, 0, 40, 0], RAPID, 0, 1)
    pieces = drive(motion, 10.0)
    turned = np.abs(pieces[:, la.TO + 3] - pieces[:, la.FROM + 3])
    assert turned.max() <= la.ROTARY_PIECE_DEG + 1e-9
    assert turned.sum() == pytest.approx(40.0)


def test_hold_brakes_at_the_limit_along_the_path_and_resumes_to_the_same_end() -> None:
    motion = new_motion()
    for k in range(1, 101):
        motion.append([k * 1.0, 0, 0, 0, 0], FEED, 6000, k)
    motion.begin()
    motion.advance(0.3, False, -1)
    before = motion.position[0]
    while motion.speed > 0.0:
        motion.advance(0.005, True, -1)
    assert motion.position[0] - before == pytest.approx(100.0**2 / (2 * X_ACCELERATION), abs=1e-6)
    drive(motion, 0.01)
    assert motion.position.tolist() == pytest.approx([100, 0, 0, 0, 0])


def test_feed_override_changes_the_speed_of_blocks_already_planned() -> None:
    motion = new_motion()
    motion.append([100, 0, 0, 0, 0], FEED, 600, 1)
    motion.begin()
    motion.advance(1.0, False, -1)
    assert motion.speed == pytest.approx(10.0)
    motion.override(0.5, 1.0)
    motion.advance(0.2, False, -1)
    assert motion.speed == pytest.approx(5.0)


def test_synchronised_outputs_switch_where_their_move_begins() -> None:
    motion = new_motion()
    motion.append([10, 0, 0, 0, 0], FEED, 600, 1)
    motion.output(0, True, True)
    motion.append([20, 0, 0, 0, 0], FEED, 600, 2)
    motion.output(0, False, True)
    motion.append([30, 0, 0, 0, 0], FEED, 600, 3)
    pieces = drive(motion, 0.5)
    on = pieces[:, la.PIECE_OUTPUTS] == 1
    assert pieces[on, la.FROM].min() == pytest.approx(10.0)
    assert pieces[on, la.TO].max() == pytest.approx(20.0)
    assert np.array_equal(on, pieces[:, la.PIECE_LINE] == 2)


def test_arc_points_lie_on_the_circle_and_chords_within_tolerance() -> None:
    around = segments([10.0, 0, 0, 0, 0], [10.0, 0, 5, 0, 0], (-10.0, 0.0), (0, 1), clockwise=False, tolerance_mm=0.002)
    path = np.array([[10.0, 0, 0, 0, 0], *around])
    assert np.allclose(np.hypot(path[:, 0], path[:, 1]), 10.0)
    middle = 0.5 * (path[1:, :2] + path[:-1, :2])
    assert (10.0 - np.hypot(middle[:, 0], middle[:, 1])).max() <= 0.0021
    assert path[-1, 2] == 5.0
    angles = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
    assert angles[-1] - angles[0] == pytest.approx(2 * math.pi)


def run_of(cell: Cell, text: str) -> NDArray[np.float64]:
    """All pieces of motion of some lines in a cell's firmware."""
    firmware = Firmware(cell)
    firmware.receive(text.encode())
    pieces = [np.zeros((0, la.PIECE_COLUMNS))]
    while not pieces[1:] or firmware.machine.motion.count:
        firmware.step(0.01)
        pieces.append(firmware.machine.motion.pieces.copy())
    return np.concatenate(pieces)


def with_cnc(**facts: float) -> Cell:
    return CELL.model_copy(update={"cnc": CELL.cnc.model_copy(update=facts)})


def test_corner_is_passed_at_the_speed_that_the_cell_s_junction_deviation_allows() -> None:
    slowest = []
    for deviation_mm in (0.01, 0.04):
        pieces = run_of(with_cnc(junction_deviation_mm=deviation_mm), "G1 X-20 F6000\nG1 Y-20\n")
        corner = pieces[np.flatnonzero(np.diff(np.abs(pieces[:, la.TO + 1]) > 1e-9))[0], la.PIECE_SPEED]
        half_sine = math.sqrt(0.5)
        acceleration = math.sqrt(2.0) * min(CELL.axis("X").max_acceleration, CELL.axis("Y").max_acceleration)
        assert corner == pytest.approx(math.sqrt(acceleration * deviation_mm * half_sine / (1.0 - half_sine)), rel=1e-3)
        slowest.append(corner)
    assert slowest[1] == pytest.approx(2.0 * slowest[0], rel=1e-3)


@pytest.mark.parametrize("tolerance_mm", [0.002, 0.05])
def test_arc_is_cut_into_chords_by_the_cell_s_arc_tolerance(tolerance_mm: float) -> None:
    pieces = run_of(with_cnc(arc_tolerance_mm=tolerance_mm), "G1 X-1 F6000\nG3 X-21 Y0 I-10 J0 F600\n")
    places = pieces[:, la.TO : la.TO + 2]
    places = places[np.abs(places[:, 1]) > 1e-9]
    inside = 10.0 - np.hypot(places[:, 0] + 11.0, places[:, 1])
    assert 0.8 * tolerance_mm < inside.max() <= tolerance_mm + 1e-6


@pytest.mark.parametrize("word", ["I-10 J0", "R10"])
def test_a_half_circle_by_centre_and_by_radius_takes_the_same_time(word: str) -> None:
    machine = Firmware(CELL)
    machine.receive(f"G1 X10 F6000\nG3 X-10 Y0 {word} F600\n".encode())
    elapsed = 0.0
    machine.step(0.001)
    while machine.machine.motion.count:
        machine.step(0.01)
        elapsed += 0.01
    assert machine.machine.motion.position[:2].tolist() == pytest.approx([-10.0, 0.0])
    assert elapsed == pytest.approx(math.pi * 10 / 10.0 + 0.25, abs=0.2)


def rotation(axis: tuple[float, ...], degrees: float) -> NDArray[np.float64]:
    """Matrix exponential of the cross-product matrix by its series: independent of Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) * math.radians(degrees)
    term, total = np.eye(3), np.eye(3)
    for k in range(1, 60):
        term = term @ cross / k
        total = total + term
    return total


@given(st.tuples(*(st.floats(-100, 100) for _ in range(3)), st.floats(-110, 110), st.floats(-720, 720)))
def test_tip_and_axis_agree_with_products_of_matrices(joints: tuple[float, ...]) -> None:
    chain, values = Chain(CELL), dict(zip(CELL.letters, joints, strict=True))
    table = np.eye(4)
    for joint in CELL.kinematics.table:
        turn = np.eye(4)
        turn[:3, :3] = rotation(joint.direction, values[joint.axis])
        turn[:3, 3] = np.array(joint.point_mm) - turn[:3, :3] @ np.array(joint.point_mm)
        table = table @ turn
    tip_world = np.array([values["X"], values["Y"], values["Z"]]) + np.array(CELL.tools[0].tip_mm)
    expected = np.linalg.inv(table) @ np.append(tip_world, 1.0)
    row = np.array([joints])
    assert np.allclose(chain.tip_in_world(row, 1)[0], tip_world, atol=1e-9)
    assert np.allclose(chain.tip_in_table(row, 1)[0], expected[:3], atol=1e-6)
    assert np.allclose(chain.axis_in_table(row, 1)[0], np.linalg.inv(table)[:3, 2], atol=1e-9)


def test_a_program_fed_by_supply_is_followed_with_large_steps() -> None:
    machine = Firmware(CELL)
    lines = iter([f"N{k} G1 X{k % 7} Y{k % 5} F6000\n".encode() for k in range(1, 2001)])
    machine.supply = lambda free: next(lines, b"")
    passed: list[int] = []
    while machine.machine.motion.line or not passed:
        machine.step(2.0)
        numbers = machine.machine.motion.pieces[:, la.PIECE_LINE].astype(int)
        passed += [n for n in numbers if n and (not passed or passed[-1] != n)]
    unique = list(dict.fromkeys(passed))
    assert all(b > a for a, b in pairwise(unique))
    assert unique[-1] == 2000


def test_a_program_takes_the_same_time_and_stands_nowhere_whatever_the_step() -> None:
    def ends(step: float) -> dict[int, float]:
        machine = Firmware(CELL)
        lines = iter([f"N{k} G1 X{20 * math.cos(k / 60):.3f} Y{20 * math.sin(k / 60):.3f} F600\n".encode() for k in range(1, 601)])
        machine.supply = lambda free: next(lines, b"")
        machine.step(1e-9)
        elapsed, found = 0.0, dict[int, float]()
        while machine.machine.motion.count:
            machine.step(step)
            for piece in machine.machine.motion.pieces:
                moves = np.any(piece[la.FROM : la.FROM + 5] != piece[la.TO : la.TO + 5])
                assert moves or not piece[la.PIECE_LINE] or piece[la.DURATION] < 1e-6
                elapsed += piece[la.DURATION]
                found[int(piece[la.PIECE_LINE])] = elapsed
        return {line: time for line, time in found.items() if line}

    reference = ends(0.005)
    assert len(reference) == 600
    for step in (0.05, 0.7, 9.0):
        assert ends(step) == pytest.approx(reference, abs=1e-4)
