"""A Plan of three subcomponents made by hand: a stem, a bend on it whose layers turn, and a branch out of the stem's side."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.plan import (
    Candidate,
    Contour,
    Layer,
    Operation,
    Pass,
    Plan,
    Process,
    Setup,
    Skeleton,
    Subcomponent,
)
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]

STEM_RADIUS, STEM_LAYERS, LAYER_MM = 6.0, 10, 0.8
BEND_RADIUS, BEND_LAYERS, BEND_STEP_DEG = 20.0, 25, 2.4
BRANCH_RADIUS, BRANCH_LAYERS = 3.0, 8
SHIFT_MM = 0.3
"""How far each layer of the bend and of the branch reaches past the one before, on one side."""


def disc(radius: float, shift: float = 0.0) -> shapely.Polygon:
    """A round section in its plane's own coordinates."""
    turn = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    return shapely.Polygon(np.column_stack([radius * np.cos(turn) + shift, radius * np.sin(turn)]))


def crescent(radius: float) -> shapely.Polygon:
    """What of a disc lies beyond the same disc, shifted by SHIFT_MM."""
    return disc(radius).difference(disc(radius, SHIFT_MM))


def lifted(plane: Floats, xy: Floats) -> Floats:
    """Plane coordinates to the build frame."""
    frame = plane_frame(plane)
    return np.asarray(frame[0] + xy @ frame[1:3])


def ring(plane: Floats, radius: float) -> Curve:
    """A circle in a plane, as a closed curve."""
    return interpolate(lifted(plane, shapely.get_coordinates(disc(radius).exterior)[:-1]), closed=True)


def layer_of(index: int, bottom: Floats, top: Floats, radius: float, piece: int, hangs: bool, turns: bool) -> Layer:
    """A layer of one round contour: a bead round it, and where it hangs an outline and a bead of its own."""
    curve = ring(bottom, radius)
    rows = np.array([[0.0, 12.0, 1200.0, 12.0, 15.0]])
    beads = [Operation(Process.DEPOSIT_CONTOUR, index, (Pass(curve, bottom[3:], rows),), bead_width_mm=2.0)]
    outlines: tuple[Floats, ...] = ()
    area = 0.0
    if hangs:
        shape = crescent(radius)
        area = shape.area
        outline = lifted(bottom, shapely.get_coordinates(shape.exterior)[:-1])
        outlines = (outline,)
        bead = Pass(Curve.from_polyline(outline), bottom[3:], rows)
        beads.append(Operation(Process.DEPOSIT_OVERHANG, index, (bead,), bead_width_mm=2.0))
    apart = float(np.linalg.norm(top[:3] - bottom[:3]))
    lean = float(np.deg2rad(BEND_STEP_DEG)) * radius if turns else 0.0
    return Layer(
        index, bottom, top, (Contour(curve, False, -1, 0.001, 0.002),), (), disc(radius).area - area, area,
        tuple(beads), piece, outlines, (apart - lean, apart + lean),
    )  # fmt: skip


def bend_plane(step: int) -> Floats:
    """The bend's planes: they turn about the line x = BEND_RADIUS, z = the stem's end, from +z towards +x."""
    turn = np.deg2rad(BEND_STEP_DEG * step)
    height = LAYER_MM * STEM_LAYERS
    return np.array(
        [BEND_RADIUS * (1.0 - np.cos(turn)), 0.0, height + BEND_RADIUS * np.sin(turn), np.sin(turn), 0.0, np.cos(turn)]
    )


def branch_plane(step: int) -> Floats:
    """The branch's planes: level ones as seen along -x, from the stem's side on."""
    return np.array([-STEM_RADIUS - LAYER_MM * step, 0.0, 4.0, -1.0, 0.0, 0.0])


def stem_plane(step: int) -> Floats:
    """The stem's planes."""
    return np.array([0.0, 0.0, LAYER_MM * step, 0.0, 0.0, 1.0])


def divided_plan() -> Plan:
    """The whole plan: 43 layers, three subcomponents in two set-ups, a skeleton of two arms and two candidates."""
    layers = [
        layer_of(k, stem_plane(k), stem_plane(k + 1), STEM_RADIUS, 0, False, False) for k in range(STEM_LAYERS)
    ]
    layers += [
        layer_of(STEM_LAYERS + k, bend_plane(k), bend_plane(k + 1), STEM_RADIUS, 1, k % 2 == 1, True)
        for k in range(BEND_LAYERS)
    ]
    first = len(layers)
    layers += [
        layer_of(first + k, branch_plane(k), branch_plane(k + 1), BRANCH_RADIUS, 2, k > 4, False)
        for k in range(BRANCH_LAYERS)
    ]
    bounds = np.array([[-13.0, -6.0, 0.0], [14.0, 6.0, 29.0]])
    return Plan(
        "elbow with a branch", "0" * 64, "", "316L", "hybrid", 0.1, np.eye(4), bounds, tuple(layers),
        findings=("by hand",), volumes_mm3={"part": 4000.0, "support": 12.5}, subcomponents=subcomponents(),
        setups=setups(), skeleton=skeleton(), candidates=candidates(),
    )  # fmt: skip


def subcomponents() -> tuple[Subcomponent, ...]:
    """Stem, bend and branch."""
    bend = [bend_plane(k) for k in range(BEND_LAYERS + 1)]
    second, third = STEM_LAYERS + BEND_LAYERS, STEM_LAYERS + BEND_LAYERS + BRANCH_LAYERS
    last = branch_plane(BRANCH_LAYERS)
    return (
        Subcomponent(
            "1", -1, 0, (0, STEM_LAYERS), stem_plane(0), stem_plane(0)[3:],
            np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 8.0]]), 904.8, 113.1, why=("stands on the substrate",),
        ),
        Subcomponent(
            "2", 0, 0, (STEM_LAYERS, second), bend[0], bend[-1][3:], np.array([p[:3] for p in bend]),
            2368.7, 113.1, 21.6, 0.3, why=("its axis turns by 60°", "no direction alone holds its outer side µ"),
        ),
        Subcomponent(
            "3", 0, 1, (second, third), branch_plane(0), last[3:], np.array([branch_plane(0)[:3], last[:3]]),
            181.0, 28.3, 5.4, 0.3, 12.5, ("sections branch at z = 4 mm",),
        ),
    )  # fmt: skip


def setups() -> tuple[Setup, ...]:
    """As clamped, then turned."""
    return (
        Setup(np.array([0.0, 0.0, 1.0]), "as clamped", (0, 1)),
        Setup(np.array([-1.0, 0.0, 0.0]), "90° about Y", (2,)),
    )


def skeleton() -> Skeleton:
    """A stem's axis up to the branch, the bend and the branch's end."""
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 4.0], [0.0, 0.0, 8.0], bend_plane(BEND_LAYERS)[:3], [-12.4, 0.0, 4.0]])
    return Skeleton(nodes, np.array([6.0, 6.0, 6.0, 6.0, 3.0]), np.array([[0, 1], [1, 2], [2, 3], [1, 4]]))


def candidates() -> tuple[Candidate, ...]:
    """The one in three pieces, and the one that leaves much hanging."""
    return (
        Candidate("three pieces along the skeleton", 3, 2, 0.0, 141.4, 1900.0, 1.25, 1.0, True, "nothing left hanging"),
        Candidate("one piece, +z up", 1, 1, 310.0, 0.0, 1500.0, 7.5, 0.62, False, "310 mm² hang beyond 60°"),
    )
