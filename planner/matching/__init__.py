"""Contours of neighbouring sections: which belong together, point to point, and the ruled walls between them."""

from planner.matching.adjacency import Group, Matching, Pair, match_sections
from planner.matching.deviation import WallDeviation, wall_deviation
from planner.matching.dividing import divided_walls, event_heights
from planner.matching.layer import layer_walls, stack_walls
from planner.matching.measured import MeasuredWalls, measured_walls
from planner.matching.walls import LayerWalls, RuledWall

__all__ = [
    "Group",
    "LayerWalls",
    "Matching",
    "MeasuredWalls",
    "Pair",
    "RuledWall",
    "WallDeviation",
    "divided_walls",
    "event_heights",
    "layer_walls",
    "match_sections",
    "measured_walls",
    "stack_walls",
    "wall_deviation",
]
