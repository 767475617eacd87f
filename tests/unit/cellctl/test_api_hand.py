"""Touch-off and tools over REST without a cell process: who may, what is refused, and that nothing is adopted unheard."""

from __future__ import annotations

import numpy as np
import pytest

from config.cell import load_cell
from tests.unit.cellctl.conftest import Web
from tests.unit.cellctl.test_touch_off import shifted, touching

MARK = np.array([55.0, 20.0, -440.0])


def points(angles: tuple[float, ...]) -> list[dict[str, object]]:
    cell = shifted("trunnion_tcp", "C")
    return [{"joints": one.joints, "tool": one.tool} for one in (touching(cell, MARK, {"C": angle}) for angle in angles)]


async def test_points_are_fitted_for_everybody_and_adopted_by_nobody_without_a_cell(web: Web) -> None:
    asked = {"kind": "pivot", "axis": "C", "points": points((0.0, 100.0, 200.0))}
    found = await web.viewer.post("/api/v1/cell/touch_off/fit", json=asked)
    assert found.status_code == 200
    assert found.json()["shift_mm"] == pytest.approx([0.37, -0.22, 0.0], abs=1e-6) and found.json()["adoptable"]
    assert (await web.viewer.post("/api/v1/cell/touch_off/adopt", json={**asked, "because": "x"})).status_code == 403
    assert (await web.operator.post("/api/v1/cell/touch_off/adopt", json={**asked, "because": "bearing"})).status_code == 503
    assert (await web.viewer.get("/api/v1/cell/measured")).json()["versions"] == []


async def test_points_that_tell_nothing_are_refused_in_a_line(web: Web) -> None:
    for asked, words in (
        ({"kind": "pivot", "axis": "C", "points": points((0.0, 100.0))}, "three or more"),
        ({"kind": "pivot", "axis": "X", "points": points((0.0, 100.0))}, "no rotary axis"),
        ({"kind": "plane", "points": [{"joints": {"X": 1.0}, "tool": 1}]}, "this machine has"),
        ({"kind": "tool", "tool": 77, "points": []}, "no tool T77"),
    ):
        answer = await web.operator.post("/api/v1/cell/touch_off/fit", json=asked)
        assert answer.status_code == 422 and words in answer.text


async def test_the_tool_table_is_the_cell_files_and_refuses_what_is_out_of_bounds(web: Web) -> None:
    rows = (await web.viewer.get("/api/v1/cell/tools")).json()
    assert [row["number"] for row in rows] == [tool.number for tool in load_cell("trunnion_tcp").tools]
    assert rows[1]["length_mm"] == 140.0 and not rows[1]["measured"]
    wrong = {"length_mm": 150.0, "diameter_mm": 8.0, "because": "measured"}
    answer = await web.operator.put("/api/v1/cell/tools/2", json=wrong)
    assert answer.status_code == 422 and "at most 5 mm" in answer.json()["detail"]
