"""What a recipe and a material come to: every field settled, and the bead that fills a layer of a given height."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from config import ConfigError, load_material
from config.material import Material, Window
from planner.errors import RecipeError
from planner.recipe import Pattern, Recipe

_FILLS = 1e-9  # relative: rounding of the closed forms below
_FALLS_SHORT = 0.05  # of a bead's metal: what the overbuild and the neighbours make up for
_SAME_MM = 1e-6  # of heights: rounding
Floats = NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]
"""Of a rigid transform, 3 x 4."""
WHERE_IT_IS: Rows = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


@dataclass(frozen=True)
class Bead:
    """One track, and the flat layer that tracks side by side make.

    width_mm, crest_mm : the single track, a parabola    step_mm : distance of neighbouring tracks
    height_mm : of the flat layer that tracks at that distance make: area / step
    """

    speed_mm_s: float
    laser_w: float
    powder_g_min: float
    width_mm: float
    area_mm2: float
    step_mm: float

    @property
    def crest_mm(self) -> float:
        """Height of a single track: 1.5 area / width for a parabola."""
        return 1.5 * self.area_mm2 / self.width_mm

    @property
    def height_mm(self) -> float:
        """Height of the layer that the tracks make, mm."""
        return self.area_mm2 / self.step_mm


@dataclass(frozen=True)
class Settings:
    """A recipe with nothing left open. Units as in the names; angles in degrees."""

    recipe: Recipe
    material: Material
    step_over: float
    layer_min_mm: float
    layer_max_mm: float
    overbuild: float
    allowance_mm: float
    interpass_s: float
    cutter_diameter_mm: float
    spindle_rpm: float
    mill_feed_mm_s: float
    mill_every_mm: float
    max_interpass_k: float | None = None
    first_layer_power: float = 1.0
    edge_power: float = 1.0
    ramp_mm: float = 0.0
    is_on_plate: bool = True
    build_from_part: Rows = WHERE_IT_IS
    build_from_layer: Rows = WHERE_IT_IS

    @property
    def is_milled(self) -> bool:
        """Whether the walls and tops are cut."""
        return self.recipe.process != "deposit"

    @property
    def cutter_radius_mm(self) -> float:
        """Half the cutter's diameter."""
        return 0.5 * self.cutter_diameter_mm

    @classmethod
    def from_recipe(cls, recipe: Recipe) -> Settings:
        """Take what the recipe leaves open from its material.

        Raises RecipeError, one line with field, value asked, bound and unit, if the material does not allow it.
        """
        try:
            material = load_material(recipe.material)
        except ConfigError as error:
            raise RecipeError(f"material: {error.message}", error.hint) from None
        facts, mill = material.deposition, material.milling
        _within("layer_height_mm", recipe.layer_height_mm, facts.layer_height_mm, "mm", material.name)
        _within("speed_mm_s", recipe.speed_mm_s, facts.speed_mm_s, "mm/s", material.name)
        _within("laser_w", recipe.laser_w, facts.laser_w, "W", material.name)
        _within("powder_g_min", recipe.powder_g_min, facts.powder_g_min, "g/min", material.name)
        if recipe.step_over is not None and recipe.step_over < LEAST_STEP_OVER:
            raise RecipeError(
                f"step_over: asked {recipe.step_over:g}, at least {LEAST_STEP_OVER:g} of the bead's width",
                "tracks closer than that pile up",
            )
        if recipe.mill_every_mm is not None and recipe.mill_every_mm > mill.axial_depth_mm:
            raise RecipeError(
                f"mill_every_mm: asked {recipe.mill_every_mm:g} mm, {material.name} allows {mill.axial_depth_mm:g} mm "
                "(axial depth of cut)",
                "mill more often",
            )
        diameter = recipe.cutter_diameter_mm or mill.cutter_diameter_mm
        if recipe.small_cutter_diameter_mm is not None and recipe.small_cutter_diameter_mm >= diameter:
            raise RecipeError(
                f"small_cutter_diameter_mm: asked {recipe.small_cutter_diameter_mm:g} mm, the cutter has {diameter:g} mm",
                "name a smaller one, or leave it out",
            )
        rpm, feed = _speed_and_feed(material, diameter, recipe.cutter_teeth)
        height = recipe.layer_height_mm
        return cls(
            recipe=recipe,
            material=material,
            step_over=_either(recipe.step_over, material.bead.step_over),
            layer_min_mm=height or facts.layer_height_mm.min,
            layer_max_mm=height or facts.layer_height_mm.max,
            overbuild=_either(recipe.overbuild, facts.overbuild),
            allowance_mm=0.0 if recipe.process == "deposit" else _either(recipe.stock_allowance_mm, facts.stock_allowance_mm),
            interpass_s=_either(recipe.interpass_s, facts.interpass_s),
            cutter_diameter_mm=diameter,
            spindle_rpm=rpm,
            mill_feed_mm_s=feed,
            mill_every_mm=recipe.mill_every_mm or mill.axial_depth_mm,
            max_interpass_k=recipe.max_interpass_k or facts.max_interpass_k,
            first_layer_power=_either(recipe.first_layer_power, facts.first_layer_power),
            edge_power=_either(recipe.edge_power, facts.edge_power),
            ramp_mm=_either(recipe.ramp_mm, facts.ramp_mm),
        )

    def placed(self, build_from_layer: Floats, build_from_part: Floats | None = None) -> Settings:
        """The same for layers in a frame of their own, so that places of the recipe are found there.  (4, 4) float, rigid."""
        if not self.recipe.fill_regions:
            return self
        part = self.build_from_part if build_from_part is None else _rows(build_from_part)
        return replace(self, build_from_part=part, build_from_layer=_rows(build_from_layer))

    def pattern_of(self, region: Polygon, z: float) -> Pattern:
        """The pattern that the recipe asks for.  region : polygon of a layer, mm   z : of its bottom, both in the layer's frame."""
        asked = self.recipe.fill
        for rule in self.recipe.fill_regions:
            if rule.point_mm is not None:
                x, y = _moved_back(self.build_from_layer, _moved(self.build_from_part, rule.point_mm))[:2]
                if not shapely.intersects_xy(region, x, y):
                    continue
            if rule.z_mm is not None:
                inside = region.representative_point()
                height = _moved(self.build_from_layer, (inside.x, inside.y, z))[2]
                if not rule.z_mm[0] - _SAME_MM <= height < rule.z_mm[1] - _SAME_MM:
                    continue
            asked = rule.pattern
        return asked

    def with_small_cutter(self) -> Settings | None:
        """The same with the recipe's small cutter, its speed and feed; None where the recipe names none."""
        diameter = self.recipe.small_cutter_diameter_mm
        if diameter is None:
            return None
        rpm, feed = _speed_and_feed(self.material, diameter, self.recipe.cutter_teeth)
        return replace(self, cutter_diameter_mm=diameter, spindle_rpm=rpm, mill_feed_mm_s=feed)

    def with_ball_cutter(self) -> Settings | None:
        """The same with the recipe's ball cutter, its speed and feed; None where the recipe names none."""
        diameter = self.recipe.ball_cutter_diameter_mm
        if diameter is None:
            return None
        rpm, feed = _speed_and_feed(self.material, diameter, self.recipe.cutter_teeth)
        return replace(self, cutter_diameter_mm=diameter, spindle_rpm=rpm, mill_feed_mm_s=feed)

    @property
    def scallop_mm(self) -> float:
        """Height of the scallops between neighbouring passes of a ball cutter: the recipe's, else its cusp height."""
        return _either(self.recipe.scallop_mm, self.recipe.cusp_mm)

    def bead_for(self, layer_mm: float, reserve: float = 0.0) -> Bead:
        """The bead whose layer is (1 + overbuild + reserve) times the layer's height, by speed, then powder, then power.

        What the recipe fixes stays. Where the window has no such bead, the nearest that is not too low.
        Raises RecipeError if no bead of the window fills the layer.
        """
        facts, recipe, law = self.material.deposition, self.recipe, self.material.bead
        wanted = layer_mm * (1.0 + self.overbuild + reserve)
        bead = self._bead(
            _either(recipe.speed_mm_s, facts.speed_mm_s.usual),
            _either(recipe.powder_g_min, facts.powder_g_min.usual),
            _either(recipe.laser_w, facts.laser_w.usual),
        )
        speed_exponent = -1.0 - law.width_speed_exponent
        if recipe.speed_mm_s is None and speed_exponent:
            speed = bead.speed_mm_s * (wanted / bead.height_mm) ** (1.0 / speed_exponent)
            bead = self._bead(_clamped(speed, facts.speed_mm_s), bead.powder_g_min, bead.laser_w)
        if recipe.powder_g_min is None:
            powder = bead.powder_g_min * wanted / bead.height_mm
            bead = self._bead(bead.speed_mm_s, _clamped(powder, facts.powder_g_min), bead.laser_w)
        if recipe.laser_w is None and law.width_power_exponent:
            power = bead.laser_w * (bead.height_mm / wanted) ** (1.0 / law.width_power_exponent)
            least = max(facts.laser_w.min, law.min_power_w)
            bead = self._bead(bead.speed_mm_s, bead.powder_g_min, min(max(power, least), facts.laser_w.max))
        if bead.height_mm < layer_mm * (1.0 - _FILLS):
            raise RecipeError(
                f"layer_height_mm: a layer of {layer_mm:.3g} mm asked, but the beads of {self.material.name} fill at most "
                f"{bead.height_mm:.3g} mm at {bead.speed_mm_s:.3g} mm/s and {bead.powder_g_min:.3g} g/min",
                "choose a lower layer, a lower speed or more powder",
            )
        return bead

    def with_area(self, bead: Bead, area_mm2: float) -> Bead:
        """The bead with another cross-section and, as far as the window allows, the same width: speed first, then powder.

        Power follows the speed so that the width stays. What the recipe fixes stays. Where the window has no so small a
        bead, the smallest of it.
        Raises RecipeError if the window has none so large.
        """
        facts, recipe, law = self.material.deposition, self.recipe, self.material.bead
        speed, powder, power = bead.speed_mm_s, bead.powder_g_min, bead.laser_w
        if recipe.speed_mm_s is None:
            speed = _clamped(speed * bead.area_mm2 / area_mm2, facts.speed_mm_s)
        per_area = self.material.density_g_mm3 * speed * 60.0 / law.catch_efficiency
        if recipe.powder_g_min is None:
            powder = _clamped(area_mm2 * per_area, facts.powder_g_min)
        if recipe.laser_w is None and law.width_power_exponent:
            asked = power * (speed / bead.speed_mm_s) ** (-law.width_speed_exponent / law.width_power_exponent)
            power = min(max(asked, facts.laser_w.min, law.min_power_w), facts.laser_w.max)
        width = bead.width_mm * (power / bead.laser_w) ** law.width_power_exponent
        width *= (speed / bead.speed_mm_s) ** law.width_speed_exponent
        made = Bead(speed, power, powder, width, powder / per_area, bead.step_mm)
        if made.area_mm2 < area_mm2 * (1.0 - _FALLS_SHORT):
            raise RecipeError(
                f"layer_height_mm: {area_mm2 / bead.step_mm:.3g} mm are wanted of a bead, but those of {self.material.name} make "
                f"at most {made.height_mm:.3g} mm at {speed:.3g} mm/s and {powder:.3g} g/min",
                "choose a lower layer, a lower speed or more powder",
            )
        return made

    def slowed(self, bead: Bead, speed_mm_s: float) -> Bead:
        """The same track laid more slowly: powder and power go down with the speed, as far as the window allows."""
        facts, law = self.material.deposition, self.material.bead
        per_area = self.material.density_g_mm3 * speed_mm_s * 60.0 / law.catch_efficiency
        powder, power = bead.powder_g_min, bead.laser_w
        if self.recipe.powder_g_min is None:
            powder = _clamped(bead.area_mm2 * per_area, facts.powder_g_min)
        if self.recipe.laser_w is None and law.width_power_exponent:
            asked = power * (speed_mm_s / bead.speed_mm_s) ** (-law.width_speed_exponent / law.width_power_exponent)
            power = min(max(asked, facts.laser_w.min, law.min_power_w), facts.laser_w.max)
        width = bead.width_mm * (power / bead.laser_w) ** law.width_power_exponent
        width *= (speed_mm_s / bead.speed_mm_s) ** law.width_speed_exponent
        return Bead(speed_mm_s, power, powder, width, powder / per_area, bead.step_mm)

    def _bead(self, speed_mm_s: float, powder_g_min: float, laser_w: float) -> Bead:
        law = self.material.bead
        area = law.catch_efficiency * powder_g_min / 60.0 / (self.material.density_g_mm3 * speed_mm_s)
        width = law.width_coefficient * laser_w**law.width_power_exponent * speed_mm_s**law.width_speed_exponent
        return Bead(speed_mm_s, laser_w, powder_g_min, width, area, self.step_over * width)


BLOCK_ALLOWANCE_MM = 1.0  # of the block to mill from, where neither a stock nor an allowance is given


def block_allowance_mm(recipe: Recipe) -> float | None:
    """How much larger than the part's box the block is that it is milled from, sideways and upwards, mm.

    None where the part is not milled from a block: another process, or a stock is given.
    """
    if recipe.process != "mill" or recipe.stock is not None:
        return None
    return _either(recipe.stock_allowance_mm, BLOCK_ALLOWANCE_MM)


LEAST_STEP_OVER = 0.3  # of the width: two thirds of every track would lie on the one before it


def _speed_and_feed(material: Material, diameter_mm: float, teeth: int) -> tuple[float, float]:
    """Speed of a cutter, whole 1/min, at the material's cutting speed, and its feed, mm/s: teeth x feed per tooth x speed."""
    rpm = 1000.0 * material.milling.cutting_speed_m_min / (math.pi * diameter_mm)
    return round(rpm, 0), round(rpm * material.milling.feed_per_tooth_mm * teeth / 60.0, 3)


def _rows(matrix: Floats) -> Rows:
    return tuple(tuple(float(value) for value in row) for row in matrix[:3])


def _moved(rows: Rows, point: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = (row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3] for row in rows)
    return x, y, z


def _moved_back(rows: Rows, point: tuple[float, float, float]) -> tuple[float, float, float]:
    away = [value - row[3] for value, row in zip(point, rows, strict=True)]
    x, y, z = (sum(rows[r][c] * away[r] for r in range(3)) for c in range(3))
    return x, y, z


def _either(asked: float | None, default: float) -> float:
    return default if asked is None else asked


def _clamped(value: float, window: Window) -> float:
    return min(max(value, window.min), window.max)


def _within(field: str, asked: float | None, window: Window, unit: str, material: str) -> None:
    if asked is not None and not window.min <= asked <= window.max:
        raise RecipeError(
            f"{field}: asked {asked:g} {unit}, {material} allows {window.min:g} … {window.max:g} {unit}",
            "stay inside the material's process window or give another material file",
        )
