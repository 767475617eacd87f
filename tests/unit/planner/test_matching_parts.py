"""The walls of the parts in config/parts, layer by layer from below."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import config
from planner.matching import LayerWalls, divided_walls, event_heights, stack_walls, wall_deviation
from planner.matching.contact import first_contact
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.slicing import slice_mesh

PARTS = Path(config.__file__).parent / "parts"
UP = np.array([0.0, 0.0, 1.0])


def layered(mesh: Mesh, thickness_mm: float) -> list[LayerWalls]:
    """Layers of about one thickness, a plane at every event of the surface."""
    events = event_heights(mesh, UP)
    edges = np.concatenate([np.arange(events[0], events[-1], thickness_mm), events])
    edges = np.unique(edges)
    edges = edges[np.concatenate([[True], np.diff(edges) > 1e-3])]
    planes = np.zeros((len(edges), 6))
    planes[:, 2], planes[:, 5] = edges, 1.0
    lower, upper = slice_mesh(mesh, planes[:-1], "above"), slice_mesh(mesh, planes[1:], "below")
    return stack_walls(mesh, list(zip(lower, upper, strict=True)))


@pytest.mark.parametrize("name", ["pipe", "bearing", "double_arc", "hinge"])
def test_between_events_every_contour_of_a_part_has_one_partner_and_walls_stay_apart(name: str):
    mesh = load(PARTS / f"{name}.stl", "mm")
    layers = layered(mesh, 2.0)
    for walls in layers:
        assert not walls.notes
        assert all(group.kind in ("one_to_one", "begin", "end") for group in walls.matching.groups)
        assert first_contact([wall.surface for wall in walls.walls], np.eye(3)[:2]) is None
        assert walls.matching.direct_count + walls.matching.indirect_count == sum(
            group.kind == "one_to_one" for group in walls.matching.groups
        )


def test_thinner_layers_follow_the_bearing_more_closely():
    mesh = load(PARTS / "bearing.stl", "mm")
    tree = FacetTree(mesh)
    worst = [max(wall_deviation(walls, mesh, tree).max_mm for walls in layered(mesh, step)) for step in (2.0, 0.5)]
    assert worst[1] < 0.25 * 0.5 < worst[0]


def test_the_four_cylinders_and_the_bore_of_the_bearing_have_walls_of_their_own():
    mesh = load(PARTS / "bearing.stl", "mm")
    planes = np.array([[0.0, 0.0, 10.0, 0.0, 0.0, 1.0], [0.0, 0.0, 12.0, 0.0, 0.0, 1.0]])
    low, high = slice_mesh(mesh, planes[:1], "above")[0], slice_mesh(mesh, planes[1:], "below")[0]
    walls = divided_walls(mesh, low, high)
    assert len(walls) == 1
    assert sorted(round(float(np.ptp(loop.points[:, 0])), 1) for loop in low.loops)[:4] == [6.0] * 4
    assert len(walls[0].walls) == 5
    assert max(wall.twist_max_rad for wall in walls[0].walls) < 1e-3
    assert wall_deviation(walls[0], mesh).max_mm < 0.02
