"""The way of an alarm: seen, acknowledged, looked at on the trends of that moment, reset; then in the history."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect

from tests.console.conftest import Heard
from tests.console.running_cell import RunningCell
from tests.console.test_console import picture, sign_in, state_is

pytestmark = pytest.mark.timeout(600)
REASON = "E-stop released, all clear"


def test_an_alarm_is_acknowledged_looked_at_on_the_trends_of_its_moment_reset_and_found_in_the_history(
    page: Page, cell: RunningCell, heard: Heard
) -> None:
    sign_in(page, cell)
    state_is(page, "IDLE")
    page.get_by_role("tab", name="Alarms").click()
    expect(page.locator(".nothing-latched")).to_be_visible()
    cell.sim("press_estop")
    state_is(page, "FAULT")
    expect(page.locator(".latched-cause")).to_contain_text("emergency stop")
    expect(page.locator(".latched")).to_contain_text("release the E-stop")
    page.get_by_role("button", name="Acknowledge").click()
    expect(page.locator(".seen")).to_contain_text("Seen by operator")
    state_is(page, "FAULT")
    assert cell.get("/cell")["alarms"][0]["acknowledged_by"] == "operator"
    picture(page, "alarm")

    page.locator(".latched").get_by_role("button", name="Trend at that moment").click()
    expect(page.locator(".mark-alarm").first).to_contain_text("emergency stop")
    expect(page.locator("[data-chart]")).to_have_count(9)
    expect(page.locator("[data-chart=jitter] .key b")).not_to_have_text("–")

    cell.sim("release_estop")
    page.get_by_label("Because").fill(REASON)
    page.get_by_role("button", name="RESET").click()
    page.get_by_role("tab", name="Alarms").click()
    expect(page.locator(".nothing-latched")).to_be_visible()
    newest = page.locator(".incident").first
    expect(newest).to_contain_text("emergency stop")
    expect(newest).to_contain_text("Seen by operator")
    expect(newest).to_contain_text(REASON)
    page.locator(".filters select").first.select_option("door")
    expect(page.locator(".incident")).to_have_count(0)
    page.locator(".filters select").first.select_option("estop")
    expect(page.locator(".incident").first).to_contain_text("emergency stop")
    assert not heard.complaints


def test_the_time_of_the_trends_is_moved_by_keys_and_buttons_and_follows_again(page: Page, cell: RunningCell, heard: Heard) -> None:
    sign_in(page, cell)
    page.get_by_role("tab", name="Trends").click()
    shown = page.locator(".shown")
    expect(shown).to_contain_text("Live")
    charts = page.get_by_role("group", name=re.compile("Trends of all channels"))
    charts.focus()
    page.keyboard.press("ArrowLeft")
    expect(shown).to_contain_text("Past")
    page.keyboard.press("End")
    expect(shown).to_contain_text("Live")
    page.get_by_role("button", name="1 h", exact=True).click()
    expect(page.get_by_role("button", name="1 h", exact=True)).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Earlier").click()
    expect(shown).to_contain_text("Past")
    page.locator(".page").evaluate("page => page.scrollTo(0, 0)")  # the bar of times stays on top of what is scrolled
    plot = page.locator("[data-chart=laser] .plot").bounding_box()
    assert plot is not None
    expect(shown).not_to_contain_text("loading")
    before = shown.inner_text()
    page.mouse.move(plot["x"] + 200, plot["y"] + 50)
    page.mouse.down()
    page.mouse.move(plot["x"] + 400, plot["y"] + 50, steps=4)
    page.mouse.up()
    expect(shown).not_to_have_text(before)
    page.get_by_role("button", name="2 min", exact=True).click()
    expect(shown).to_contain_text("Live")
    page.mouse.move(plot["x"] + plot["width"] - 40, plot["y"] + 40)
    expect(page.locator("[data-chart=powder] figcaption time")).to_be_attached()
    assert not heard.complaints
