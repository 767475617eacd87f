"""A plan for people: text, JSON, picture and page."""

from __future__ import annotations

import base64
import io
import json
import re
import time

import matplotlib.image
import numpy as np
import pytest

from planner import show
from planner.pipeline import plan
from planner.plan import Plan
from planner.recipe import Recipe
from planner.show.depth import DepthImage
from planner.show.page_space import space_data
from planner.show.places import flat
from planner.show.solid import solid_of
from planner.show.space import piece_colour
from planner.show.strokes import layer_strokes
from tests.unit.planner.divided_plan import BEND_LAYERS, SHIFT_MM, STEM_LAYERS, STEM_RADIUS, divided_plan
from tests.unit.planner.hand_plan import contour_operation, plan_of
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


@pytest.fixture(scope="module")
def divided() -> Plan:
    return divided_plan()


def test_text_says_what_stands_on_what_how_it_is_turned_and_what_was_weighed(divided: Plan) -> None:
    lines = show.text(divided).splitlines()
    row = next(line for line in lines if re.match(r"3 +1 +2 +35 to 42", line))
    assert "12.5" in row and row.endswith("-x")
    assert "set-up 2: 90° about Y, -x up; pieces 3" in lines
    assert any(line.strip() == "its axis turns by 60°" for line in lines)
    chosen = next(line for line in lines if "chosen:" in line)
    weighed = next(line for line in lines if "weighed:" in line)
    assert "100.0 %" in chosen and "three pieces along the skeleton" in chosen
    assert "62.0 %" in weighed and "310.0" in weighed


def test_overhang_is_drawn_layer_by_layer_in_text(divided: Plan) -> None:
    bars = re.search(r"overhang by layer, up to ([0-9.]+) mm².*\|(.*)\|", show.text(divided))
    assert bars is not None and float(bars.group(1)) == pytest.approx(max(k.overhang_mm2 for k in divided.layers), abs=0.05)
    assert [char != " " for char in bars.group(2)] == [layer.overhang_mm2 > 0.0 for layer in divided.layers]


def test_layers_that_turn_are_told_by_tilt_and_thickness_and_level_ones_by_their_heights(divided: Plan) -> None:
    lines = show.text(divided).splitlines()
    tilted = [line for line in lines if re.match(r" +\d+ +\d+\.\d° +0\.586 … 1\.089 ", line)]
    assert len(tilted) == BEND_LAYERS
    assert len([line for line in lines if re.match(r" +\d +\d\.\d00 +\d\.\d00 +0\.800 ", line)]) == STEM_LAYERS


def test_json_holds_pieces_setups_candidates_skeleton_and_planes(divided: Plan) -> None:
    figures = json.loads(show.as_json(divided))
    assert [part["name"] for part in figures["subcomponents"]] == ["1", "2", "3"]
    assert figures["subcomponents"][2]["support_mm3"] == 12.5
    assert figures["setups"][1]["turn"] == "90° about Y"
    assert [item["chosen"] for item in figures["candidates"]] == [True, False]
    assert len(figures["skeleton"]["edges"]) == 4
    layer = figures["layers"][STEM_LAYERS + 10]
    assert layer["tilt_deg"] == pytest.approx(24.0, abs=1e-3) and layer["subcomponent"] == 1
    assert np.linalg.norm(layer["bottom"][3:]) == pytest.approx(1.0, abs=1e-5)
    total = sum(item["overhang_mm2"] for item in figures["layers"])
    assert total == pytest.approx(sum(item.overhang_mm2 for item in divided.layers), abs=0.01)


def test_layer_that_is_tilted_is_drawn_true_to_size_in_its_own_plane(divided: Plan) -> None:
    for layer in (divided.layers[0], divided.layers[STEM_LAYERS + 20], divided.layers[-1]):
        curve = layer.contours[0].curve
        radius = np.linalg.norm(flat(layer, curve.evaluate(curve.sample(0.01))), axis=1)
        assert radius == pytest.approx(np.full(len(radius), 3.0 if layer is divided.layers[-1] else STEM_RADIUS), abs=1e-2)


def test_facets_of_the_plan_enclose_its_pieces() -> None:
    """The volume by the divergence theorem, of the level pieces: circles times heights."""
    plan_ = divided_plan()
    solid = solid_of(plan_, chord=1e-4)
    for piece, volume in ((0, np.pi * 36.0 * 8.0), (2, np.pi * 9.0 * 6.4)):
        first, past = (solid.first[k] for k in plan_.subcomponents[piece].layers)
        corners, normals = solid.corners[first:past], solid.normals[first:past]
        halves = [np.cross(corners[:, k] - corners[:, 0], corners[:, k + 1] - corners[:, 0]) for k in (1, 2)]
        areas = 0.5 * sum(np.linalg.norm(half, axis=1) for half in halves)
        found = (np.einsum("ij,ij->i", corners.mean(axis=1) - [0.0, 0.0, 4.0], normals) * areas).sum() / 3.0
        assert found == pytest.approx(volume, rel=2e-3)


def test_nearer_facet_hides_the_farther_one_whichever_is_drawn_first() -> None:
    square = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]])
    both = np.concatenate([square, square * [0.5, 1.0, 1.0] + [0.0, 0.0, 1.0]])
    colours = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    pictures = []
    for order in ([0, 1], [1, 0]):
        image = DepthImage(40, 40, np.array([0.0, 0.0]), np.array([1.0, 1.0]))
        image.facets(both[order], colours[order])
        pictures.append(image.image)
    assert np.array_equal(pictures[0], pictures[1])
    assert (pictures[0][:, :20] == [0, 0, 255]).all() and (pictures[0][:, 20:] == [255, 0, 0]).all()


def test_picture_of_a_divided_plan_shows_every_piece_in_its_colour(divided: Plan) -> None:
    data = show.png(divided, layers=[STEM_LAYERS + 1])
    image = matplotlib.image.imread(io.BytesIO(data), format="png")[..., :3].reshape(-1, 3)
    for number in range(3):
        colour = np.array([int(piece_colour(number)[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
        assert (np.abs(image - colour).max(axis=1) < 0.02).sum() > 200


def test_page_packs_all_facets_and_gives_tilted_layers_a_window_of_their_own(divided: Plan) -> None:
    page = show.html(divided)
    assert not re.search(r"(src|href)=|https?://", page)
    data = space_data(divided)
    solid = solid_of(divided, 150, 0.004)
    rows = np.frombuffer(base64.b64decode(data["facets"]), dtype=np.uint8).reshape(-1, 28)
    assert len(rows) == data["first"][-1] == len(solid.corners)
    corners = rows[:, :24].copy().view("<u2").reshape(-1, 4, 3) / 65535.0 * data["size"] + data["low"]
    assert np.abs(corners - solid.corners).max() < 1e-3
    found = re.search(r'id="layers">(.*?)</script>', page, re.S)
    assert found is not None
    layers = json.loads(found.group(1))
    assert ["box" in layer for layer in layers] == [False] * STEM_LAYERS + [True] * (len(layers) - STEM_LAYERS)
    hang = next(path for kind, path in layers[STEM_LAYERS + 1]["paths"] if kind == "hang")
    x = np.array(re.findall(r"(-?[0-9.]+) -?[0-9.]+", hang), dtype=float)
    assert x.min() == pytest.approx(-STEM_RADIUS, abs=0.01) and x.max() <= SHIFT_MM


def test_a_thousand_layers_are_told_in_under_a_second() -> None:
    long = plan_of(*([contour_operation(k)] for k in range(1000)))
    started = time.process_time()
    lines = show.text(long).count("\n")
    assert lines > 1000 and time.process_time() - started < 1.0
