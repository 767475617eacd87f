"""The queue at the console: two jobs are reordered, the table is confirmed, a note and a picture are left, and a job is run again."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import trimesh
from playwright.sync_api import Page, expect

from cellctl.domain.jobs import JobState
from cellctl.store import jobs, open_store, parts, threads
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.parts import Inspection, PartRow
from planner.recipe import Recipe
from tests.console.running_cell import RunningCell
from tests.console.test_console import picture, sign_in

pytestmark = pytest.mark.timeout(600)
PICTURE = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8cfc0000003010100c9fe92ef0000000049454e44ae426082"
)


@pytest.fixture
def queued(cell: RunningCell) -> list[str]:
    """Two queued jobs of one block, as if they had been planned, proved and approved."""
    store = open_store(cell.store)
    data = trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl")
    sha256 = hashlib.sha256(data).hexdigest()
    store.blobs.part(sha256, ".stl").write_bytes(data)
    now = store.clock()
    toml = tomli_w.dumps(Recipe(process="deposit", tolerance_mm=0.2).model_dump(mode="json", exclude_none=True))
    try:
        with store.write() as rows:
            inspection = Inspection("0" * 64, [[-6, -4, -1], [6, 4, 1]], 12, 192.0, [])
            part = PartRow(new_id("part", now), "block", ".stl", "mm", sha256, len(data), now, "me", inspection)
            parts.add(rows, part)
            made = []
            for name in ("Flange", "Bracket"):
                fields: dict[str, Any] = {"state": JobState.WAITING_FOR_APPROVAL, "proof": {"passed": True}}
                row = jobs.add(rows, JobRow(new_id("job", now), name, part.id, cell.get("/cell/facts")["name"], toml, "316L", now, "me", **fields))
                jobs.move(rows, row.id, JobState.QUEUED, at=now, approved_by="eve", by="eve", reason="eve approved it: looks good")
                made.append(row.id)
            threads.set_tags(rows, made[1], ["rush order"])
        return made
    finally:
        store.close()


def names(page: Page) -> list[str]:
    return page.locator(".job-queue .job-title").all_text_contents()


def test_two_jobs_are_reordered_the_table_confirmed_a_note_and_a_file_left_and_a_job_run_again(
    page: Page, cell: RunningCell, queued: list[str], tmp_path: Path
) -> None:
    sign_in(page, cell)
    page.get_by_role("tab", name="Jobs").click()
    page.get_by_role("button", name="Queue", exact=True).click()
    expect(page.locator(".job-queue > li")).to_have_count(2)
    assert names(page) == ["Flange", "Bracket"]
    expect(page.locator(".waits").first).to_contain_text("a person confirms that the table is clear")

    up = page.get_by_role("button", name="Move Bracket up")
    up.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".job-queue .job-title").first).to_have_text("Bracket")
    expect(up).to_be_focused()
    assert [job["id"] for job in cell.get("/queue")["items"]] == queued[::-1]
    picture(page, "job_queue")

    start = page.get_by_role("button", name="Table is clear", exact=True)
    expect(start).to_be_disabled()
    page.get_by_text("I looked: the part is off").click()
    start.click()
    expect(page.locator(".table-panel")).to_contain_text("Found clear by")
    assert cell.get("/cell")["state"] == "IDLE"

    page.locator(".job-queue .job-entry").first.click()
    expect(page.locator(".life")).to_contain_text("eve approved it: looks good")
    page.get_by_label("New note").fill("<b>nozzle</b> changed")
    page.get_by_role("button", name="Add note").click()
    expect(page.locator(".thread")).to_contain_text("<b>nozzle</b> changed")
    image = tmp_path / "melt pool.png"
    image.write_bytes(PICTURE)
    page.get_by_label("Attach a file").set_input_files(image)
    expect(page.locator(".attachments img")).to_have_js_property("complete", True)
    expect(page.get_by_role("link", name="melt pool.png")).to_be_visible()
    page.get_by_role("button", name="Copy with changes").click()
    page.locator(".clone-form").get_by_label("Tolerance, mm").fill("0.3")
    expect(page.locator(".clone-form")).to_contain_text("tolerance_mm: 0.2 → 0.3")
    if os.environ.get("KEEP_PICTURES"):
        picture(page, "job_life")

    page.get_by_role("button", name="Run again").click()
    expect(page.locator(".again")).to_contain_text("Run again from")
    page.get_by_role("button", name="Cancel job").click()
    expect(page.locator(".job > .panel-head [data-state=cancelled]")).to_be_visible()
    page.get_by_role("button", name="All jobs").click()
    page.get_by_role("button", name="All jobs").click()
    page.get_by_label("Search").fill("nozzle")
    expect(page.locator(".job-list .job-title")).to_have_text(["Bracket"])
