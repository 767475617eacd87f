"""The page "By hand": moving axes by pointer and by keys, and what is there to press while nothing may be moved."""

from __future__ import annotations

import time

import pytest
from playwright.sync_api import Page

from tests.console.conftest import Heard
from tests.console.running_cell import RunningCell
from tests.console.test_console import picture, sign_in, state_is

pytestmark = pytest.mark.timeout(600)
SETTLED_S = 20.0


def joint(cell: RunningCell, axis: int) -> float:
    return float(cell.sim("state")["cnc"]["joints"][axis])


def arrives(cell: RunningCell, axis: int, at: float) -> None:
    end = time.monotonic() + SETTLED_S
    while abs(joint(cell, axis) - at) > 2e-3 and time.monotonic() < end:
        time.sleep(0.05)
    assert joint(cell, axis) == pytest.approx(at, abs=2e-3)
    stands(cell)


def stands(cell: RunningCell) -> None:
    end = time.monotonic() + SETTLED_S
    while cell.sim("state")["cnc"]["state"] != "Idle" and time.monotonic() < end:
        time.sleep(0.05)
    assert cell.reaches("IDLE")


def open_hand(page: Page, cell: RunningCell) -> None:
    sign_in(page, cell)
    page.get_by_role("tab", name="By hand").click()
    state_is(page, "IDLE")


def test_axes_move_by_step_and_while_held_and_keys_move_nothing_until_allowed(page: Page, cell: RunningCell, heard: Heard) -> None:
    open_hand(page, cell)
    began = joint(cell, 0)
    page.get_by_role("button", name="Move X +").click()
    arrives(cell, 0, began + 1.0)
    state_is(page, "IDLE")

    page.get_by_role("button", name="Move X +").focus()
    page.keyboard.press("Enter")
    stands(cell)
    assert joint(cell, 0) == pytest.approx(began + 1.0, abs=2e-3)
    page.get_by_role("button", name="allow them").click()
    page.get_by_role("button", name="Move X +").focus()
    page.keyboard.press("Enter")
    arrives(cell, 0, began + 2.0)
    state_is(page, "IDLE")

    page.get_by_role("button", name="hold", exact=True).click()
    page.get_by_role("button", name="Move Y +").hover()
    page.mouse.down()
    state_is(page, "JOGGING")
    picture(page, "hand")
    assert cell.sim("state")["laser"]["emission_w"] == 0.0
    page.mouse.move(640, 10)  # off the button, still pressed
    stands(cell)
    stood = joint(cell, 1)
    assert stood > 0.0
    page.mouse.up()
    stands(cell)
    assert joint(cell, 1) == pytest.approx(stood, abs=1e-3)
    assert not heard.complaints
