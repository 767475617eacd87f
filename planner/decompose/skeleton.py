"""A part's centroidal axis as a graph with radii (paper V): where limbs leave, where they join, how thick they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.decompose.fronts import Fronts, fronts, ways_inside
from planner.decompose.occupancy import occupancy
from planner.mesh.mesh import Mesh
from planner.plan import Skeleton

Floats = NDArray[np.float64]


def skeleton(mesh: Mesh, direction: Floats) -> Skeleton:
    """The centroidal axis of a closed part, followed from its lowest sections along a direction; branches where sections split.

    mesh : mm, any frame   direction : (3,) float, unit, same frame
    """
    body = occupancy(mesh, direction)
    height = body.centres @ direction
    graph = fronts(body, ways_inside(body, height < height.min() + body.cube_mm))
    return _as_graph(graph)


def _as_graph(graph: Fronts) -> Skeleton:
    return Skeleton(graph.centre, np.sqrt(graph.area_mm2 / np.pi), graph.edges)
