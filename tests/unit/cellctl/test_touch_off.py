"""Touched points against the simulated machine's own chain: what is measured is where the machine really is."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.domain.measured import Measured, MeasuredError, ToolMeasured, applied, check
from cellctl.measuring.touch_off import (
    Touched,
    TouchOffError,
    centre_of_rotation,
    part_origin,
    substrate_plane,
    tool_length,
)
from config.cell import Cell, load_cell
from sim.cnc.chain import Chain
from sim.real_machine import really

SHIFT = np.array([0.37, -0.22, 0.41])
MARK = np.array([55.0, 20.0, -440.0])


def shifted(name: str, letter: str) -> Cell:
    """A shipped cell whose real axis is beside where the file has it."""
    cell = load_cell(name)
    joint = next(one for one in (*cell.kinematics.table, *cell.kinematics.head) if one.axis == letter)
    across = SHIFT - np.dot(SHIFT, joint.direction) * np.array(joint.direction)
    real = {letter: tuple(np.array(joint.point_mm) + across)}
    return cell.model_copy(update={"simulation": cell.simulation.model_copy(update={"real_pivots_mm": real})})


def touching(cell: Cell, mark: np.ndarray, turned: dict[str, float], tool: int = 2, off: np.ndarray | None = None) -> Touched:
    """Joints at which the real machine's tip is on the mark (table frame), found on the plant's chain alone."""
    chain = Chain(really(cell))
    joints = np.array([turned.get(letter, 0.0) for letter in cell.letters])
    columns = [k for k, axis in enumerate(cell.axes) if axis.kind == "linear"]

    def tip(at: np.ndarray) -> np.ndarray:
        return np.asarray(chain.tip_in_table(at[None, :], tool)[0])

    base = tip(joints)
    slopes = np.column_stack([tip(joints + np.eye(len(joints))[k]) - base for k in columns])
    joints[columns] = np.linalg.solve(slopes, mark + (0.0 if off is None else off) - base)
    return Touched(dict(zip(cell.letters, map(float, joints), strict=True)), tool)


@pytest.mark.parametrize(
    ("name", "letter", "angles"),
    [
        ("trunnion_tcp", "C", (0.0, 90.0, 200.0, 290.0)),
        ("trunnion_tcp", "A", (-40.0, 0.0, 45.0)),
        ("head_table", "C", (0.0, 100.0, 220.0)),
        ("head_table", "B", (-40.0, 0.0, 40.0)),
    ],
)
def test_the_centre_that_is_measured_is_where_the_real_axis_is(name: str, letter: str, angles: tuple[float, ...]) -> None:
    cell = shifted(name, letter)
    mark = MARK if name.startswith("trunnion") else np.array([30.0, 20.0, -300.0])
    found = centre_of_rotation(cell, letter, [touching(cell, mark, {letter: angle}) for angle in angles])
    assert np.array(found.value) == pytest.approx(np.array(cell.simulation.real_pivots_mm[letter]), abs=1e-6)
    assert found.residual_mm < 1e-6


def test_one_point_that_is_off_shows_in_the_residuals() -> None:
    cell = shifted("trunnion_tcp", "C")
    points = [touching(cell, MARK, {"C": angle}) for angle in (0.0, 70.0, 150.0, 230.0)]
    points.append(touching(cell, MARK, {"C": 300.0}, off=np.array([0.3, 0.0, 0.0])))
    found = centre_of_rotation(cell, "C", points)
    assert found.residual_mm > 0.1 and int(np.argmax(found.residuals_mm)) == 4


@pytest.mark.parametrize(
    ("turns", "words"),
    [((0.0, 90.0), "three or more"), ((0.0, 20.0, 40.0), "60 deg or more")],
)
def test_points_that_tell_no_centre_are_refused(turns: tuple[float, ...], words: str) -> None:
    cell = shifted("trunnion_tcp", "C")
    with pytest.raises(TouchOffError, match=words):
        centre_of_rotation(cell, "C", [touching(cell, MARK, {"C": angle}) for angle in turns])


def test_another_axis_that_is_turned_is_refused() -> None:
    cell = shifted("trunnion_tcp", "C")
    with pytest.raises(TouchOffError, match="A does not stand at 0"):
        centre_of_rotation(cell, "C", [touching(cell, MARK, {"C": angle, "A": 5.0}) for angle in (0.0, 90.0, 180.0)])


def test_the_plane_through_touched_points_is_the_plates_with_its_tilt() -> None:
    cell = load_cell("trunnion_tcp")
    tilt = np.tan(np.radians(0.04))
    places = [(-40.0, -40.0), (40.0, -40.0), (0.0, 45.0), (30.0, 30.0)]
    points = [touching(cell, np.array([x, y, -419.6 + tilt * x]), {"C": 30.0}) for x, y in places]
    found = substrate_plane(cell, points)
    assert found.value == pytest.approx((0.0, 0.0, -419.6), abs=1e-6)
    assert found.tilt_deg == pytest.approx(0.04, abs=1e-6) and found.residual_mm < 1e-6
    with pytest.raises(TouchOffError, match="one line"):
        substrate_plane(cell, [touching(cell, np.array([x, 0.0, -420.0]), {}) for x in (0.0, 10.0, 20.0)])


def test_a_tool_that_is_longer_than_the_file_has_it_is_measured_on_a_gauge_block() -> None:
    cell = load_cell("trunnion_tcp")
    tips = {1: (60.0, 0.0, -161.3), 2: (0.0, 0.0, -139.2)}
    real = cell.model_copy(update={"simulation": cell.simulation.model_copy(update={"real_tips_mm": tips})})
    standoff = next(tool for tool in cell.tools if tool.number == 1).nozzle.standoff_mm
    mill = tool_length(real, 2, 20.0, [touching(real, np.array([10.0, 5.0, -400.0]), {}, tool=2)])
    head = tool_length(real, 1, 20.0, [touching(real, np.array([10.0, 5.0, -400.0 - standoff]), {}, tool=1)])  # its nozzle stands on the block
    assert mill.value == pytest.approx(tips[2], abs=1e-6)
    assert head.value == pytest.approx(tips[1], abs=1e-6)


def test_the_part_origin_is_where_the_tip_was_put() -> None:
    cell = load_cell("trunnion_tcp")
    found = part_origin(cell, [touching(cell, np.array([12.0, -7.0, -400.0]), {"C": 40.0})])
    assert found.value == pytest.approx((12.0, -7.0, -420.0), abs=1e-6)


def test_what_was_measured_changes_placement_tools_and_the_cells_hash_and_nothing_beyond_its_bounds() -> None:
    cell = load_cell("trunnion_tcp")
    measured = Measured((0.0, 0.0, -419.5), {"C": (0.1, 0.0, -450.0)}, {2: ToolMeasured(139.5, 8.0, 0.1, 0.05)})
    check(cell, measured)
    now = applied(cell, measured)
    tool = next(tool for tool in now.tools if tool.number == 2)
    assert (tool.tip_mm[2], tool.diameter_mm) == pytest.approx((-139.4, 7.95))
    assert now.placement.work_offset == cell.placement.work_offset and now.sha256 != cell.sha256
    for wrong, words in (
        (Measured(pivots_mm={"C": (6.0, 0.0, -450.0)}), "at most 5 mm"),
        (Measured(pivots_mm={"X": (0.0, 0.0, 0.0)}), "no rotary axis"),
        (Measured(part_origin_mm=(0.0, 0.0, -100.0)), "outside -500 to -250 mm"),
        (Measured(tools={2: ToolMeasured(140.0, 9.0)}), "diameter"),
        (Measured(tools={9: ToolMeasured(140.0, 9.0)}), "no such tool"),
        (Measured(tools={2: ToolMeasured(140.0, 8.0, length_wear_mm=-0.1)}), "0 to 1 mm"),
    ):
        with pytest.raises(MeasuredError, match=words):
            check(cell, wrong)
