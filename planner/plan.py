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

PLAN_SCHEMA = 3


class Process(StrEnum):
    """What an operation does to the metal."""

    DEPOSIT_CONTOUR = "deposit_contour"
    DEPOSIT_FILL = "deposit_fill"
    DEPOSIT_OVERHANG = "deposit_overhang"
    MILL_FACE = "mill_face"
    MILL_SIDE = "mill_side"
    MILL_SCALLOP = "mill_scallop"

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
    subcomponent : number in `Plan.subcomponents`
    overhang : closed outlines of what rests on nothing, in the bottom plane, mm, build frame; holes run clockwise
    thickness_mm : (2,) least and greatest distance of the two planes over the layer
    """

    index: int
    bottom: Array
    top: Array
    contours: tuple[Contour, ...]
    walls: tuple[Wall, ...]
    overlap_mm2: float
    overhang_mm2: float
    operations: tuple[Operation, ...]
    subcomponent: int = 0
    overhang: tuple[Array, ...] = ()
    thickness_mm: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Subcomponent:
    """A piece of the part that is built in one go on what is there before it (paper V, Fig. 18).

    name : "1", "2" … in the order of building   parent : index of the subcomponent that it stands on, -1: the substrate
    setup : number in `Plan.setups`   layers : (2,) first layer and one past the last, numbers of `Plan.layers`
    base : (6,) float, mm, 1   point of its base plane and the unit direction in which it grows, build frame
    end_direction : (3,) float   the direction of its last layer; that of the base where it grows straight
    axis : (k, 3) float, mm   its centroidal axis, from the base to its end
    volume_mm3 : of the part in it   joint_mm2 : area with which it stands on its parent
    overhang_mm2 : sum over its layers of what rests on nothing   unsupported_mm : longest bead that nothing carries
    support_mm3 : sacrificial metal built with it and milled away again   why : one line each, why it is so
    """

    name: str
    parent: int
    setup: int
    layers: tuple[int, int]
    base: Array
    end_direction: Array
    axis: Array
    volume_mm3: float
    joint_mm2: float
    overhang_mm2: float = 0.0
    unsupported_mm: float = 0.0
    support_mm3: float = 0.0
    why: tuple[str, ...] = ()


@dataclass(frozen=True)
class Setup:
    """Subcomponents built one after the other without turning the part in between.

    direction : (3,) float   the direction that points up at its start, build frame
    turn : how the part is turned from the first set-up, in words: "as clamped", "90° about X"
    subcomponents : their numbers, in order
    """

    direction: Array
    turn: str
    subcomponents: tuple[int, ...]


@dataclass(frozen=True)
class Skeleton:
    """The part's centroidal axis as a graph with radii (paper V, Figs. 17-18).

    nodes : (n, 3) float, mm, build frame   radii : (n,) float, mm, of the circle with the section's area
    edges : (m, 2) int, pairs of nodes
    """

    nodes: Array
    radii: Array
    edges: NDArray[np.int64]


@dataclass(frozen=True)
class Candidate:
    """One way to build the part that the planner weighed.

    name : in words   subcomponents, setups : how many   overhang_mm2 : left hanging beyond what the material holds
    joint_mm2 : area of all joints   time_s : rough   score : smaller is better   buildable : share of the volume, 0 … 1
    chosen : whether the plan follows it   note : what speaks against it, or why it won
    """

    name: str
    subcomponents: int
    setups: int
    overhang_mm2: float
    joint_mm2: float
    time_s: float
    score: float
    buildable: float
    chosen: bool
    note: str = ""


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
    """`part`, `deposited` (nominal), `milled` (nominal) and `support`."""
    subcomponents: tuple[Subcomponent, ...] = ()
    setups: tuple[Setup, ...] = ()
    skeleton: Skeleton | None = None
    candidates: tuple[Candidate, ...] = ()
    books: dict[str, float] = field(default_factory=dict)
    """Metal of the level layers, as `planner.toolpath.books.books_figures` has it; empty where there are none."""
    stock_file: str = field(default="", compare=False)
    """Where the given stock's mesh lies for whoever holds the Plan, empty: as the recipe says. Not written with the Plan."""

    @property
    def operations(self) -> list[Operation]:
        """All operations in order."""
        return [operation for layer in self.layers for operation in layer.operations]
