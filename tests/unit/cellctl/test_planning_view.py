"""The documents that the console gets of a plan, against the plan that they were made of and the models that REST promises."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from cellctl.api.results import LayerView, PlanOverview
from cellctl.planning.view import OVERVIEW, layer_file, write_layer, write_overview
from planner.plan import Plan
from tests.unit.planner.divided_plan import STEM_LAYERS, STEM_RADIUS, divided_plan


@pytest.fixture(scope="module")
def made() -> Plan:
    return divided_plan()


def test_overview_is_what_rest_promises_and_lists_the_pieces(made: Plan, tmp_path: Path) -> None:
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
    seen = LayerView.model_validate(msgspec.json.decode((tmp_path / layer_file(21)).read_bytes()))
    assert seen.tilt_deg == pytest.approx(26.4) and seen.thickness_mm == pytest.approx(layer.thickness_mm, abs=1e-4)
    origin, normal = np.array(seen.bottom[:3]), np.array(seen.bottom[3:])
    points = np.array(seen.operations[0].passes[0].points).reshape(-1, 3) - origin
    assert np.abs(points @ normal).max() < 2e-3
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(len(points), STEM_RADIUS), abs=0.02)
    outline = np.array(seen.overhang[0]).reshape(-1, 3)
    assert np.array_equal(outline[0], outline[-1]) and np.abs((outline - origin) @ normal).max() < 2e-3
