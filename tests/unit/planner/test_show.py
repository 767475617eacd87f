"""A plan for people: text, JSON, picture and page."""

from __future__ import annotations

import io
import json
import re

import matplotlib.image
import numpy as np
import pytest

from planner import show
from planner.pipeline import plan
from planner.plan import Plan
from planner.recipe import Recipe
from planner.show.strokes import layer_strokes
from tests.unit.planner.small_parts import tube


@pytest.fixture(scope="module")
def made() -> Plan:
    return plan(tube(8.0, 14.0, 2.4), Recipe(layer_height_mm=0.8), part_name="<ring>")


def test_text_has_a_line_for_every_layer_and_the_size(made: Plan) -> None:
    lines = show.text(made).splitlines()
    assert "28.00 x 28.00 x 2.40 mm" in lines[0]
    assert len([line for line in lines if re.match(r"\s*\d+ +\d+\.\d{3}", line)]) == 3


def test_json_holds_the_lengths_of_all_operations(made: Plan) -> None:
    figures = json.loads(show.as_json(made))
    first = figures["layers"][0]["operations"][0]
    work = sum(step.tip.length for step in made.operations[0].passes if not step.is_link)
    assert first["length_mm"] == pytest.approx(work, abs=1e-3)
    assert figures["volumes_mm3"]["part"] == pytest.approx(made.volumes_mm3["part"], abs=1e-3)


def test_strokes_cover_every_pass_end_to_end(made: Plan) -> None:
    for layer in made.layers:
        length = sum(float(np.linalg.norm(np.diff(s.points, axis=0), axis=1).sum()) for s in layer_strokes(layer))
        assert length == pytest.approx(sum(s.tip.length for op in layer.operations for s in op.passes), rel=2e-3)


def test_picture_is_a_png_with_coloured_paths_and_the_same_every_time(made: Plan) -> None:
    data = show.png(made, layers=[0, 2])
    image = matplotlib.image.imread(io.BytesIO(data), format="png")[..., :3]
    spread = image.max(axis=2) - image.min(axis=2)
    assert (spread > 0.4).mean() > 0.005
    assert data == show.png(made, layers=[0, 2])
    with pytest.raises(ValueError, match="no layer 9"):
        show.png(made, layers=[9])


def test_page_loads_nothing_escapes_names_and_holds_every_layer(made: Plan) -> None:
    page = show.html(made)
    assert "<ring>" not in page and "&lt;ring&gt;" in page
    assert not re.search(r"(src|href)=|https?://", page)
    data = re.search(r'id="layers">(.*?)</script>', page, re.S)
    assert data is not None and len(json.loads(data.group(1))) == 3


def test_text_and_json_tell_for_every_layer_how_far_its_contours_lie_from_facets_and_surface(made: Plan) -> None:
    figures = json.loads(show.as_json(made))["layers"]
    lines = [line for line in show.text(made).splitlines() if re.match(r"\s*\d+ +\d+\.\d{3}", line)]
    assert "off facets  off surface" in show.text(made)
    for layer, shown, line in zip(made.layers, figures, lines, strict=True):
        facets = max(contour.deviation_mm for contour in layer.contours)
        surface = max(contour.smooth_deviation_mm for contour in layer.contours)
        assert shown["deviation_mm"] == pytest.approx(facets, abs=1e-6)
        assert shown["smooth_deviation_mm"] == pytest.approx(surface, abs=1e-9)
        assert f"{facets:.5f}" in line and f"{surface:.2e}" in line


def test_contours_along_facets_have_no_deviation_from_a_surface() -> None:
    made = plan(tube(8.0, 14.0, 1.6), Recipe(layer_height_mm=0.8, fit="facets"))
    figures = json.loads(show.as_json(made))["layers"]
    assert all(layer["smooth_deviation_mm"] is None for layer in figures)
    assert " - " in show.text(made).splitlines()[-1]
