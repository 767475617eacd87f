"""The engineer's way in a browser: a file dropped, its units asked, the estimate that moves with the recipe, plan, proof, approval, comparing."""

from __future__ import annotations

import base64
import re

import pytest
import trimesh
from playwright.sync_api import Page, expect

from tests.console.conftest import Heard
from tests.console.running_cell import RunningCell
from tests.console.test_console import PLANNED_MS, picture, sign_in

pytestmark = pytest.mark.timeout(1200)
DROP = """([selector, name, data]) => {
    const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const carried = new DataTransfer();
    carried.items.add(new File([bytes], name));
    for (const type of ["dragenter", "dragover", "drop"])
        document.querySelector(selector).dispatchEvent(new DragEvent(type, { dataTransfer: carried, bubbles: true, cancelable: true }));
}"""


def block_with_a_hole_in_its_skin() -> bytes:
    """A block of 16 x 10 x 2 mm, one small facet of its top missing."""
    mesh = trimesh.creation.box((16.0, 10.0, 2.0)).subdivide().subdivide()
    mesh.apply_translation((0.0, 0.0, 1.0))
    top = int(mesh.face_normals[:, 2].argmax())
    mesh.update_faces([number != top for number in range(len(mesh.faces))])
    return bytes(mesh.export(file_type="stl"))


def drop(page: Page, name: str, data: bytes) -> None:
    page.evaluate(DROP, [".drop", name, base64.b64encode(data).decode()])


def figure(page: Page, name: str) -> str:
    expect(page.locator(".estimate")).to_have_attribute("aria-busy", "false", timeout=PLANNED_MS)
    return str(page.locator(f"[data-figure={name}] b").inner_text())


def planned(page: Page) -> None:
    expect(page.locator(".plan-head [data-state=waiting_for_approval]")).to_be_visible(timeout=PLANNED_MS)
    expect(page.locator(".bounds")).to_be_visible()


def upload(page: Page) -> None:
    """Drop a file, say its units, send it and open the part."""
    drop(page, "Bearing block.stl", block_with_a_hole_in_its_skin())
    entry = page.locator(".file")
    expect(entry.get_by_role("button", name="Upload")).to_be_disabled()  # the units are never guessed
    expect(entry.locator(".unit-size").first).to_have_text("16.0 × 10.0 × 2.00 mm (0.63 × 0.39 × 0.08 in)")
    expect(entry.locator(".unit-size").last).to_contain_text("406.4 × 254.0 × 50.8 mm")
    entry.get_by_label("mm", exact=False).first.check()
    entry.get_by_role("button", name="Upload").click()
    expect(entry).to_contain_text("Uploaded and checked", timeout=PLANNED_MS)
    expect(entry.locator(".found")).to_contain_text("mended")
    expect(page.locator(".card img").first).to_have_js_property("naturalWidth", 240)
    entry.get_by_role("button", name="Open part").click()


def test_engineer_drops_a_part_previews_submits_reads_approves_and_compares(page: Page, cell: RunningCell, heard: Heard) -> None:
    sign_in(page, cell)
    page.get_by_role("tab", name="Parts").click()
    upload(page)
    page.get_by_role("button", name="Show").first.click()
    expect(page.get_by_role("button", name="Show").first).to_have_attribute("aria-pressed", "true")
    expect(page.locator(".missing")).to_contain_text("rates.machine_per_h")  # no cost is invented
    layers = figure(page, "layers")
    time = figure(page, "time")
    page.get_by_label("Layer height, mm").fill("0.5")
    expect(page.locator("[data-figure=layers] b")).not_to_have_text(layers)
    assert figure(page, "layers") == "4" and figure(page, "time") != time
    expect(page.locator("[data-figure=layers] .moved")).to_contain_text("+")
    page.get_by_label("Layer height, mm").fill("7")
    expect(page.locator(".recipe")).to_contain_text("Layer height: 7 mm asked, at most 1 mm")
    expect(page.get_by_role("button", name="Submit")).to_be_disabled()
    page.get_by_label("Layer height, mm").fill("")
    page.get_by_label("Tolerance in mm as a number").fill("0.2")
    assert figure(page, "layers") == layers
    picture(page, "part")

    page.get_by_role("button", name="Submit").click()
    planned(page)
    picture(page, "plan")
    expect(page.locator(".histogram")).to_contain_text("of the surface lies within")
    first = page.url
    page.get_by_text("the table is clear").scroll_into_view_if_needed()
    page.locator(".approve").get_by_label("Because").fill("looked at the proof")
    page.locator(".approve").get_by_role("button", name="Approve").click()
    expect(page.locator(".plan-head [data-state=queued]")).to_be_visible()  # nobody said that the table is clear

    page.get_by_role("button", name="‹ Part").click()
    page.get_by_label("Name of the job").fill("Finer layers")
    page.get_by_label("Layer height, mm").fill("0.5")
    figure(page, "layers")
    page.get_by_role("button", name="Submit").click()
    planned(page)
    page.get_by_label("Compare with …").select_option(index=1)
    table = page.locator(".compare-table")
    expect(table).to_contain_text("Layer height, mm")
    expect(table.get_by_role("row", name=re.compile("^Layers"))).to_contain_text("less")
    expect(page.locator(".layers-chart path")).to_have_count(4)
    picture(page, "compare")

    sent = page.url
    page.goto(first)
    page.goto(sent)  # a link that somebody sent
    page.reload()
    expect(page.locator(".compare-table")).to_contain_text("Layer height, mm")
    assert not heard.complaints
