"""process = mill: the part cut out of a block or a given stock, slab by slab from the top."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.errors import MeshError, PlanningError, RecipeError
from planner.mesh.load import load
from planner.mesh.mesh import Mesh
from planner.nurbs.offset import inset, outset
from planner.nurbs.rings import curves_from_region
from planner.plan import Operation, Pass, Process
from planner.process import Settings, block_allowance_mm
from planner.recipe import Recipe
from planner.slicing.regions import LayerRegion, united
from planner.slicing.slicer import slice_mesh
from planner.toolpath.beside import polygons
from planner.toolpath.contour import PATH_TOLERANCE_MM
from planner.toolpath.engagement import eased, engagement_limit_rad
from planner.toolpath.face import entry_point
from planner.toolpath.motion import joined, lifted, process_pass, straight
from planner.toolpath.order import Finished, Sequence
from planner.toolpath.side import places, stretches_within, unreached, upright_passes

Floats = NDArray[np.float64]

_FINISH_MM = 0.3  # what roughing leaves on the walls for the finishing pass
_ENTRY_MM = 1.0  # air between cutter and stock where it comes down beside it
_LEVEL_MM = 1e-6  # nearer levels are one
_LEAST_CUT_MM2 = 0.05  # smaller pieces of stock are crumbs


def stock_of(part: Mesh, recipe: Recipe, build_from_part: Floats) -> Mesh:
    """The stock in the build frame: the recipe's mesh, or the part's box grown sideways and upwards by the allowance.

    Raises RecipeError if the stock cannot be read or does not hold the part's box.
    """
    if recipe.stock is None:
        grow = block_allowance_mm(recipe) or 0.0
        low, high = part.bounds[0] - [grow, grow, 0.0], part.bounds[1] + grow
        return box_mesh(low, high)
    try:
        stock = load(recipe.stock).transformed(build_from_part)
    except MeshError as error:
        raise RecipeError(f"stock: {error.message}", error.hint) from None
    if (stock.bounds[0] > part.bounds[0] + 1e-6).any() or (stock.bounds[1] < part.bounds[1] - 1e-6).any():
        raise RecipeError(
            "stock: the part's box reaches out of the stock's box", "give a stock in the part's own frame that holds it"
        )
    return stock


def box_mesh(low: Floats, high: Floats) -> Mesh:
    """A closed box.  low, high : (3,) float, mm, its corners."""
    corners = np.array([[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return Mesh(corners, np.array([[a, b, c] for a, b, c, d in quads] + [[a, c, d] for a, b, c, d in quads]))


def carve(stock: Mesh, regions: list[LayerRegion], settings: Settings, finished: Finished) -> Sequence:
    """The operations that cut the part out of the stock, layer by layer from the top.

    finished : told each layer and its operations when none will be added.
    What stands above a layer shades it: the cutter comes from above only, and undercuts stay (a finding says so).
    """
    top = float(stock.bounds[1, 2])
    sequence = Sequence(settings, metal_top=top)
    depth = settings.material.milling.axial_depth_mm
    keep = MultiPolygon()
    ceiling = top
    shaded = 0.0
    for region in reversed(regions):
        wider = united([keep, region.region])
        shaded += max(wider.area - region.region.area, 0.0) * region.height_mm
        for high, low in pairwise(_levels(ceiling, region, depth)):
            kept = wider if low < region.z_top - 1e-9 else keep
            metal = _stock_section(stock, 0.5 * (high + low))
            for operation in _slab(metal, kept, float(low), region.index, settings):
                sequence.add(operation, region.index)
        keep, ceiling = wider, region.z_bottom
        finished(region, sequence.operations.get(region.index, []))
    sequence.findings.extend(_findings(shaded, keep, settings))
    sequence.deposited_mm3 = stock.volume
    if not sequence.operations:
        raise PlanningError("the stock is the part already: nothing to mill", "give a larger stock")
    return sequence


def _levels(ceiling: float, region: LayerRegion, depth_mm: float) -> list[float]:
    """Heights to which one layer's slabs are cut, from the metal's top down, at most depth_mm apart, mm.

    The part's own top is one of them, so that what the stock has above it is faced off.
    """
    levels = [ceiling]
    for floor in (region.z_top, region.z_bottom):
        if (high := levels[-1]) - floor > _LEVEL_MM:
            count = max(1, int(np.ceil((high - floor) / depth_mm - 1e-9)))
            levels += [*np.linspace(high, floor, count + 1)[1:].tolist()]
    return levels


def _findings(shaded_mm3: float, keep: MultiPolygon, settings: Settings) -> list[str]:
    findings = []
    if shaded_mm3 > 1.0:
        findings.append(f"{shaded_mm3:.0f} mm³ lie under the part's own overhangs, where the cutter does not come from above")
    closed = unreached(keep, settings.cutter_radius_mm).closed
    if closed.geoms:
        findings.append(f"{len(closed.geoms)} holes or slots at {places(closed)} mm are narrower than the cutter and stay")
    return findings


def _stock_section(stock: Mesh, z: float) -> MultiPolygon:
    if not stock.bounds[0, 2] < z < stock.bounds[1, 2]:
        return MultiPolygon()
    return slice_mesh(stock, [[0.0, 0.0, z, 0.0, 0.0, 1.0]])[0].to_shapely()


def _slab(metal: MultiPolygon, keep: MultiPolygon, z: float, layer: int, settings: Settings) -> list[Operation]:
    """Roughing of one slab down to z, then the finishing pass round what stays."""
    waste = shapely.difference(metal, keep)
    if waste.area < _LEAST_CUT_MM2:
        return []
    rough = rough_passes(metal, keep, z, settings)
    finish = upright_passes(keep, z, 0.0, settings) if not keep.is_empty else []
    return [
        Operation(
            process, layer, tuple(passes), settings.cutter_diameter_mm, settings.spindle_rpm, note=note
        )
        for process, passes, note in ((Process.MILL_FACE, rough, "roughing"), (Process.MILL_SIDE, finish, "finishing"))
        if passes
    ]


def rough_passes(metal: MultiPolygon, keep: MultiPolygon, z: float, settings: Settings) -> list[Pass]:
    """Rings at radial steps round what stays, outside in, as far as they meet the stock; slower where these meet too much.

    metal : the stock's section, mm   keep : what must stand, mm. Without anything to keep: rings inside the stock.
    """
    radius, step = settings.cutter_radius_mm, settings.material.milling.radial_depth_mm
    limit = engagement_limit_rad(step, radius)
    waste = polygons(shapely.difference(metal, keep))
    reach = outset(metal, radius, 0.01)
    if keep.is_empty:
        rings, depth = [], 0.0
        while not (ring := inset(metal, depth, 0.01)).is_empty:
            rings.append(ring)
            depth += step
        return eased(_ring_passes(rings, reach, metal, z, settings), waste, radius, limit)
    rings = []
    leave = _FINISH_MM
    while True:
        ring = outset(keep, radius + leave, 0.01)
        if shapely.difference(reach, ring).area < _LEAST_CUT_MM2:
            break
        rings.append(ring)
        leave += step
    return eased(_ring_passes(rings[::-1], reach, metal, z, settings), waste, radius, limit)


def _ring_passes(
    rings: list[MultiPolygon], reach: MultiPolygon, metal: MultiPolygon, z: float, settings: Settings
) -> list[Pass]:
    row = [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0]
    shapely.prepare(reach)
    passes = []
    for ring in rings:
        for outline in curves_from_region(ring, PATH_TOLERANCE_MM):
            for motion in stretches_within(lifted(outline.curve.reversed(), z), reach):
                start = motion.ends()[0]
                outer = next((p for p in metal.geoms if p.distance(shapely.Point(start[:2])) < 2.0 * settings.cutter_diameter_mm), None)
                if outer is not None and not outline.is_hole:
                    entry = np.array([*entry_point(outer, start, settings.cutter_radius_mm + _ENTRY_MM), z])
                    way = shapely.LineString([entry[:2], start[:2]])
                    if np.linalg.norm(entry - start) > 1e-3 and way.crosses(ring) is False:
                        motion = joined([straight([entry, start]), motion])
                passes.append(process_pass(motion, row))
    return passes
