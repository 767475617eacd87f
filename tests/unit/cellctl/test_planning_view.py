"""What the console gets of a plan, a program and a proof, against the plan that they were made of and the models that REST promises."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import planner
from cellctl.api.drawings import Track
from cellctl.api.results import LayerView, PlanOverview
from cellctl.planning.container import ContainerError, pack, unpack
from cellctl.planning.geometry import FIRST, LINK, layer_document, layer_geometry, points_of
from cellctl.planning.redraw import redraw_plan
from cellctl.planning.surface import decimated, surface_bytes
from cellctl.planning.thinning import keep_within, whole_geometry
from cellctl.planning.track import chunk_file, write_track
from cellctl.planning.view import OVERVIEW, WHOLE, layer_file, write_layer, write_overview
from config import load_cell
from planner import post
from planner.files import write_plan
from planner.mesh import load
from planner.nurbs.curve import Curve
from planner.plan import Layer, Operation, Pass, Plan, Process
from planner.recipe import Recipe
from tests.unit.planner.divided_plan import STEM_LAYERS, STEM_RADIUS, divided_plan


@pytest.fixture(scope="module")
def made() -> Plan:
    return divided_plan()


def test_overview_is_what_rest_promises_and_lists_the_pieces(made: Plan, tmp_path: Path) -> None:
    for number, layer in enumerate(made.layers):
        write_layer(layer, number, tmp_path)
    write_overview(made, tmp_path)
    seen = PlanOverview.model_validate(msgspec.json.decode((tmp_path / OVERVIEW).read_bytes()))
    assert [(part.name, part.parent, part.layers) for part in seen.subcomponents] == [
        (part.name, part.parent, list(part.layers)) for part in made.subcomponents
    ]
    assert seen.setups[1].turn == "90° about Y" and seen.candidates[0].chosen and seen.candidates[1].buildable == 0.62
    assert [layer.subcomponent for layer in seen.layers] == [layer.subcomponent for layer in made.layers]
    assert seen.layers[3].z_top == pytest.approx(3.2) and seen.layers[3].tilt_deg == 0.0


def test_tilted_layer_says_its_planes_and_its_points_lie_in_them(made: Plan, tmp_path: Path) -> None:
    layer = made.layers[STEM_LAYERS + 11]
    write_layer(layer, 21, tmp_path)
    seen = LayerView.model_validate(layer_document((tmp_path / layer_file(21)).read_bytes()))
    assert seen.tilt_deg == pytest.approx(26.4) and seen.thickness_mm == pytest.approx(layer.thickness_mm, abs=1e-4)
    origin, normal = np.array(seen.bottom[:3]), np.array(seen.bottom[3:])
    points = np.array(seen.operations[0].passes[0].points).reshape(-1, 3) - origin
    assert np.abs(points @ normal).max() < 2e-3
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(len(points), STEM_RADIUS), abs=0.02)
    outline = np.array(seen.overhang[0]).reshape(-1, 3)
    assert np.array_equal(outline[0], outline[-1]) and np.abs((outline - origin) @ normal).max() < 2e-3


def de_boor(curve: Curve, u: float) -> NDArray[np.float64]:
    """A point of a NURBS by de Boor's recursion, written down once more here."""
    p, knots = curve.degree, curve.knots
    weights = np.ones(len(curve.control_points)) if curve.weights is None else curve.weights
    rows = np.column_stack([curve.control_points * weights[:, None], weights])
    span = int(np.clip(np.searchsorted(knots, u, side="right") - 1, p, len(rows) - 1))
    local = [rows[span - p + j].copy() for j in range(p + 1)]
    for r in range(1, p + 1):
        for j in range(p, r - 1, -1):
            low, high = knots[span - p + j], knots[span + 1 + j - r]
            share = (u - low) / (high - low)
            local[j] = (1.0 - share) * local[j - 1] + share * local[j]
    return np.asarray(local[p][:3] / local[p][3])


def test_drawn_pass_stays_within_its_tolerance_of_the_plans_own_curve_and_ends_where_it_ends(made: Plan) -> None:
    layer = made.layers[STEM_LAYERS + 11]
    header, arrays = unpack(layer_geometry(layer))
    curve = layer.operations[0].passes[0].tip
    drawn = points_of(header, arrays["position"])[: arrays["passes"][1, 0]]
    on_curve = np.array([de_boor(curve, u) for u in np.linspace(*curve.domain, 1500)])
    a, b = drawn[:-1], drawn[1:]
    along = np.einsum("kij,ij->ki", on_curve[:, None, :] - a[None], b - a) / ((b - a) ** 2).sum(axis=1)
    foot = a[None] + np.clip(along, 0.0, 1.0)[..., None] * (b - a)[None]
    assert np.linalg.norm(foot - on_curve[:, None, :], axis=2).min(axis=1).max() < 0.021
    assert np.abs(drawn[[0, -1]] - on_curve[[0, -1]]).max() < 1e-3
    assert arrays["arc"][len(drawn) - 1] == pytest.approx(np.linalg.norm(np.diff(on_curve, axis=0), axis=1).sum(), rel=1e-4)


def switched_layer() -> Layer:
    """Straight bead of 10 mm that is lit from 2 mm to 7 mm, then a rapid back; the head leans over by 30 degrees."""
    bead = Curve.from_polyline([[0.0, 0.0, 1.0], [10.0, 0.0, 1.0]])
    rows = np.array([[0.0, 12.0, 0.0, 9.0, 15.0], [2.0, 8.0, 900.0, 9.0, 15.0], [7.0, 12.0, 0.0, 9.0, 15.0]])
    lean = np.array([0.0, np.sin(np.pi / 6.0), np.cos(np.pi / 6.0)])
    passes = (Pass(bead, lean, rows), Pass(bead.reversed(), lean, np.array([[0.0, 50.0, 0.0, 9.0, 15.0]]), True, True))
    plane = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0])
    return Layer(0, plane, plane + np.array([0, 0, 1, 0, 0, 0]), (), (), 0.0, 0.0, (Operation(Process.DEPOSIT_FILL, 0, passes, bead_width_mm=2.0),))


def test_every_piece_carries_the_set_points_that_hold_on_it_and_passes_are_marked() -> None:
    header, arrays = unpack(layer_geometry(switched_layer()))
    points, values, flags = points_of(header, arrays["position"]), arrays["values"], arrays["position"][:, 3]
    assert points[:4, 0] == pytest.approx([0.0, 2.0, 7.0, 10.0], abs=1e-3)
    assert values[1:4, :2].tolist() == [[1200, 0], [800, 9000], [1200, 0]]  # 0.01 mm/s, 0.1 W, of the piece that ends there
    assert np.all(values[:, 2] == 3000) and np.all(values[:, 3] == 900)
    assert ((flags & FIRST) != 0).tolist() == [True, False, False, False, True, False]
    assert ((flags & LINK) != 0).tolist() == [False] * 4 + [True] * 2
    assert arrays["passes"][:, 3].tolist() == [0, 3] and arrays["rows"][1].tolist() == [2.0, 8.0, 900.0, 9.0, 15.0]
    seen = layer_document(layer_geometry(switched_layer()))["operations"][0]
    assert [one["link"] for one in seen["passes"]] == [False, True] and seen["passes"][0]["laser_w"] == 900.0


def test_drawing_of_the_whole_has_every_layer_and_keeps_to_its_budget(made: Plan) -> None:
    layers = [layer_geometry(layer) for layer in made.layers]
    header, arrays = unpack(whole_geometry(layers, len(layers), 40.0, budget=4000))
    starts = arrays["layers"]
    assert len(starts) == len(layers) + 1 and np.all(np.diff(starts) > 0) and starts[-1] == len(arrays["position"]) <= 4800
    points = points_of(header, arrays["position"])
    for number in (0, STEM_LAYERS + 11, len(layers) - 1):
        own_header, own = unpack(layers[number])
        exact = points_of(own_header, own["position"])
        kept = points[starts[number] : starts[number + 1]]
        assert np.linalg.norm(kept[:, None] - exact[None], axis=2).min(axis=1).max() < 2e-3


def test_vertices_left_out_lie_within_the_tolerance_of_what_is_kept() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 2000)
    circle = np.column_stack([10.0 * np.cos(turn), 10.0 * np.sin(turn), np.zeros(2000)])
    first = np.zeros(2000, dtype=np.bool_)
    first[[0, 1000]] = True
    kept = circle[keep_within(circle, first, 0.05)]
    middle = 0.5 * (kept[1:] + kept[:-1])
    assert len(kept) < 80 and 10.0 - np.linalg.norm(middle, axis=1).min() < 0.051


def test_track_tells_for_every_line_of_the_program_when_it_ends_and_where_the_tip_is(tmp_path: Path) -> None:
    program = post(planned_wall(tmp_path), load_cell("trunnion_tcp"))
    write_track(program, tmp_path / "track")
    index = Track.model_validate(msgspec.json.decode((tmp_path / "track" / "index.v2.json").read_bytes()))
    assert sum(chunk.lines for chunk in index.chunks) == index.lines == len(program.lines)
    rows = 0
    for number, chunk in enumerate(index.chunks):
        _, arrays = unpack((tmp_path / "track" / chunk_file(number)).read_bytes())
        table = program.table[chunk.first_line : chunk.first_line + chunk.lines]
        assert np.abs(arrays["time"] + chunk.time_start_s - table["time_end_s"]).max() < 1e-3
        assert np.abs(arrays["tip"] - table["tip_end"]).max() < 1e-4 and np.abs(arrays["joints"] - table["joints_end"]).max() < 1e-3
        assert np.array_equal(arrays["operation"], table["operation"]) and np.array_equal(arrays["pass"], table["pass_"])
        rows += chunk.lines
    assert rows == len(program.lines)


def planned_wall(folder: Path) -> Plan:
    """Two beads on each other."""
    trimesh.creation.box((8.0, 2.4, 1.6)).export(folder / "wall.stl")
    return planner.plan(load(folder / "wall.stl", "mm"), Recipe(process="deposit", tolerance_mm=0.5))


def test_view_folder_of_an_earlier_version_is_made_anew_from_the_plan(made: Plan, tmp_path: Path) -> None:
    plan = planned_wall(tmp_path)
    write_plan(plan, tmp_path / "plan.h5")
    old = tmp_path / "old"
    old.mkdir()
    (old / "layer_00000.json").write_text("{}")
    redraw_plan(tmp_path / "plan.h5", old)
    fresh = tmp_path / "fresh"
    fresh.mkdir()
    for number, layer in enumerate(plan.layers):
        write_layer(layer, number, fresh)
    write_overview(plan, fresh)
    assert sorted(path.name for path in old.iterdir()) == sorted(path.name for path in fresh.iterdir())
    assert all((old / path.name).read_bytes() == path.read_bytes() for path in fresh.iterdir())
    assert (old / WHOLE).is_file()


def test_surface_is_thinned_to_its_triangles_keeps_its_place_and_its_worst_deviation() -> None:
    ball = trimesh.creation.icosphere(5, 10.0)
    vertices, facets = np.asarray(ball.vertices), np.asarray(ball.faces, dtype=np.int64)
    off = np.full(len(vertices), 0.02)
    off[int(np.argmax(vertices[:, 2]))] = -0.7
    points, corners, deviation = decimated(vertices, facets, off, 3000)
    assert 500 < len(corners) <= 3000 and deviation.min() == -0.7 and deviation.max() == 0.02
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(len(points), 10.0), abs=0.35)
    header, arrays = unpack(surface_bytes(vertices, facets, off, 0.1))
    assert len(arrays["facets"]) == len(facets) and arrays["deviation"].min() == -700
    assert np.abs(points_of(header, arrays["position"]) - vertices).max() < 1e-3


def test_bytes_that_are_no_drawing_are_refused() -> None:
    good = pack({"kind": "layer"}, {"arc": np.zeros(5, dtype=np.float32)})
    for bad in (b"", b"{}", good[:-4], b"HCV2" + bytes(20)):
        with pytest.raises(ContainerError):
            unpack(bad)
