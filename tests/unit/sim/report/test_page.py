"""The report as a reader, a browser and somebody with bad intentions meet it."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config import load_cell
from sim.findings import Finding
from sim.proof import Proof
from sim.report import html
from tests.unit.sim.report.made_up import CLOSE, GOUGE, LINES, ByHand, proof
from tests.unit.sim.report.reading import Page, read

CELL = load_cell("trunnion_tcp")
HOSTILE = "<script>alert(1)</script>\"'><img src=https://example.com/x onerror=alert(2)>&amp;"


def page_of(made: Proof, program: ByHand | None = None) -> Page:
    return read(html(made, program or ByHand(), CELL))


def squeezed(page: Page) -> str:
    return " ".join(page.text.split())


def test_report_is_well_formed_and_loads_nothing_from_anywhere() -> None:
    made = html(proof((GOUGE, CLOSE)), ByHand(), CELL)
    page = read(made)
    assert made.startswith("<!doctype html>") and page.unbalanced == []
    assert not page.all("script") and not page.all("link") and not page.all("iframe") and not page.all("form")
    assert not re.search(r"https?:|url\(|@import|javascript:|//", re.sub(r"base64,[A-Za-z0-9+/=]*|sha256-[A-Za-z0-9+/=]*", "", made))
    for _, attributes in page.elements:
        assert not [name for name in attributes if name.startswith("on") or name == "style"]
        for name in ("src", "href"):
            assert attributes.get(name, "data:").startswith("data:image/png;base64,") or name not in attributes


def test_page_carries_a_policy_that_allows_its_own_style_and_pictures_and_nothing_else() -> None:
    import base64
    import hashlib

    made = html(proof(), ByHand(), CELL)
    (policy,) = [meta["content"] for meta in read(made).all("meta") if meta.get("http-equiv") == "Content-Security-Policy"]
    style = re.search("<style>(.*)</style>", made, re.DOTALL)
    assert style is not None
    digest = base64.b64encode(hashlib.sha256(style.group(1).encode()).digest()).decode()
    assert policy.startswith("default-src 'none'; img-src data:; ") and f"style-src 'sha256-{digest}'" in policy and "script" not in policy


def test_equal_proofs_give_equal_bytes_with_no_clock_and_no_chance() -> None:
    first, second = (html(proof((GOUGE, CLOSE)), ByHand(), CELL) for _ in range(2))
    assert first == second
    assert "matplotlib" not in first.lower() and "Software" not in first


def test_what_a_part_a_program_and_a_finding_are_called_never_becomes_markup() -> None:
    found = Finding(HOSTILE, HOSTILE, 3, 0, 0, 1, "error", (0.0, 0.0, 2.0), 0.1, HOSTILE, 3)
    lines = tuple(f"N{index + 1} ({HOSTILE})" for index in range(LINES))
    made = replace(proof((found,)), reasons=(HOSTILE,))
    page = page_of(made, ByHand(part_name=HOSTILE, process=HOSTILE, lines=lines))
    assert not page.all("script") and page.unbalanced == []
    assert all(image["src"].startswith("data:") for image in page.all("img"))
    assert page.text.count("<script>alert(1)</script>") >= 6


@settings(max_examples=40, deadline=None)
@given(st.text())
def test_any_part_name_is_shown_as_text(name: str) -> None:
    page = page_of(replace(proof(), built=None), ByHand(part_name=name))
    assert page.unbalanced == [] and {element for element, _ in page.elements} <= KNOWN


KNOWN = {
    *("html", "head", "meta", "title", "style", "body", "section", "strong", "p", "h1", "h2", "h3", "div", "dl", "dt", "dd", "span", "b", "br"),
    *("table", "thead", "tbody", "tr", "th", "td", "ul", "li", "pre", "figure", "figcaption", "img", "code"),
    *("svg", "g", "path", "line", "rect", "circle", "text", "image"),
}


def test_figures_of_the_proof_stand_in_the_report() -> None:
    text = squeezed(page_of(proof()))
    for figure in ("ab" * 32, "cd" * 32, "ef" * 32, CELL.sha256):
        assert figure in text, figure
    for figure in ("0.082 mm", "1.2 mm³ = 0.12%", "0.50%", "1234 mm³", "346 mm³", "2.50 mm", "1 h 02 min 03 s", "777"):
        assert figure in text, figure
    assert "PASSED" in text and "NOT PASSED" not in text


def test_verdict_names_every_reason_and_the_broken_bound_in_words() -> None:
    made = replace(proof((GOUGE, CLOSE)), deviation=replace(proof().deviation, p99_mm=0.456))
    page = page_of(made)
    text = squeezed(page)
    assert "NOT PASSED" in text and made.reasons[0] in text
    rows = re.findall(r"<tr>.*?</tr>", html(made, ByHand(), CELL))
    results = {row: re.sub("<[^>]*>", "|", row) for row in rows}
    surface = next(said for said in results.values() if "99 % of it within" in said)
    gouge = next(said for said in results.values() if "Gouge" in said)
    near = next(said for said in results.values() if "Least clearance" in said)
    assert "broken" in surface and "0.456 mm" in surface and "broken" in gouge and "0.310 mm" in gouge and "warning" in near


def test_finding_says_what_where_how_deep_how_often_and_what_would_help_and_shows_its_place_and_line() -> None:
    page = page_of(proof((GOUGE,)))
    text = squeezed(page)
    for said in ("line N25, layer 1, operation 2 (milling), X 1.00 Y 2.00 Z 2.00 mm", "0.31 mm", "7 ×", GOUGE.text, GOUGE.help, "N25G1X24"):
        assert said in text, said
    closeups = [svg for svg in page.all("svg") if svg["class"] == "closeup"]
    assert len(closeups) == 1 and "gouge" in closeups[0]["aria-label"] and len(page.all("image")) == 1


def test_errors_stand_before_warnings() -> None:
    text = squeezed(page_of(proof((CLOSE, GOUGE))))
    assert text.index("1. gouge") < text.index("2. clearance")


def test_clearance_that_was_not_looked_at_more_closely_is_said_to_be_at_least_that() -> None:
    assert "\N{GREATER-THAN OR EQUAL TO} 2.00 mm" in squeezed(page_of(proof(clearance_mm=2.0)))
    assert "\N{GREATER-THAN OR EQUAL TO}" not in squeezed(page_of(proof(clearance_mm=1.99)))


def test_many_findings_keep_the_page_small() -> None:
    many = tuple(replace(GOUGE, operation=index, line=1 + index % LINES) for index in range(300))
    made = html(proof(many), ByHand(), CELL)
    assert len(made) < 3_000_000 and "The first 16 of 300 places are shown" in made and read(made).unbalanced == []


def test_proof_that_ended_at_once_still_has_a_report() -> None:
    refused = Finding("no stock", "the Program mills a given stock", 0, -1, -1)
    empty = type(proof().timeline).empty()
    made = replace(proof((refused,)), lines_executed=0, timeline=empty, built=None, picture=b"", clearance_mm=None, thresholds={})
    page = page_of(made)
    text = squeezed(page)
    assert "whole Program" in text and "0 of 40" in text and "40 lines not run" in text and page.unbalanced == []
    assert "not watched" in text


def test_what_was_not_checked_is_said() -> None:
    unchecked = Finding("unchecked", "the cell states no bodies: collisions were not looked for", 0, -1, -1, severity="warning")
    text = squeezed(page_of(replace(proof((unchecked,)), clearance_mm=None)))
    part = text[text.index("Not checked The verdict") :]
    assert unchecked.text in part and "residual stress" in part and "Approved by" in part
    assert "1 warning to read below" in text


@pytest.mark.parametrize("name", ["316L", "inconel718", "ti6al4v"])
def test_sources_of_the_material_are_named(name: str) -> None:
    from config import load_material

    text = squeezed(page_of(proof(), ByHand(material=name)))
    for source in load_material(name).source.values():
        assert " ".join(source.split()) in text


def test_error_that_the_report_states_is_the_one_that_tests_hold_the_model_to() -> None:
    from sim.report.closing import HEIGHT_ERROR, STATED_ERROR, WIDTH_ERROR
    from tests.unit.sim.test_melt_published import HEIGHT_BOUNDS, WIDTH_BOUNDS

    means, most = zip(*WIDTH_BOUNDS.values(), strict=True)
    assert ((min(means), max(means)), (min(most), max(most))) == WIDTH_ERROR and HEIGHT_ERROR == HEIGHT_BOUNDS
    assert STATED_ERROR in squeezed(page_of(proof()))
