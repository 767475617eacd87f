"""Whether the beads of a layer bring the metal that it takes: deposited to wanted area, widest void, what is laid twice."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import inset, outset
from planner.plan import Layer, Pass, Plan, Process
from planner.process import Settings
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]

_SPACING_MM = 0.4  # of points on curved beads: a chord of 0.4 mm on a radius of 3 mm is 7 um off
_FLAT_MM = 4e-3  # beads are measured along chords that come as near
_CLEAN_MM = 0.02  # narrower slivers between the outlines of beads are rounding
_INSCRIBED_MM = 0.01  # to which a void's width is found
_OPEN_MM2 = 1.0  # of a layer's top that no other covers: less is the step of a leaning wall
_PIECE_MM = 2.0  # of bead, by which one that meets itself is told from one that goes on
_CORE = 0.5  # of the strip that a bead stands for: cores of two beads meet where one lies over the other


@dataclass(frozen=True, eq=False)
class LitBead:
    """A stretch of bead.  path : (n, 2) float, mm, of its middle in the layer's plane   width_mm, area_mm2 : of the track."""

    path: Floats
    width_mm: float
    area_mm2: float
    length_mm: float


@dataclass(frozen=True)
class LayerBalance:
    """One layer's books.

    region_mm2 : to be as high as the layer   deposited_mm2 : metal of the beads by the height that the layer's bead makes
    void_mm : diameter of the largest circle in the region that no bead covers, corners that no bead reaches left out
    bead_mm : usual width of its beads   double_share : of their length, nearer than half a step to another bead
    is_top : more metal on purpose, under a face that is milled
    """

    layer: int
    region_mm2: float
    deposited_mm2: float
    void_mm: float
    bead_mm: float
    double_share: float
    is_top: bool = False

    @property
    def ratio(self) -> float:
        """Deposited to wanted area."""
        return self.deposited_mm2 / self.region_mm2 if self.region_mm2 > 0.0 else 1.0

    @property
    def void_beads(self) -> float:
        """The widest void in widths of the bead."""
        return self.void_mm / self.bead_mm


def lit_beads(passes: Iterable[Pass], settings: Settings, flat: Callable[[Floats], Floats] | None = None) -> list[LitBead]:
    """The stretches of passes on which the laser is on, one by one.  flat : (n, 3) to (n, 2) float, mm; None: x and y."""
    law, density = settings.material.bead, settings.material.density_g_mm3
    found = []
    for made in passes:
        if made.is_link:
            continue
        ends = np.append(made.setpoints[1:, 0], made.tip.length)
        for (at, speed, power, powder, _), end in zip(made.setpoints, ends, strict=True):
            if power <= 0.0 or end - at < 1e-6:
                continue
            count = 2 if made.tip.degree == 1 and len(made.tip.control_points) == 2 else math.ceil((end - at) / _SPACING_MM) + 1
            tips = made.tip.evaluate(made.tip.at_arc_length(np.linspace(at, end, max(count, 2))))
            width = law.width_coefficient * power**law.width_power_exponent * speed**law.width_speed_exponent
            area = law.catch_efficiency * powder / 60.0 / (density * speed)
            found.append(LitBead(tips[:, :2] if flat is None else flat(tips), float(width), float(area), float(end - at)))
    return found


def lit_mm(passes: Iterable[Pass]) -> float:
    """Length of the beads of passes, mm."""
    total = 0.0
    for made in passes:
        ends = np.append(made.setpoints[1:, 0], made.tip.length)
        total += float((ends - made.setpoints[:, 0])[made.setpoints[:, 2] > 0.0].sum())
    return total


def metal_mm3(passes: Iterable[Pass], settings: Settings) -> float:
    """Metal that the beads of passes bring, mm³, as the material's mass balance has it."""
    catch, density = settings.material.bead.catch_efficiency, settings.material.density_g_mm3
    total = 0.0
    for made in passes:
        if not made.is_link:
            ends = np.append(made.setpoints[1:, 0], made.tip.length)
            lit = (ends - made.setpoints[:, 0]) * (made.setpoints[:, 2] > 0.0)
            total += float((lit * catch * made.setpoints[:, 3] / 60.0 / (density * made.setpoints[:, 1])).sum())
    return total


def balance_of(
    region: MultiPolygon, beads: list[LitBead], height_mm: float, settings: Settings, layer: int = 0, is_top: bool = False
) -> LayerBalance:
    """The books of a level layer.  region : to be full, mm   height_mm : that its beads make at their step."""
    beads = [bead for bead in beads if bead.area_mm2 > 0.0]
    if not beads or height_mm <= 0.0 or region.area <= 0.0:
        return LayerBalance(layer, float(region.area), 0.0, 0.0, 1.0, 0.0, is_top)
    lines = shapely.simplify([shapely.LineString(bead.path) for bead in beads], _FLAT_MM)
    widths = np.array([bead.width_mm for bead in beads])
    strips = np.array([bead.area_mm2 for bead in beads]) / height_mm
    lengths = np.array([bead.length_mm for bead in beads])
    usual = float(np.average(widths, weights=lengths))
    covered = shapely.union_all(shapely.buffer(lines, 0.5 * widths, quad_segs=8))
    narrow = 0.5 * min(narrowest_mm(settings), usual)
    reachable = outset(inset(region, narrow), narrow)
    void = widest_mm(shapely.difference(reachable, covered))
    double = _doubled_mm2(beads, strips) / float((_CORE * strips * lengths).sum())
    return LayerBalance(layer, float(region.area), float((strips * lengths).sum()), void, usual, double, is_top)


def _doubled_mm2(beads: list[LitBead], strips: Floats) -> float:
    """Area that the cores of two beads share, mm².  strips : (n,) float, mm, width that each stands for."""
    pieces, owner = _pieces(beads)
    cores = shapely.buffer(pieces, 0.5 * _CORE * strips[owner], cap_style="flat", join_style="mitre", mitre_limit=1.5)
    one, other = shapely.STRtree(cores).query(cores, predicate="intersects")
    apart = (one < other) & (other - one > 1)
    return float(shapely.area(shapely.intersection(cores[one[apart]], cores[other[apart]])).sum())


def _pieces(beads: list[LitBead]) -> tuple[NDArray[np.object_], NDArray[np.int64]]:
    """Short lines of which the beads are made, so that one that meets itself is seen, and whose they are."""
    points: list[Floats] = []
    piece: list[NDArray[np.int64]] = []
    owner: list[int] = []
    for number, bead in enumerate(beads):
        count = max(1, round(bead.length_mm / _PIECE_MM)) if len(bead.path) > 2 else 1
        edges = np.unique(np.linspace(0, len(bead.path) - 1, count + 1).astype(int))
        for a, b in itertools.pairwise(edges.tolist()):
            points.append(bead.path[a : b + 1])
            piece.append(np.full(b + 1 - a, len(owner)))
            owner.append(number)
    lines = np.asarray(shapely.linestrings(np.concatenate(points), indices=np.concatenate(piece)))
    return shapely.simplify(lines, _FLAT_MM), np.array(owner, dtype=np.int64)


def narrowest_mm(settings: Settings) -> float:
    """Width of the narrowest bead of the material's window, mm: what is narrower at a corner's tip no bead fills."""
    law, facts, recipe = settings.material.bead, settings.material.deposition, settings.recipe
    power = recipe.laser_w or max(facts.laser_w.min, law.min_power_w)
    speed = recipe.speed_mm_s or (facts.speed_mm_s.max if law.width_speed_exponent < 0.0 else facts.speed_mm_s.min)
    return float(law.width_coefficient * power**law.width_power_exponent * speed**law.width_speed_exponent)


def widest_mm(holes: shapely.Geometry) -> float:
    """Diameter of the largest circle in polygons, mm; 0 where they are slivers."""
    opened = shapely.buffer(shapely.buffer(holes, -0.5 * _CLEAN_MM), 0.5 * _CLEAN_MM)
    parts = [part for part in shapely.get_parts(opened) if part.geom_type == "Polygon" and not part.is_empty]
    return max((2.0 * shapely.maximum_inscribed_circle(part, tolerance=_INSCRIBED_MM).length for part in parts), default=0.0)


def layer_balance(layer: Layer, settings: Settings) -> LayerBalance | None:
    """The books of a planned layer; None where it is not equally high, or nothing level is deposited in it."""
    deposits = [operation for operation in layer.operations if operation.process.is_deposit]
    if not deposits or any(operation.process is Process.DEPOSIT_OVERHANG for operation in deposits):
        return None
    if layer.thickness_mm[1] > layer.thickness_mm[0] * 1.001:
        return None
    origin, x, y, _ = plane_frame(layer.bottom)
    axes = np.column_stack([x, y])

    def flat(points: Floats) -> Floats:
        return np.asarray((points - origin) @ axes)

    region = outset(contour_region(layer, flat), settings.allowance_mm) if settings.allowance_mm > 0.0 else contour_region(layer, flat)
    beads = lit_beads((step for operation in deposits for step in operation.passes), settings, flat)
    return balance_of(region, beads, deposits[0].bead_height_mm, settings, layer.index)


def contour_region(layer: Layer, flat: Callable[[Floats], Floats]) -> MultiPolygon:
    """What a planned layer's contours enclose, in its plane.  flat : (n, 3) to (n, 2) float, mm."""
    region: shapely.Geometry = MultiPolygon()
    for contour in layer.contours:
        ring = shapely.make_valid(Polygon(flat(contour.curve.evaluate(contour.curve.sample(0.01)))))
        region = shapely.difference(region, ring) if contour.is_hole else shapely.union(region, ring)
    return MultiPolygon([part for part in shapely.get_parts(region) if part.geom_type == "Polygon"])


def plan_balance(plan: Plan | Sequence[Layer], settings: Settings) -> list[LayerBalance]:
    """The books of all layers that are equally high and laid upright."""
    layers = plan.layers if isinstance(plan, Plan) else plan
    found = []
    for number, layer in enumerate(layers):
        books = layer_balance(layer, settings)
        if books is None:
            continue
        above = layers[number + 1] if number + 1 < len(layers) else None
        found.append(replace(books, is_top=_is_top(layer, above, settings)))
    return found


def _is_top(layer: Layer, above: Layer | None, settings: Settings) -> bool:
    """Whether part of a layer's top is a face that is milled: nothing stands on all of it."""
    if not settings.is_milled or all(operation.process is not Process.MILL_FACE for operation in layer.operations):
        return False
    if above is None or above.subcomponent != layer.subcomponent:
        return True
    covered = contour_region(above, lambda points: points[:, :2])
    return bool(shapely.difference(contour_region(layer, lambda points: points[:, :2]), covered).area > _OPEN_MM2)
