"""What the 3-D view costs: a plan of five million segments in headless Chromium that draws in software, while it is scrubbed and turned."""

from __future__ import annotations

from playwright.sync_api import sync_playwright

from tests.bench.table import Table
from tests.bench.view_scene import LAYERS, add_job, browse, costs
from tests.console.conftest import CHROMIUM, FLAGS, PATIENCE_MS, VIEW
from tests.console.running_cell import RunningCell
from tests.console.test_console import sign_in


def run() -> list[Table]:
    """Serve the plan, open the console, and look at it at rest, scrubbed and turned."""
    rows: list[tuple[str, float, float, float, float, float, float, float, float]] = []
    with RunningCell() as cell, sync_playwright() as playwright:
        segments = add_job(cell.store)
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": VIEW["width"], "height": VIEW["height"]}, base_url=cell.url)
        page.set_default_timeout(PATIENCE_MS)
        page.goto("/")
        sign_in(page, cell)
        page.wait_for_selector(".stage[data-ready=true]")
        page.wait_for_selector(".scrub-bar")
        page.wait_for_timeout(2000)
        for what in ("scrub", "turn"):
            seen = browse(page, what)
            rows.append(
                (
                    what, seen["calls"], seen["triangles"] / 1000, seen["lines"] / 1000, seen["bytes"] / 1e6, seen["frames_per_s"],
                    seen["own_task_ms"], seen["longest_task_ms"], 100 * seen["long_share"],
                )
            )  # fmt: skip
        before = costs(page)["frames"]
        page.wait_for_timeout(2000)
        still = costs(page)["frames"] - before
        browser.close()
    columns = (
        "while", "draw calls", "1000 triangles", "1000 lines", "MB on the card", "frames/s", "longest own task ms", "longest task ms",
        "% in long tasks",
    )  # fmt: skip
    note = (
        f"{segments} segments in {LAYERS} layers; software rendering (SwiftShader); worst of each run; own: processor time of the page, "
        f"without the rasteriser; frames drawn in 2 s at rest: {still:.0f}"
    )
    return [Table("3-D view: five million segments", columns, rows, note)]
