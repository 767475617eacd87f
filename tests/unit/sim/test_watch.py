"""The watch: made-up pieces of motion with one thing wrong each, and a small Program broken on purpose, found with line, length and cause."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from config import Cell
from sim import watch_kernels as wk
from sim.cnc import lookahead as la
from sim.dryrun import DryRun, ProofCancelled, prove
from sim.findings import Finding
from sim.job import PROCESS_LINE
from sim.timeline import ROWS_MAX, Recorder
from tests.unit.sim.test_dryrun import CELL, CELL_MM, part, program, ran

LIMITS = np.zeros(wk.LIMITS)
for place, value in (
    (wk.LOW_W, 1.0), (wk.MELTS_W, 200.0), (wk.MOVING_MM_S, 0.5), (wk.STANDSTILL_S, 0.02), (wk.STRAY_S, 0.015), (wk.STARVED_SHARE, 0.8),
    (wk.DRY_G_MIN, 0.05), (wk.SLOW_SHARE, 0.6), (wk.SLOW_MM, 2.0), (wk.CLAMP_SHARE, 0.98), (wk.WASTE_MM, 6.0),
):  # fmt: skip
    LIMITS[place] = value
FASTEST = np.array([100.0, 100.0, 100.0])
POWER, POWDER, SPEED = 1000.0, 12.0, 10.0
TRAVEL = 1


def watched(*pieces: dict[str, Any], deployed: bool = True) -> list[NDArray[np.float64]]:
    """Events of pieces along x, each told by what differs from a good one: 1 mm of a process line in 0.1 s."""
    count = len(pieces)
    motion, tips = np.zeros((count, la.PIECE_COLUMNS)), np.zeros((count + 1, 3))
    emission, powder = np.full(count, POWER), np.full(count, POWDER)
    kinds = np.zeros(200, dtype=np.uint8)
    for k, piece in enumerate(pieces):
        length, seconds = piece.get("mm", 1.0), piece.get("s", piece.get("mm", 1.0) / SPEED)
        motion[k, la.DURATION], motion[k, la.PIECE_LINE] = seconds, 100 + k
        motion[k, la.PIECE_PROGRAMMED] = piece.get("programmed", SPEED)
        motion[k, la.PIECE_CAP], motion[k, la.PIECE_RPM] = piece.get("cap", 50.0), 0.0
        motion[k, la.TO] = length
        tips[k + 1] = tips[k] + [length, 0.0, 0.0]
        emission[k], powder[k] = piece.get("w", POWER), piece.get("powder", POWDER)
        kinds[100 + k] = piece.get("kind", PROCESS_LINE)
    episodes, events = np.zeros((wk.EPISODES, wk.KIND)), np.zeros((100, wk.KIND + 1))
    speeds, lines = np.zeros((count, 2)), np.zeros((200, 2))
    arguments = (motion, tips[:-1], tips[1:], emission, powder, kinds, LIMITS, FASTEST, POWER, POWDER, deployed, episodes, lines, speeds, events)
    found = list(events[: wk.scan(*arguments)[0]].copy())
    return found + list(events[: wk.close_all(episodes, LIMITS, events)].copy())


def only(events: list[NDArray[np.float64]], kind: int) -> NDArray[np.float64]:
    assert [int(event[wk.KIND]) for event in events] == [kind]
    return events[0]


GOOD: dict[str, Any] = {}
DARK = {"w": 0.0}


def test_good_pieces_have_no_event() -> None:
    assert watched(GOOD, GOOD, {**DARK, "kind": TRAVEL, "mm": 20.0}, GOOD) == []


def test_light_at_standstill_is_told_with_its_time_and_line() -> None:
    event = only(watched(GOOD, {"mm": 0.0, "s": 0.05}, GOOD), wk.STANDSTILL)
    assert event[wk.SECONDS] == pytest.approx(0.05) and event[wk.LINE] == 101 and event[wk.X] == pytest.approx(1.0)
    assert watched(GOOD, {"mm": 0.0, "s": 0.015}, GOOD) == []


def test_light_on_a_travel_line_is_told_beyond_the_laser_s_ramp() -> None:
    event = only(watched(GOOD, {"kind": TRAVEL, "mm": 2.0}, {"kind": TRAVEL}, {**DARK, "kind": TRAVEL}), wk.STRAY)
    assert event[wk.LENGTH] == pytest.approx(3.0) and event[wk.LINE] == 101
    assert watched(GOOD, {"kind": TRAVEL, "mm": 0.1, "w": 400.0}, {**DARK, "kind": TRAVEL}) == []


def test_light_with_the_head_parked_is_told() -> None:
    assert only(watched(GOOD, deployed=False), wk.PARKED)[wk.LINE] == 100


def test_bead_without_enough_powder_is_told_where_it_is_worst() -> None:
    event = only(watched(GOOD, {"powder": 9.0}, {"powder": 3.0}, {"powder": 6.0}, GOOD), wk.STARVED)
    assert event[wk.WORST] == pytest.approx(0.75) and event[wk.LINE] == 102 and event[wk.LENGTH] == pytest.approx(3.0)


def test_powder_over_the_part_without_light_is_told_beyond_a_lead_in() -> None:
    assert only(watched(GOOD, {**DARK, "mm": 8.0}, GOOD), wk.WASTE)[wk.LENGTH] == pytest.approx(8.0)
    assert watched({**DARK, "mm": 4.0}, GOOD) == []


def test_bead_laid_too_slowly_for_its_power_is_told_unless_the_power_follows() -> None:
    event = only(watched(GOOD, {"mm": 3.0, "s": 0.75}, GOOD), wk.SLOW)
    assert event[wk.WORST] == pytest.approx(10.0 / 4.0) and event[wk.LENGTH] == pytest.approx(3.0)
    assert watched(GOOD, {"mm": 3.0, "s": 0.75, "w": 0.4 * POWER}, GOOD) == []
    assert watched(GOOD, {"mm": 1.0, "s": 0.25}, GOOD) == []  # within one melt pool


def test_feed_that_an_axis_cannot_follow_is_told_with_the_axis() -> None:
    event = only(watched(GOOD, {"programmed": 80.0, "cap": 40.0, "s": 0.025}, GOOD), wk.SPEED)
    assert event[wk.WORST] == pytest.approx(2.0) and event[wk.AXIS] == 0


def test_timeline_keeps_extremes_means_and_time_however_long_the_run_is() -> None:
    recorder = Recorder()
    random = np.random.default_rng(3)
    dt = random.uniform(0.01, 0.4, 20_000)
    values = np.tile([1000.0, 1000.0, 12.0, 12.0, 10.0, 10.0, 0.2, 400.0], (len(dt), 1))
    values[:, 5] = random.uniform(5.0, 15.0, len(dt))
    values[7000, 6], values[12_345, 1] = 9.0, 3.0
    for begin in range(0, len(dt), 37):
        span = slice(begin, begin + 37)
        recorder.add(dt[span], np.ones(len(dt[span])), values[span])
    timeline = recorder.timeline(np.array([-1, 4]))
    assert ROWS_MAX // 2 <= len(timeline) <= ROWS_MAX
    width = np.diff(timeline.time_s)
    assert np.allclose(width, width[0])
    assert np.nanmax(timeline.gap_max_mm) == 9.0 and timeline.emission_min_w.min() == 3.0
    whole = np.append(width, dt.sum() - timeline.time_s[-1])
    assert whole @ timeline.speed_mm_s == pytest.approx(dt @ values[:, 5])
    assert set(timeline.layer.tolist()) == {4}


def finding(run: DryRun, kind: str) -> Finding:
    found = [each for each in run.found if each.kind == kind]
    assert found, [each.kind for each in run.found]
    return found[0]


def with_axis(letter: str, **limits: float) -> Cell:
    """The cell with other limits of one axis."""
    axes = tuple(axis.model_copy(update=limits) if axis.letter == letter else axis for axis in CELL.axes)
    return CELL.model_copy(update={"axes": axes})


def test_target_beyond_the_travel_is_found_with_axis_line_and_distance() -> None:
    given = program()
    index = next(i for i, line in enumerate(given.lines) if "X" in line and i > 30)
    lines = (*given.lines[:index], f"N{index + 1} G1 X300", *given.lines[index + 1 :])
    found = finding(ran(replace(given, lines=lines)), "travel")
    assert found.line == index + 1
    assert found.depth_mm == pytest.approx(300.0 - CELL.axis("X").max, abs=1e-3)
    assert "X would have to go" in found.text and found.at_mm is not None and found.help


def test_axis_that_is_too_slow_for_a_pass_is_found_by_its_letter() -> None:
    found = finding(ran(program(), with_axis("X", max_velocity=4.0)), "speed")
    assert "axis X" in found.text and found.severity == "error" and found.layer >= 0


def test_axis_that_brakes_too_early_overheats_the_bead() -> None:
    found = finding(ran(program(), with_axis("X", max_acceleration=4.0)), "acceleration")
    assert found.depth_mm > CELL.tools[0].diameter_mm
    assert program().table["kind"][found.line - 1] == PROCESS_LINE


def test_empty_hopper_starves_the_bead_and_is_named() -> None:
    simulation = CELL.simulation.model_copy(update={"hopper_g": 2.0})
    found = finding(ran(program(), CELL.model_copy(update={"simulation": simulation})), "starved")
    assert "hopper is empty" in found.text


def test_proof_is_cancelled_between_two_steps() -> None:
    asked: list[int] = []

    def cancelled() -> bool:
        asked.append(1)
        return len(asked) > 5

    with pytest.raises(ProofCancelled, match="cancelled at line"):
        prove(program(), CELL, part(), cell_mm=CELL_MM, cancelled=cancelled)
    assert len(asked) == 6
