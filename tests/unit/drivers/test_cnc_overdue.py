"""When an answer counts as lost on a machine that stands: what the unanswered lines themselves may take, and no more."""

from __future__ import annotations

import pytest

from drivers.cnc.events import AnswerOverdue
from tests.unit.drivers.fakes import FakeCnc, far_end
from tests.unit.drivers.test_cnc_driver import of, run

STEP_S = 0.02


class Standing(FakeCnc):
    """A machine that answers nothing from some line on, and stands meanwhile. rpm : tells the spindle's speed"""

    def __init__(self, deaf_from: str) -> None:
        super().__init__(planner=2)
        self.deaf_from = deaf_from
        self.rpm = 0.0

    def _line(self, line: str) -> None:
        if self.deaf_from in line:
            self.commands.append(line)
        else:
            super()._line(line)

    def report(self, full: bool = False) -> str:
        return super().report(full).replace("|FS:600,0", f"|FS:0,{self.rpm:.0f}")


LINES = ["N1 M6 T2", "N2 M3 S6000"]


async def overdue_of(cnc: FakeCnc, lines: list[str], seconds: float) -> list[AnswerOverdue]:
    """What is told as overdue within so long after the lines went."""
    driver, _, _, clock = far_end(cnc, answer_timeout_s=2.0, tool_change_s=30.0, spindle_s=1.0)
    await driver.identify()
    driver.load(lines)
    driver.release(len(lines))
    return [event for event in of(run(driver, clock, seconds, STEP_S), AnswerOverdue) if isinstance(event, AnswerOverdue)]


async def test_a_lost_ok_of_a_spindle_start_behind_a_tool_change_is_told_after_the_spindles_own_time() -> None:
    assert await overdue_of(Standing("M3"), LINES, 2.5) == []
    assert [event.n for event in await overdue_of(Standing("M3"), LINES, 4.0)] == [2]


async def test_a_tool_change_has_the_time_of_the_cell_file_where_no_state_tells_of_it() -> None:
    assert await overdue_of(Standing("M6"), LINES[:1], 25.0) == []
    assert [event.n for event in await overdue_of(Standing("M6"), LINES[:1], 40.0)] == [1]


async def test_a_control_that_reports_its_tool_changes_is_not_waited_for_once_it_is_idle_again() -> None:
    cnc = Standing("M6")
    driver, _, _, clock = far_end(cnc, answer_timeout_s=2.0, tool_change_s=30.0, spindle_s=1.0)
    await driver.identify()
    driver.load(LINES[:1])
    driver.release(1)
    run(driver, clock, 0.1, STEP_S)
    cnc.state = "Tool"
    assert not of(run(driver, clock, 60.0, STEP_S), AnswerOverdue)
    cnc.state = "Idle"
    assert not of(run(driver, clock, 1.5, STEP_S), AnswerOverdue)
    assert of(run(driver, clock, 2.0, STEP_S), AnswerOverdue)


async def test_a_spindle_that_is_seen_to_turn_up_may_take_longer_than_the_cell_file_says() -> None:
    cnc = Standing("M3")
    driver, _, _, clock = far_end(cnc, answer_timeout_s=2.0, tool_change_s=30.0, spindle_s=0.0)
    await driver.identify()
    driver.load(LINES)
    driver.release(2)
    for _ in range(40):
        cnc.rpm += 150.0
        assert not of(run(driver, clock, 0.25, STEP_S), AnswerOverdue)
    assert of(run(driver, clock, 3.0, STEP_S), AnswerOverdue)


@pytest.mark.parametrize("dwell_s", [5.0, 20.0])
async def test_a_dwell_has_its_own_time(dwell_s: float) -> None:
    assert await overdue_of(Standing("G4"), [f"N1 G4 P{dwell_s:g}"], dwell_s + 1.5) == []
    assert await overdue_of(Standing("G4"), [f"N1 G4 P{dwell_s:g}"], dwell_s + 3.0) != []
