"""An interrupted job on the operator's page: where metal ended, the choice, the generated program to be read, and the part to be confirmed."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from cellctl.store import jobs, open_store
from config import load_cell
from tests.console.conftest import Heard
from tests.console.running_cell import RunningCell
from tests.console.test_console import MARKUP, PLANNED_MS, picture, sign_in
from tests.unit.cellctl.interrupted import bead_of, interrupted_job, wall_in

pytestmark = pytest.mark.timeout(1200)


def test_interrupted_job_shows_where_metal_ended_and_its_generated_program_before_it_is_approved(
    cell: RunningCell, page: Page, heard: Heard, tmp_path: Path
) -> None:
    made = wall_in(tmp_path, load_cell(str(cell.run / "cell.toml")))
    row = made.posted.table[bead_of(made.posted, 1)]
    arc_mm = float(row["arc_start_mm"] + 0.4 * (row["arc_end_mm"] - row["arc_start_mm"]))
    store = open_store(cell.store)
    try:
        first = interrupted_job(store, made, bead_of(made.posted, 1), 0.4, name=f"Wall {MARKUP}")
        sign_in(page, cell)
        page.get_by_role("tab", name="Jobs").click()
        page.get_by_role("button", name="Wall").first.click()
        expect(page.locator(".go-on")).to_contain_text(f"layer 2 of 2, deposit contour, {arc_mm:.2f} mm along its pass")
        expect(page.locator(".go-on")).to_contain_text("by the cell's last tick")
        page.get_by_label("Go on from").select_option("layer")
        expect(page.get_by_label("Layer", exact=True).last).to_have_value("1")
        page.get_by_label("Go on from").select_option("metal_end")
        picture(page, "going_on")
        page.get_by_label("Because").last.fill("power came back")
        page.get_by_role("button", name="Generate the program").click()
        program = page.locator(".program")
        expect(program).to_contain_text("resumes part", timeout=PLANNED_MS)
        expect(program.locator(".remark").first).to_be_visible()
        expect(program.locator(".joint")).to_contain_text("here the original program goes on")
        picture(page, "generated_program")
        expect(page.locator(".job")).to_contain_text("Waits for approval", timeout=PLANNED_MS)
        with store.write() as rows:
            rest = next(job for job in jobs.find_page(rows, None, 5)[0] if job.continues_job == first)
            jobs.change(rows, rest.id, proof={**(rest.proof or {}), "passed": True})  # two bare beads are no wall within its tolerance
        assert rest.resume_point is not None and rest.resume_point["because"] == "power came back"
        page.reload()
        page.get_by_role("tab", name="Jobs").click()
        page.get_by_role("button", name="continued").first.click()
        expect(page.get_by_text("the part stands untouched")).to_be_visible()
        expect(page.get_by_text("the table is clear")).to_have_count(0)
        picture(page, "going_on_approval")
        assert page.title() != "1" and page.locator(".job img[src=x]").count() == 0
        assert not heard.complaints
    finally:
        store.close()

