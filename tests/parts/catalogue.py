"""All parts by name: how each is made, with which recipe, and its exact volume where one can be written down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, pi, radians, sin, tan
from typing import Any

from manifold3d import Manifold

from planner.mesh.mesh import Mesh
from planner.recipe import Recipe
from tests.parts import shells, straight
from tests.parts.solids import mesh_from

SEGMENTS = 64
"""Of a full circle, where none are asked for: about 0.02 mm off a radius of 20 mm."""

HYBRID: dict[str, Any] = {
    "material": "316L",
    "process": "hybrid",
    "tolerance_mm": 0.2,
    "cusp_mm": 0.08,
    "layer_height_mm": 0.8,
    "small_cutter_diameter_mm": 4.0,
}
SIDEWAYS: dict[str, Any] = {**HYBRID, "turn_deg": 45.0}
"""What grows or is bored sideways does so between the clamps, which hold the plate at the middles of its edges."""
DEPOSIT: dict[str, Any] = {
    "material": "316L",
    "process": "deposit",
    "tolerance_mm": 0.4,
    "cusp_mm": 0.1,
    "layer_height_mm": 0.7,
    "build_direction": (0.0, 0.0, 1.0),
    "support": "never",
}
"""Shells stand as they are modelled and may not be propped up: what holds is the tilted head alone."""


@dataclass(frozen=True)
class Sample:
    """One part.

    solid : the part with so many segments to a full circle, mm
    volume_mm3 : of the smooth shape, in closed form; None where there is none
    shows : what the part is made to show, one line
    """

    name: str
    solid: Callable[[int], Manifold]
    recipe_fields: dict[str, Any] = field(default_factory=dict)
    volume_mm3: float | None = None
    shows: str = ""

    def mesh(self, segments: int = SEGMENTS) -> Mesh:
        """The closed surface, mm, with so many segments to a full circle."""
        return mesh_from(self.solid(segments))

    @property
    def recipe(self) -> Recipe:
        """Its recipe."""
        return Recipe(**self.recipe_fields)


def _shell_of_funnel() -> float:
    """Volume between two coaxial bodies of a cylinder and a cone each, mm3: outside 6 mm, inside 3 mm, opening by 50 degrees."""
    lean, wall = radians(50.0), shells.WALL_MM
    height = (25.0 - 6.0) / tan(lean)
    rise, inset = wall * sin(lean), wall * cos(lean)  # of the inner rim against the outer one
    outside = pi * 36.0 * 10.0 + _cone(6.0, 25.0, height)
    rim = _cone(25.0, 25.0 - inset, rise)
    knee = 10.0 + rise - (6.0 - inset - 3.0) / tan(lean)
    inside = pi * 9.0 * knee + _cone(3.0, 25.0 - inset, 10.0 + height + rise - knee)
    return outside + rim - inside


def _cone(low: float, high: float, height: float) -> float:
    """Volume of a cone's frustum, mm3."""
    return pi * height * (low * low + low * high + high * high) / 3.0


_TAU = 2.0 * pi
_ALL = (
    Sample("tee", straight.tee, SIDEWAYS, pi * 25.0 * 80.0 - 8.0 * 125.0 / 3.0, "round bars: stem, then an arm to either side"),
    Sample("cross", straight.cross, SIDEWAYS, 13200.0, "four arms beside a post"),
    Sample("y_branch", straight.y_branch, HYBRID, None, "two arms off a trunk, blended"),
    Sample("l_bracket", straight.l_bracket, SIDEWAYS, 5.0 * 40.0 * 65.0 - 4.0 * 5.0 * pi * 9.0, "plates and bores in two directions"),
    Sample("branched_tube", straight.branched_tube, SIDEWAYS, None, "hollow branches beside a tube"),
    Sample("bladed_hub", straight.bladed_hub, SIDEWAYS, None, "six twisted blades around a hub"),
    Sample("table", straight.table, HYBRID, 44.0 * 44.0 * 5.0 + 4.0 * 36.0 * 25.0, "stands on its legs in the file: built upside down"),
    Sample("two_bodies", straight.two_bodies, HYBRID, 2800.0 + pi * 36.0 * 16.0, "two shells that never touch"),
    Sample("plate_with_boss", straight.plate_with_boss, HYBRID, 3600.0 + pi * 1.69 * 5.0, "a boss of one bead"),
    Sample("mushroom", straight.mushroom, HYBRID, pi * 25.0 * 16.0 + _TAU / 3.0 * 14.0**3, "hangs whichever way it stands"),
    Sample("leaning_wall", shells.leaning_wall, {**DEPOSIT, "axis_layers": "never", "decompose": "never"}, 2700.0, "60 degrees from upright"),
    Sample("bent_pipe", shells.bent_pipe, DEPOSIT, pi * (64.0 - 25.0) * 0.5 * pi * 25.0, "layers turn with its axis"),
    Sample("dome", shells.dome, {**DEPOSIT, "decompose": "never"}, _TAU / 3.0 * (20.0**3 - 17.0**3), "closes over nothing"),
    Sample("funnel", shells.funnel, {**DEPOSIT, "decompose": "never"}, _shell_of_funnel(), "opens by 50 degrees"),
    Sample(
        "spherical_shell",
        shells.spherical_shell,
        {**DEPOSIT, "decompose": "never"},
        2.0 * _TAU / 3.0 * (18.0**3 - 15.0**3) - pi * 1.5**2 * (54.0 - 1.5) / 3.0,
        "opens and closes",
    ),
)
PARTS: dict[str, Sample] = {sample.name: sample for sample in _ALL}
