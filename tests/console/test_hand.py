"""The page "By hand": moving axes by pointer and by keys, and what is there to press while nothing may be moved."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from cellctl.client import Client
from cellctl.console.build import ConsoleBuildError, build
from config.cell import load_cell
from tests.console.conftest import Heard
from tests.console.running_cell import RunningCell
from tests.console.test_console import picture, sign_in, state_is
from tests.unit.cellctl.test_touch_off import touching

pytestmark = pytest.mark.timeout(600)
SETTLED_S = 20.0
NEAR = 2e-3  # mm or deg
MARK = np.array([50.0, 10.0, -440.0])  # table frame: a gauge ball
REAL = (0.31, -0.24, -450.0)  # where the C axis really is; the cell file has it at 0, 0


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[RunningCell]:
    try:
        build()
    except ConsoleBuildError as error:
        pytest.fail(str(error))
    with RunningCell(real_pivots_mm={"C": REAL}) as running:
        yield running


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


def is_there(cell: RunningCell, letter: str, at: float) -> None:
    """Wait until an axis is told to be there and the cell is at rest: the answer to a jog comes before its motion."""
    end = time.monotonic() + SETTLED_S
    while True:
        told = cell.get("/cell")
        if told["state"] == "IDLE" and abs(told["cnc"]["machine"][letter] - at) < NEAR:
            return
        assert time.monotonic() < end, f"{letter} is not at {at}: {told['state']}, {told['cnc']['machine']}"
        time.sleep(0.05)


def send_to(cell: RunningCell, client: Client, goal: dict[str, float]) -> None:
    """Jog every axis there, through REST."""
    for letter, at in goal.items():
        distance = at - cell.get("/cell")["cnc"]["machine"][letter]
        if abs(distance) > 1e-3:
            client.command("jog", "measuring", axis=letter, distance=distance, feed=5000.0)
            is_there(cell, letter, at)


def assert_points_stay_when_the_page_is_loaded_again(page: Page) -> None:
    rows = page.locator(".points tbody tr")
    before = rows.all_inner_texts()
    page.reload()
    page.get_by_role("tab", name="By hand").click()
    page.get_by_role("button", name="Touch-off").click()
    expect(page.locator(".kept")).to_contain_text("before the page was loaded again")
    assert rows.all_inner_texts() == before
    state_is(page, "IDLE")


def test_a_centre_that_is_wrong_is_found_by_the_wizard_and_adopted(page: Page, cell: RunningCell, heard: Heard) -> None:
    facts = load_cell(str(cell.run / "cell.toml"))
    before = cell.get("/cell/measured")
    open_hand(page, cell)
    page.get_by_role("button", name="Touch-off").click()
    page.get_by_label("What touches").select_option("1")
    with Client(cell.url, cell.token) as client:
        for count, angle in enumerate((0.0, 120.0, 240.0), 1):
            client.take_control("measuring")
            send_to(cell, client, touching(facts, MARK, {"C": angle}, tool=1).joints)
            client.release_control()
            page.get_by_role("button", name="Here").click()
            expect(page.locator(".points tbody tr")).to_have_count(count)
            if count == 2:
                assert_points_stay_when_the_page_is_loaded_again(page)
    expect(page.locator(".shift")).to_contain_text("0.310")
    page.get_by_label("Because (kept in the record)").fill("C bearing renewed")
    picture(page, "touch_off")
    page.evaluate("() => { document.documentElement.dataset.theme = 'light' }")
    picture(page, "touch_off_light")
    page.get_by_role("button", name="Adopt").click()
    expect(page.locator(".points")).to_have_count(0)
    after = cell.get("/cell/measured")
    assert after["pivots_mm"]["C"][:2] == pytest.approx(REAL[:2], abs=4e-3)
    assert after["cell_sha256"] != before["cell_sha256"]
    assert after["versions"][0]["because"] == "C bearing renewed" and len(after["versions"][0]["points"]["points"]) == 3

    page.get_by_role("button", name="Tools", exact=True).click()
    page.get_by_role("button", name="Edit T2").click()
    page.get_by_label("Wear, length").fill("0.05")
    page.get_by_label("Because (kept in the record)").fill("worn")
    picture(page, "tools")
    page.get_by_role("button", name="Save").click()
    expect(page.locator(".tool-table .badge")).to_have_count(1)
    assert cell.get("/cell/facts")["tools"][1]["tip_mm"][2] == pytest.approx(-139.95)
    assert not heard.complaints
