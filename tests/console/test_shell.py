"""The console as a frame: every page in every language, light and size, by touch, by key and from three metres; STOP over all of it."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, Page, expect

from cellctl.console.build import WEB
from cellctl.domain.reactions import REACTIONS
from tests.console.page_checks import STATE_CAPS_MM, barriers, barriers_in_both_lights, caps_mm, faults_of_form
from tests.console.running_cell import RunningCell
from tests.console.test_console import picture, state_is

pytestmark = pytest.mark.timeout(1200)
PAGES = ("machine", "hand", "jobs", "parts", "alarms", "log")
SIZES = ((1280, 800), (390, 844))
WORDS = WEB / "src" / "words"
BLOCKED_MS = 1500


def open_console(browser: Browser, cell: RunningCell, language: str, size: tuple[int, int] = SIZES[0]) -> Page:
    """A console of its own in this language, signed in."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, base_url=cell.url, locale=language, reduced_motion="reduce")
    page = context.new_page()
    page.goto("/")
    page.locator("input[type=password]").last.fill(cell.token)
    page.locator(".sign-in button[type=submit]").click()
    expect(page.locator(".state-word")).not_to_have_attribute("data-state", "")
    return page


def state_words(language: str) -> list[str]:
    """The words of the cell's states in a language."""
    text = (WORDS / f"{language}.ts").read_text(encoding="utf-8")
    block = re.search(r"\n  states: \{(.*?)\n  \}", text, re.DOTALL)
    assert block
    return re.findall(r'[A-Z]+: "([^"]+)"', block[1])


@pytest.mark.parametrize("language", ["en", "de"])
def test_every_page_is_free_of_barriers_large_enough_for_gloves_and_leaves_stop_free(
    cell: RunningCell, browser: Browser, language: str
) -> None:
    page = open_console(browser, cell, language)
    assert page.locator("html").get_attribute("lang") == language
    found: list[str] = []
    for size in SIZES:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        for name in PAGES:
            page.locator(f"#tab-{name}").click()
            found += [f"{name} {size[0]} {one}" for one in barriers_in_both_lights(page)]
            found += [f"{name} {size[0]}: {one}" for one in faults_of_form(page)]
        for word in state_words(language):
            page.locator(".state-word").evaluate("(one, word) => { one.firstChild.data = word }", word)
            found += [f"{word} {size[0]}: {one}" for one in faults_of_form(page) if "state-word" in one]
        page.locator(".menu-button").click()
        expect(page.locator(".dialog")).to_be_visible()
        found += [f"menu {size[0]}: {one}" for one in (*barriers(page), *faults_of_form(page))]
        page.keyboard.press("Escape")
    page.context.close()
    assert not found, "\n".join(found)


def test_state_and_remaining_time_are_read_from_three_metres_in_both_languages(cell: RunningCell, browser: Browser) -> None:
    page = open_console(browser, cell, "de")
    page.evaluate("document.querySelector('.bar').insertAdjacentHTML('beforeend', '<div class=remaining><b>1:23:45</b></div>')")
    assert caps_mm(page, ".state-word") >= STATE_CAPS_MM
    assert caps_mm(page, ".remaining b") >= STATE_CAPS_MM
    page.set_viewport_size({"width": SIZES[1][0], "height": SIZES[1][1]})
    assert caps_mm(page, ".state-word") >= STATE_CAPS_MM
    for word in state_words("de"):
        page.locator(".state-word").evaluate("(one, word) => { one.firstChild.data = word }", word)
        assert not [one for one in faults_of_form(page) if "state-word" in one or "over STOP" in one], word
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    for word in ("Ohne Referenz", *(word for word in state_words("de") if word not in ("Ohne Referenz", "Referenziert"))):
        page.locator(".state-word").evaluate("(one, word) => { one.firstChild.data = word }", word)
        page.locator(".remaining").evaluate("(one, shown) => { one.style.display = shown ? '' : 'none' }", word != "Ohne Referenz")  # no job, no time
        assert not [one for one in faults_of_form(page) if "state-word" in one or "remaining" in one], word
    page.context.close()


def test_keys_reach_every_page_dialogs_keep_the_focus_and_give_it_back_and_the_language_changes_by_a_button(
    cell: RunningCell, browser: Browser
) -> None:
    page = open_console(browser, cell, "en")
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    for number, name in enumerate(PAGES, 1):
        page.keyboard.press(str(number))
        expect(page.locator(f"#tab-{name}")).to_have_attribute("aria-selected", "true")
    page.locator("#tab-log").focus()
    page.keyboard.press("ArrowDown")
    expect(page.locator("#tab-machine")).to_be_focused()
    page.keyboard.press("?")
    expect(page.locator(".dialog")).to_be_visible()
    for _ in range(14):
        page.keyboard.press("Tab")
        assert page.evaluate("!document.activeElement.closest('.body')")
    page.keyboard.press("Escape")
    expect(page.locator(".dialog")).to_have_count(0)
    expect(page.locator("#tab-machine")).to_be_focused()

    page.get_by_role("button", name="Deutsch").click()
    expect(page.locator("html")).to_have_attribute("lang", "de")
    expect(page.locator(".state-word")).to_have_text("Bereit")
    expect(page.get_by_role("tab", name="Aufträge")).to_be_visible()
    picture(page, "german")
    page.set_viewport_size({"width": SIZES[1][0], "height": SIZES[1][1]})
    picture(page, "phone")
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    page.locator(".menu-button").click()
    page.get_by_role("button", name="dunkel und hell").click()
    page.get_by_role("button", name="Schließen").click()
    picture(page, "light")
    page.context.close()


def test_stop_works_by_its_key_in_a_dialog_and_while_the_page_is_busy_and_its_time_counts_from_the_finger(
    cell: RunningCell, browser: Browser
) -> None:
    page = open_console(browser, cell, "de")
    page.locator(".menu-button").click()
    page.keyboard.press("F9")
    expect(page.locator("#stop-said")).to_contain_text("GESTOPPT in")
    state_is(page, "STOPPED")
    page.keyboard.press("Escape")
    expect(page.locator(".alarm-banner")).to_contain_text("Durch STOP gestoppt")
    page.get_by_role("button", name="QUITTIEREN").click()
    state_is(page, "IDLE", "UNHOMED")

    box = page.locator("#stop-button").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.evaluate("(ms) => void setTimeout(() => { const end = performance.now() + ms; while (performance.now() < end); }, 0)", BLOCKED_MS)
    page.mouse.down()
    expect(page.locator("#stop-said")).to_contain_text("GESTOPPT in")
    shown = re.search(r"in (\d+) ms", page.locator("#stop-said").inner_text())
    assert shown is not None and int(shown[1]) > BLOCKED_MS / 3
    assert cell.reaches("STOPPED")
    page.context.close()


def test_german_has_words_for_every_alarm_of_the_cell() -> None:
    text = (WORDS / "cell.de.ts").read_text(encoding="utf-8")
    known = set(re.findall(r"^    (\w+): \[", text, re.MULTILINE))
    assert set(REACTIONS) <= known
