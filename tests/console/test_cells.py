"""Two cells on one PostgreSQL and one console: what each card says, how the page becomes another cell's, and STOP of the cell that is shown."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from cellctl.console.build import ConsoleBuildError, build
from cellctl.domain.snapshot import Alarm, JobView, Snapshot
from cellctl.store.tokens import Role
from tests.console.conftest import PATIENCE_MS
from tests.console.page_checks import STATE_CAPS_MM, barriers, caps_mm, faults_of_form
from tests.console.test_console import picture
from tests.postgres import Cluster
from tests.unit.cellctl.house_of_two import House, house_of_two, stores_on

pytestmark = pytest.mark.timeout(600)
SIZES = ((1280, 800), (390, 844))
PICTURED = {("dark", 1280): "cells", ("light", 390): "cells_phone"}
JOB = JobView("job-1", "impeller blank", layer=3, layers=40, progress=0.2, remaining_s=5400.0)


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory, postgres: Cluster) -> Iterator[House]:
    try:
        build()
    except ConsoleBuildError as error:
        pytest.fail(str(error))
    folder = tmp_path_factory.mktemp("house")
    with house_of_two(folder, stores_on(postgres.url(postgres.fresh()), folder), beats=True) as found:
        shown = {"mode": "sim", "execution": "READY"}
        found.near.far.shown = Snapshot(1, 0.0, "near", state="IDLE", because="homed", **shown)
        alarm = Alarm(1, 0.0, "feeder", "Powder feeder: hopper almost empty", "Fill the hopper")
        found.far.far.shown = Snapshot(1, 0.0, "far", state="RUNNING", because="started by ada", job=JOB, alarms=[alarm], **shown)
        yield found


@pytest.fixture
def page(house: House, browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport={"width": 1280, "height": 800}, base_url=house.near.url, locale="en", reduced_motion="reduce")
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto("/")
    page.locator("input[type=password]").last.fill(house.tokens[Role.OPERATOR])
    page.locator(".sign-in button[type=submit]").click()
    page.get_by_role("tab", name="Cells").click()
    yield page
    context.close()


def test_cards_say_what_each_cell_does_and_are_read_from_three_metres_in_every_light_and_size(page: Page) -> None:
    far = page.locator('[data-cell="far"]')
    expect(far).to_have_attribute("data-state", "RUNNING")
    expect(far.locator(".cell-state strong")).to_have_text("Running")
    expect(far.locator(".cell-state svg.sign.run")).to_have_count(1)
    expect(far).to_contain_text("impeller blank")
    expect(far).to_contain_text("1:30:00")
    expect(far).to_contain_text("1 alarm")
    expect(page.locator('[data-cell="near"]')).to_contain_text("This page is for this cell")
    expect(page.locator(".cell-here")).to_have_text("near")
    assert caps_mm(page, ".cell-state strong") >= STATE_CAPS_MM
    found: list[str] = []
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        for theme in ("dark", "light"):
            page.evaluate("(theme) => { document.documentElement.dataset.theme = theme }", theme)
            found += [f"{theme} {width}: {one}" for one in (*barriers(page), *faults_of_form(page))]
            if (theme, width) in PICTURED:
                picture(page, PICTURED[theme, width])
    page.get_by_role("button", name="Deutsch").click()
    page.get_by_role("tab", name="Zellen").click()
    expect(far.locator(".cell-state strong")).to_have_text("Läuft")
    found += [f"de: {one}" for one in (*barriers(page), *faults_of_form(page))]
    page.mouse.wheel(0, 300)
    expect(page.locator(".cell-here")).to_be_in_viewport()
    assert not found, "\n".join(found)


def test_choosing_a_cell_makes_the_whole_page_that_cells_and_stop_stops_it_and_no_other(house: House, page: Page) -> None:
    page.keyboard.press("7")
    page.get_by_role("button", name="Open far").focus()
    page.keyboard.press("Enter")
    expect(page).to_have_url(f"{house.near.url}/cells/far/")
    expect(page.locator(".cell-here")).to_have_text("far")
    expect(page.locator(".state-word")).to_have_attribute("data-state", "RUNNING")
    expect(page.locator(".bar")).to_contain_text("impeller blank")
    picture(page, "cell_through_another_host")
    house.near.stops.clear()
    house.far.stops.clear()
    house.far.far.commands.clear()
    page.keyboard.press("F9")
    expect(page.locator("#stop-said")).to_contain_text(re.compile(r"in [\d.]+ ms"))
    house.until(lambda: len(house.far.stops) > 0 and any(one.verb == "stop" for one in house.far.far.commands))
    assert not house.near.stops and not any(one.verb == "stop" for one in house.near.far.commands)
    page.locator(".cell-here").click()
    page.get_by_role("button", name="Open near").click()
    expect(page).to_have_url(f"{house.near.url}/")
    expect(page.locator(".state-word")).to_have_attribute("data-state", "IDLE")


def test_a_cell_not_heard_of_is_shown_as_that_with_how_long_and_a_new_job_may_be_for_any_cell(house: House, page: Page) -> None:
    expect(page.locator('[data-cell="far"]')).to_have_attribute("data-state", "RUNNING")
    page.get_by_role("tab", name="Jobs").click()
    page.get_by_role("button", name="New job").click()
    assert page.locator("select[name=cell] option").all_inner_texts() == ["near (this cell)", "Any that fits", "far"]
    page.get_by_role("button", name="Back").click()
    page.get_by_role("tab", name="Cells").click()
    keeper = house.far.service.fleet
    beat, keeper._beat_once = keeper._beat_once, _nothing  # type: ignore[method-assign]
    try:
        far = page.locator('[data-cell="far"]')
        expect(far.locator(".cell-state strong")).to_have_text("Not heard")
        expect(far.locator(".cell-age")).to_contain_text(re.compile(r"for 1\d s; last: Running"))
        picture(page, "cells_not_heard")
    finally:
        keeper._beat_once = beat  # type: ignore[method-assign]


async def _nothing() -> None:
    """A heart that does not beat."""
