"""Layers are handed out while the rest is planned; the recipe's rule for layers reaches the plan."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from planner.mesh import Mesh
from planner.pipeline import plan
from planner.plan import Layer
from planner.recipe import Recipe


def frustum() -> Mesh:
    body = trimesh.creation.cylinder(12.0, 8.0, sections=64)
    vertices = np.asarray(body.vertices).copy()
    vertices[:, :2] *= 1.0 - 0.02 * (vertices[:, 2:] + 4.0)
    return Mesh(vertices, np.asarray(body.faces))


@pytest.mark.parametrize("process", ["hybrid", "deposit", "mill"])
def test_every_layer_is_handed_out_once_and_as_it_stands_in_the_plan(process: str) -> None:
    recipe = Recipe.model_validate({"process": process, "layer_height_mm": 0.8, "stock_allowance_mm": 1.0})
    handed: list[tuple[Layer, float]] = []
    share = [0.0]

    def told(stage: str, done: float) -> None:
        share[0] = done

    made = plan(frustum(), recipe, progress=told, on_layer=lambda layer: handed.append((layer, share[0])))
    assert [layer for layer, _ in handed] == list(made.layers)
    assert handed[0][1] < 0.3  # the first long before the rest is done


def test_a_ruled_recipe_takes_fewer_layers_than_an_extruded_one_and_tells_where_the_bounds_hold() -> None:
    ball = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=6.0))
    ruled, extruded = (
        plan(ball, Recipe.model_validate({"process": "deposit", "layer_rule": rule, "cusp_mm": 0.3}))
        for rule in ("ruled", "extruded")
    )
    assert len(ruled.layers) < len(extruded.layers)
    assert any("cannot be thin enough for the cusp of 0.3 mm" in line for line in extruded.findings)
