"""The bodies drawn at a finding: which they are, where they stand, and that a hit's place lies in both of them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from planner.program import LineKind
from sim.findings import Finding
from sim.report.closeup import Camera, closeup, direction
from sim.report.silhouette import Scene, hull_of
from tests.cell.jobs import Writer
from tests.unit.sim.jobs_by_hand import CELL, FAST_MM_S, PASSES_X, SAFE_MM, TOP_MM, WALL_X, faced
from tests.unit.sim.report.made_up import GOUGE, ByHand, block

D4 = next(tool for tool in CELL.tools if tool.number == 3)


def found(kind: str, text: str, line: int, at: tuple[float, float, float]) -> Finding:
    return Finding(kind, text, line, 0, 1, at_mm=at, depth_mm=1.0)


def drive_d4(w: Writer) -> int:
    """The D4 along x at y = 0 to where its holder is 2 mm in the wall, and on beyond it."""
    w.line("M6 T3", LineKind.TOOL)
    w.tool = 3
    w.move(0.0, 0.0, SAFE_MM, LineKind.LINK, FAST_MM_S)
    w.move(0.0, 0.0, TOP_MM, LineKind.LINK, FAST_MM_S)
    return w.move(WALL_X - 12.0, 0.0, TOP_MM, LineKind.LINK, FAST_MM_S)


def test_tool_is_drawn_where_its_line_brings_it_into_the_place() -> None:
    program, line = faced(drive_d4)
    stand = Scene(program, CELL).at(found("collision", "T3 holder goes 2.00 mm into stock", line, (WALL_X + 1.0, 0.0, 30.0)))
    assert stand is not None
    assert [each.name for each in stand.outlines] == ["T3 flutes", "T3 shank", "T3 holder"] and all(each.is_tool for each in stand.outlines)
    holder = stand.outlines[2].points
    middle = 0.5 * (holder.min(axis=0) + holder.max(axis=0))
    assert np.ptp(holder[:, 0]) == pytest.approx(D4.holder_diameter_mm, rel=1e-6)
    assert holder[:, 2].min() == pytest.approx(TOP_MM + D4.stickout)
    assert middle[0] == pytest.approx(WALL_X - 12.0, abs=0.01) and middle[1] == pytest.approx(0.0, abs=1e-9)  # deepest at the line's end
    assert stand.axis[0] == pytest.approx([WALL_X - 12.0, 0.0, TOP_MM], abs=0.01)
    assert stand.axis[1] - stand.axis[0] == pytest.approx([0.0, 0.0, 60.0])


def test_cutter_of_a_gouge_stands_in_the_middle_of_its_line_beside_the_place() -> None:
    program, line = faced(deeper_mm=0.5)
    stand = Scene(program, CELL).at(found("gouge", "T2 cuts 0.50 mm below", line, (PASSES_X[2], 3.0, TOP_MM - 0.25)))
    assert stand is not None and stand.outlines[0].name == "T2 flutes"
    assert np.hypot(*(stand.axis[0, :2] - [PASSES_X[2], 3.0])) <= 4.0
    assert stand.axis[0, 2] == pytest.approx(TOP_MM - 0.5)


def test_what_a_tool_met_is_drawn_as_the_cell_s_file_has_it() -> None:
    program, line = faced()
    stand = Scene(program, CELL).at(found("collision", "T2 flutes goes 1.50 mm into clamp 3", line, (-50.0, 0.0, 7.0)))
    assert stand is not None and CELL.machine is not None
    (clamp,) = [each for each in stand.outlines if not each.is_tool]
    clamps, plate = CELL.machine.clamps, CELL.plate.size_mm
    low, high = clamp.points.min(axis=0), clamp.points.max(axis=0)
    assert clamp.name == "clamp 3" and high[2] == pytest.approx(clamps.above_mm)
    assert (low[0], high[0]) == pytest.approx((-0.5 * plate[0] - clamps.outside_mm, -0.5 * plate[0] + clamps.overlap_mm))


def test_word_that_is_also_a_body_s_name_draws_no_body() -> None:
    program, line = faced()
    stand = Scene(program, CELL).at(found("spindle off", "T2 meets metal 0.50 mm deep with the spindle standing", line, (PASSES_X[2], 0.0, TOP_MM)))
    assert stand is not None and all(each.is_tool for each in stand.outlines)


def test_program_without_joints_or_tool_and_cell_without_bodies_have_none() -> None:
    program, line = faced()
    finding = found("gouge", "T2 cuts", line, (0.0, 0.0, 4.0))
    assert Scene(ByHand(), CELL).at(GOUGE) is None
    assert Scene(program, CELL.model_copy(update={"machine": None})).at(finding) is None
    assert Scene(program, CELL).at(found("gouge", "T2 cuts", 1, (0.0, 0.0, 4.0))) is None


def test_hull_holds_all_points_and_turns_left_at_each_of_its_corners() -> None:
    points = np.random.default_rng(5).normal(size=(200, 2))
    hull = hull_of(points)
    side, nxt = np.roll(hull, -1, axis=0) - hull, hull
    cross = side[:, None, 0] * (points[None, :, 1] - nxt[:, None, 1]) - side[:, None, 1] * (points[None, :, 0] - nxt[:, None, 0])
    assert cross.min() > -1e-5
    turns = side[:, 0] * np.roll(side, -1, axis=0)[:, 1] - side[:, 1] * np.roll(side, -1, axis=0)[:, 0]
    assert (turns > 0.0).all()


def test_picture_shows_outlines_axis_and_names() -> None:
    program, line = faced()
    at = np.array([0.0, 0.0, 2.0])
    stand = Scene(program, CELL).at(found("collision", "T2 flutes goes 1.50 mm into clamp 3", line, (0.0, 0.0, 2.0)))
    made = str(closeup(block(), at, [], np.zeros((0, 3)), 0.3, "place", stand, 24.0))
    assert made.count('class="body-tool"') == 3 + 1 and made.count('class="body-met"') == 1 + 1  # and a line in the key for each
    assert "T2 flutes, T2 shank, T2 holder" in made and "clamp 3" in made and 'class="tool-axis"' in made
    assert not re.search(r"[0-9]e[+-]|nan|inf", re.sub(r"base64,[A-Za-z0-9+/=]*", "", made))


def test_outline_of_an_upright_cylinder_is_as_wide_as_it_is() -> None:
    program, line = faced()
    stand = Scene(program, CELL).at(found("gouge", "T2 cuts", line, (PASSES_X[2], 0.0, TOP_MM)))
    assert stand is not None
    for azimuth in (0.0, 0.7, 2.0):
        camera = Camera(np.zeros(3), direction(azimuth, 0.4), 10.0, 400, 300)
        flutes = hull_of(camera.project(stand.outlines[0].points)[:, :2])
        assert np.ptp(flutes[:, 0]) == pytest.approx(80.0, rel=0.01)  # 8 mm
