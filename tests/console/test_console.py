"""The operator's page: the whole way of a job, STOP whatever else fails, and data that is visibly old."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
import trimesh
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from tests.console.conftest import Heard
from tests.console.page_checks import STATE_CAPS_MM, barriers_in_both_lights, caps_mm, faults_of_form
from tests.console.running_cell import RunningCell

pytestmark = pytest.mark.timeout(1200)
KEPT = Path(__file__).resolve().parent / "pictures"  # those that README shows
PICTURES = KEPT if os.environ.get("KEEP_PICTURES") else KEPT.parent / "results"
PICTURE_BYTES_MAX = 120_000
PICTURE_COLOURS = 256
PLANNED_MS = 600_000  # an upload's check; plan, post and proof: by workers that give way to whatever else the machine does
MM_PX = 96 / 25.4
NAME = "Bearing block"
MARKUP = '<img src="x" onerror="document.title=1">'


def sign_in(page: Page, cell: RunningCell) -> None:
    page.get_by_label("Token").fill(cell.token)
    page.get_by_role("button", name="Sign in").click()
    expect(page.locator(".state-word")).not_to_have_attribute("data-state", "")


def state_is(page: Page, *words: str) -> None:
    found = ", ".join(f".state-word[data-state={word}]" for word in words)
    expect(page.locator(found)).to_be_visible()


def picture(page: Page, name: str) -> None:
    PICTURES.mkdir(exist_ok=True)
    path = PICTURES / f"{name}.png"
    page.screenshot(path=path)
    with Image.open(path) as taken:
        taken.convert("RGB").quantize(PICTURE_COLOURS, method=Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    assert path.stat().st_size < PICTURE_BYTES_MAX


def submit(page: Page, part: Path, name: str) -> None:
    page.get_by_role("tab", name="Jobs").click()
    page.get_by_role("button", name="New job").click()
    page.get_by_label("Part file").set_input_files(part)
    page.get_by_label("Name").fill(name)
    page.get_by_label("Tolerance, mm").fill("0.2")
    page.get_by_role("button", name="Submit").click()
    expect(page.locator(".job-heading")).to_have_text(name, timeout=PLANNED_MS)


def approve(page: Page) -> None:
    page.get_by_text("the table is clear").click()
    page.get_by_label("Because").last.fill("looked at the proof")
    page.get_by_role("button", name="Approve").click()


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A block of 16 x 10 x 2 mm on the substrate."""
    mesh = trimesh.creation.box((16.0, 10.0, 2.0))
    mesh.apply_translation((0.0, 0.0, 1.0))
    path = tmp_path / "block.stl"
    mesh.export(path)
    return path


def test_operator_submits_approves_watches_holds_resumes_and_resets_after_the_door_was_opened(
    page: Page, cell: RunningCell, heard: Heard, block: Path
) -> None:
    assert not barriers_in_both_lights(page)  # of the page that asks who it is
    sign_in(page, cell)
    state_is(page, "IDLE")
    submit(page, block, NAME)
    expect(page.locator("[data-state=waiting_for_approval]")).to_be_visible(timeout=PLANNED_MS)
    expect(page.locator(".proof")).to_contain_text("Passed")
    expect(page.locator(".proof img")).to_have_js_property("complete", True)
    picture(page, "approve")

    approve(page)
    page.get_by_role("tab", name="Machine").click()
    expect(page.locator(".laser-on")).to_be_visible()
    expect(page.locator(".executed").first).not_to_have_attribute("width", "0")
    assert caps_mm(page, ".remaining b") >= STATE_CAPS_MM
    assert not faults_of_form(page)
    picture(page, "running")

    page.get_by_role("button", name="HOLD").click()
    state_is(page, "HELD")
    assert not barriers_in_both_lights(page)  # a state that lasts: a busy machine is slower at this than at the job
    assert cell.sim("state")["laser"]["emission_w"] == 0.0
    expect(page.locator(".cause")).to_have_text("held at the console")
    page.get_by_role("button", name="RESUME").click()
    expect(page.locator(".laser-on")).to_be_visible()

    cell.sim("open_door")
    state_is(page, "FAULT")
    alarm = page.get_by_role("alert").filter(has_text="The door is open")
    expect(alarm).to_contain_text("Remedy: close the door, reset")
    expect(page.locator(".conditions").get_by_text("Door open")).to_be_visible()
    assert cell.sim("state")["laser"]["emission_w"] == 0.0
    assert not faults_of_form(page)
    assert not barriers_in_both_lights(page)
    picture(page, "alarm")

    page.get_by_role("button", name="RESET").click()
    expect(page.locator(".notice")).to_contain_text("The door is open")  # refused while it is
    cell.sim("close_door")
    expect(page.locator(".conditions").get_by_text("Door closed")).to_be_visible()
    page.get_by_label("Because").fill("closed the door")
    page.get_by_role("button", name="RESET").click()
    state_is(page, "HELD")
    page.get_by_role("button", name="RESUME").click()
    state_is(page, "RUNNING", "PREPARING")

    page.get_by_role("button", name="ABORT").click()
    page.get_by_role("button", name="Abort the job").click()
    state_is(page, "IDLE")
    page.get_by_role("tab", name="Trends").click()
    expect(page.locator(".log")).to_contain_text("closed the door")
    expect(page.locator(".log")).to_contain_text("aborted at the console")

    own = urlsplit(cell.url).netloc, urlsplit(cell.stop_url).netloc
    assert {urlsplit(url).netloc for url in heard.requests if not url.startswith(("data:", "blob:"))} <= set(own)
    refused = [text for text in heard.complaints if "409" not in text]  # the early reset
    assert not refused


def test_name_with_markup_is_shown_as_text_and_its_job_can_be_cancelled(
    page: Page, cell: RunningCell, block: Path
) -> None:
    sign_in(page, cell)
    submit(page, block, MARKUP)

    expect(page.locator(".view-name")).to_have_text(MARKUP)
    assert page.locator("img[src=x]").count() == 0
    assert page.title() == "Hybrid cell console"

    page.get_by_role("button", name="Cancel job").click()
    expect(page.locator(".job-state[data-state=cancelled]")).to_be_visible()
    page.get_by_role("button", name="All jobs").click()
    expect(page.locator(".job-title").first).to_have_text(MARKUP)


def test_stop_needs_no_sign_in_and_shows_its_round_trip(page: Page, cell: RunningCell) -> None:
    page.locator("#stop-button").click()

    expect(page.locator("#stop-said")).to_contain_text("STOPPED in")
    expect(page.locator("#stop-said")).to_contain_text("ms")
    assert cell.reaches("STOPPED")

    sign_in(page, cell)
    page.get_by_role("button", name="RESET").click()
    state_is(page, "IDLE", "UNHOMED")


def test_stop_works_while_the_web_process_is_frozen(page: Page, cell: RunningCell) -> None:
    sign_in(page, cell)
    cell.freeze("cellctl.api")
    try:
        expect(page.locator(".stale-mark")).to_contain_text("old")
        page.locator("#stop-button").focus()
        page.keyboard.press("Enter")
        expect(page.locator("#stop-said")).to_contain_text("STOPPED in")  # the web process cannot have said so
    finally:
        cell.thaw("cellctl.api")
    state_is(page, "STOPPED")
    expect(page.locator(".stale-mark")).to_have_count(0)
    page.get_by_role("button", name="RESET").click()
    state_is(page, "IDLE", "UNHOMED")


def test_stop_that_nobody_acknowledges_sends_the_operator_to_the_estop(page: Page, cell: RunningCell) -> None:
    sign_in(page, cell)
    for process in ("cellctl.cell", "cellctl.api"):
        cell.freeze(process)
    try:
        page.locator("#stop-button").click()
        expect(page.locator("#stop-said")).to_contain_text("use the E-stop")
    finally:
        for process in ("cellctl.cell", "cellctl.api"):
            cell.thaw(process)
    expect(page.locator("#stop-said")).to_contain_text("STOPPED in")  # it kept trying


def test_page_that_hears_nothing_shows_the_age_of_its_data_and_takes_only_stop(page: Page, cell: RunningCell) -> None:
    sign_in(page, cell)
    expect(page.locator(".machine")).not_to_have_class("machine is-stale")
    cell.freeze("cellctl.cell")
    try:
        expect(page.locator(".stale-mark")).to_contain_text("s old")
        expect(page.locator(".machine.is-stale")).to_be_visible()
        for name in ("HOLD", "RESUME", "ABORT"):
            expect(page.get_by_role("button", name=name)).to_be_disabled()
        expect(page.locator("#stop-button")).to_be_enabled()
        assert not faults_of_form(page)
        assert not barriers_in_both_lights(page)
        picture(page, "stale")
    finally:
        cell.thaw("cellctl.cell")
    expect(page.locator(".stale-mark")).to_have_count(0)


def test_cell_left_stopped_with_an_open_door_and_a_frozen_service_is_ready_for_the_next_test(cell: RunningCell) -> None:
    cell.sim("open_door")
    httpx.post(cell.stop_url, json={"because": "left so"}, trust_env=False, timeout=60.0)
    assert cell.reaches("STOPPED")
    cell.freeze("cellctl.api")
    cell.make_ready()
    left = cell.get("/cell")
    assert (left["state"], left["alarms"], left["io"]["door_closed"]) == ("IDLE", [], True)


def test_machine_controls_are_large_enough_for_a_glove(page: Page, cell: RunningCell) -> None:
    sign_in(page, cell)
    for name in ("HOLD", "RESUME", "ABORT"):
        box = page.get_by_role("button", name=name).bounding_box()
        assert box is not None and min(box["width"], box["height"]) >= 12 * MM_PX
    stop = page.locator("#stop-button").bounding_box()
    assert stop is not None and min(stop["width"], stop["height"]) >= 15 * MM_PX
    fits = "document.documentElement.scrollWidth <= innerWidth && document.documentElement.scrollHeight <= innerHeight"
    assert page.evaluate(fits)


def test_of_two_consoles_one_has_control_the_other_watches_stops_and_takes_it_over_with_a_reason(
    page: Page, cell: RunningCell, browser: Browser
) -> None:
    other = browser.new_context(viewport={"width": 1280, "height": 800}, base_url=cell.url).new_page()
    other.goto("/")
    sign_in(page, cell)
    sign_in(other, cell)
    page.get_by_role("button", name="Take control").click()
    expect(page.locator(".control-bar")).to_contain_text("This console has control")
    expect(other.locator(".control-bar")).to_contain_text("You are watching")
    picture(other, "watching")
    other.locator("#stop-button").click()
    state_is(page, "STOPPED")
    expect(other.get_by_role("button", name="RESET")).to_be_disabled()
    other.get_by_role("button", name="Take control over").click()
    other.locator(".dialog input").fill("the other console is not manned")
    assert not barriers_in_both_lights(other)
    picture(other, "take_over")
    other.locator(".dialog .sure").click()
    expect(other.locator(".control-bar")).to_contain_text("This console has control")
    expect(page.get_by_role("button", name="RESET")).to_be_disabled()
    other.get_by_role("button", name="RESET").click()
    state_is(other, "IDLE")
    other.context.close()
