"""The Plan: what is to be done to the part, layer by layer, independent of any machine. Data only; `planner.files` writes it.

Frames: everything in a Plan is in the *build frame*: z along the build direction, origin at the centre of the part's bounding box
at its lowest section (z = 0 is the top of the substrate). `build_from_part` says where the STL's own frame went.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from planner.nurbs.curve import Curve

Array = NDArray[np.float64]

PLAN_SCHEMA = 2


class Process(StrEnum):
    """What an operation does to the metal."""

    DEPOSIT_CONTOUR = "deposit_contour"
    DEPOSIT_FILL = "deposit_fill"
    DEPOSIT_OVERHANG = "deposit_overhang"
    MILL_FACE = "mill_face"
    MILL_SIDE = "mill_side"

    @property
    def is_deposit(self) -> bool:
        """Whether metal is added."""
        return self.value.startswith("deposit")


@dataclass(frozen=True)
class Contour:
    """One closed boundary of a layer's section.

    curve : closed NURBS, mm, build frame; outer counter-clockwise seen against the build direction, holes clockwise
    is_hole, parent : nesting; parent is the index of the enclosing contour in the same list, -1 for an outermost one
    deviation_mm : measured maximum distance between the curve and the STL section, both ways
    smooth_deviation_mm : measured maximum distance of the curve, between its nodes too, from the smooth surface that the
        facets stand for (curved PN triangles over them), in the section's plane; of a union of sections an upper bound;
        NaN where the contour follows facets
    """

    curve: Curve
    is_hole: bool
    parent: int
    deviation_mm: float
    smooth_deviation_mm: float = float("nan")


@dataclass(frozen=True)
class Wall:
    """Ruled side surface between a bottom and a top contour (paper Eq. 19): two curves on one parameter.

    twist_rad : largest angle between the surface's normals at both ends of a ruling; 0 for a developable wall
    """

    bottom: Curve
    top: Curve
    twist_rad: float = 0.0


@dataclass(frozen=True)
class Pass:
    """One uninterrupted motion of the tip.

    tip : NURBS, mm, build frame. Deposition: the focus point on the surface that receives the bead. Milling: centre of the cutter's end.
    axis : (3,) float for a constant axis, or a NURBS on the same domain as tip whose points are normalised after evaluation;
           unit vector from the tip into the head
    is_link : motion between passes: no laser; `rapid` says that it touches nothing and goes at rapid speed
    setpoints : (k, 5) float, rows [arc length mm, feed mm/s, laser W, powder g/min, shield gas L/min], each valid from its arc length
                on; first row at 0, increasing. Laser > 0 on the stretch where metal is deposited only.
    """

    tip: Curve
    axis: Array | Curve
    setpoints: Array
    is_link: bool = False
    rapid: bool = False


@dataclass(frozen=True)
class Operation:
    """Passes in order with one tool."""

    process: Process
    layer: int
    passes: tuple[Pass, ...]
    cutter_diameter_mm: float = 0.0
    spindle_rpm: float = 0.0
    interpass_s: float = 0.0
    """Least time from the start of the previous layer's first deposition to the start of this operation (0: none)."""
    bead_width_mm: float = 0.0
    bead_height_mm: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Layer:
    """One layer between two planes.

    bottom, top : (6,) float, point and unit normal, mm, build frame
    contours : of the section that the layer is built from (its largest: bottom and top united for leaning walls)
    walls : ruled side surfaces bottom to top
    overlap_mm2, overhang_mm2 : areas of paper Eq. 1
    """

    index: int
    bottom: Array
    top: Array
    contours: tuple[Contour, ...]
    walls: tuple[Wall, ...]
    overlap_mm2: float
    overhang_mm2: float
    operations: tuple[Operation, ...]


@dataclass(frozen=True)
class Plan:
    """A part, planned. Same mesh and recipe give the same Plan, byte for byte when written.

    build_from_part : (4, 4) float, rigid transform from the STL's frame to the build frame
    bounds : (2, 3) float, mm, build frame, of the part
    findings : one line each, what was found or mended in the mesh and decided by the planner
    """

    part_name: str
    mesh_sha256: str
    recipe_toml: str
    material: str
    process: str
    tolerance_mm: float
    build_from_part: Array
    bounds: Array
    layers: tuple[Layer, ...]
    findings: tuple[str, ...] = ()
    schema: int = PLAN_SCHEMA
    volumes_mm3: dict[str, float] = field(default_factory=dict)
    """`part`, `deposited` (nominal) and `milled` (nominal)."""

    @property
    def operations(self) -> list[Operation]:
        """All operations in order."""
        return [operation for layer in self.layers for operation in layer.operations]
