"""One cell and one browser for a module's tests; a fresh page for each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, Request, expect, sync_playwright

from cellctl.console.build import ConsoleBuildError, build
from tests.console.running_cell import RunningCell

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-unsafe-swiftshader",
]
VIEW = {"width": 1280, "height": 800}
PATIENCE_MS = 60_000  # software drawing, worker processes: on a busy machine


@dataclass
class Heard:
    """What a page asked for and complained about."""

    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def request(self, request: Request) -> None:
        self.requests.append(request.url)

    def message(self, message: ConsoleMessage) -> None:
        if message.type == "error" and "401" not in message.text:  # the first question who is signed in
            self.complaints.append(f"{message.text} ({message.location.get('url', '')})")

    def error(self, error: Exception) -> None:
        self.complaints.append(str(error))


@pytest.fixture(scope="module")
def shared_cell() -> Iterator[RunningCell]:
    try:
        build()
    except ConsoleBuildError as error:
        pytest.fail(str(error))
    with RunningCell() as running:
        yield running


@pytest.fixture
def cell(shared_cell: RunningCell) -> RunningCell:
    """The cell, IDLE with nothing latched and no job, whatever the test before did to it or left undone."""
    try:
        shared_cell.make_ready()
    except AssertionError as error:
        pytest.fail(str(error), pytrace=False)
    return shared_cell


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        pytest.skip(f"no browser at {CHROMIUM}; Debian: apt install chromium")
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def heard() -> Heard:
    return Heard()


@pytest.fixture
def page(cell: RunningCell, browser: Browser, heard: Heard) -> Iterator[Page]:
    """The console as it opens, nobody signed in."""
    context = browser.new_context(viewport={"width": VIEW["width"], "height": VIEW["height"]}, base_url=cell.url)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.on("request", heard.request)
    page.on("console", heard.message)
    page.on("pageerror", heard.error)
    page.goto("/")
    yield page
    context.close()
