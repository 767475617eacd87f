"""What is wanted of a part: one validated TOML; whatever is left out comes from the material."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from config import ConfigError, Facts, parse_facts, read_facts
from config.base import Finite, Fraction, NotNegative, Positive
from planner.errors import RecipeError


class Cut(Facts):
    """A cutting plane that the user wants, in the part frame. What lies on the side of the normal is built later, on the cut."""

    point_mm: tuple[Finite, Finite, Finite] = Field(
        description="on the plane; where it lies in the joint of one body, that body alone is cut off, else every body beyond the plane"
    )
    normal: tuple[Finite, Finite, Finite]
    direction: tuple[Finite, Finite, Finite] | None = Field(None, description="in which the piece beyond is built; none: the normal")
    order: int | None = Field(None, ge=2, description="place in the building order, 1 is what stands on the substrate; none: as found")

    @model_validator(mode="after")
    def _has_directions(self) -> Cut:
        for name, vector in (("normal", self.normal), ("direction", self.direction)):
            if vector is not None and not any(abs(value) > 1e-9 for value in vector):
                raise ValueError(f"{name}: asked (0, 0, 0), it needs a length")
        return self


Pattern = Literal["auto", "raster", "contour", "spiral"]
"""auto: spiral in rings of even width, beads beside the outline in strips of even width, else raster. raster: contours and hatch.
contour: beads beside the outline all the way in. spiral: one bead through rings of even width; contour in what is none."""


class FillRegion(Facts):
    """Where another pattern is wanted than in the rest of the part; where several meet, the last one holds."""

    pattern: Pattern
    point_mm: tuple[Finite, Finite, Finite] | None = Field(
        None, description="part frame: the regions of all layers that it lies in, over or under, along the build direction"
    )
    z_mm: tuple[Finite, Finite] | None = Field(None, description="layers that begin between these heights above the substrate, build frame")

    @model_validator(mode="after")
    def _says_where(self) -> FillRegion:
        if self.point_mm is None and self.z_mm is None:
            raise ValueError("fill_regions: says a pattern but not where, give point_mm or z_mm; for the whole part use fill")
        if self.z_mm is not None and self.z_mm[0] >= self.z_mm[1]:
            raise ValueError(f"z_mm: asked {self.z_mm[0]:g} to {self.z_mm[1]:g} mm, the second height must be the greater")
        return self


class Recipe(Facts):
    """The recipe. None means: take it from the material (see `planner.process.Settings`)."""

    schema_version: Literal[1] = 1
    material: str = Field("316L", description="shipped name or path of a material file")
    process: Literal["hybrid", "deposit", "mill"] = "hybrid"
    tolerance_mm: Positive = Field(0.1, le=5.0, description="two-sided, of the finished surface; p99 of the deviation must stay below it")
    cusp_mm: Positive = Field(0.04, le=2.0, description="delta of the facet rule, paper IV")
    fit: Literal["surface", "facets"] = Field("surface", description="contours follow the smooth surface that the facets stand for, or the facets")
    fit_epsilon_mm: Positive = Field(0.5, le=10.0, description="fit = facets: spacing of the points laid on the facets' chords, paper Eq. 12")
    handles: Literal["curvature", "speed"] = Field("curvature", description="sixth-order handles, or the paper's Eq. 5")
    crease_deg: Positive = Field(35.0, le=180.0, description="edges of the mesh that bend more are creases: contours have corners there")
    layer_rule: Literal["facet", "extruded", "ruled"] = Field("facet", description="thickness of layers: flat facets, Eqs. 15-18 or Eq. 20")
    tolerance_side: Literal["both", "outside", "inside"] = Field("both", description="where the cusp may lie: either side, outside only, inside only")
    build_direction: tuple[Finite, Finite, Finite] | Literal["auto"] = Field("auto", description="of what stands on the substrate")
    decompose: Literal["auto", "never"] = Field("auto", description="cut the part into subcomponents where one direction is not enough")
    cuts: tuple[Cut, ...] = Field((), description="cutting planes to use instead of those that the planner would find")
    axis_layers: Literal["auto", "never"] = Field("auto", description="layers turn with the centroidal axis where the part bends")
    overhang: Literal["tilt", "upright"] = Field(
        "tilt", description="head along the side surface over overhangs, or always along the layer's direction"
    )
    support: Literal["auto", "never"] = Field("auto", description="sacrificial metal under what no direction can make")
    substrate_mm: tuple[Positive, Positive] = Field((120.0, 120.0), description="of the plate, for what head and cutter can reach beside it")
    shift_mm: tuple[Finite, Finite] | Literal["auto"] = Field(
        "auto", description="of the part off the plate's middle; auto: 0, or to the edge over which pieces grow sideways"
    )
    turn_deg: Finite = Field(0.0, ge=-360.0, le=360.0, description="of the part on its plate, about the build direction: past clamps")
    stock: str | None = Field(None, description="process = mill: STL of the stock, in the part frame; none: the bounding box plus allowance")
    layer_height_mm: Positive | None = None
    speed_mm_s: Positive | None = None
    laser_w: Positive | None = None
    powder_g_min: Positive | None = None
    stock_allowance_mm: NotNegative | None = None
    overbuild: NotNegative | None = None
    interpass_s: NotNegative | None = None
    max_interpass_k: Positive | None = Field(None, description="warmest that part and plate may be when a layer begins, K: layers wait for it")
    first_layer_power: Positive | None = Field(None, ge=0.5, le=2.0, description="times the laser's power, for the layer on the substrate")
    ramp_mm: NotNegative | None = Field(None, le=10.0, description="of bead at each end, over which the laser's power rises and falls; 0: at once")
    edge_power: Positive | None = Field(None, ge=0.5, le=2.0, description="times the laser's power, for the outermost contour of each region")
    contours: int = Field(1, ge=1, le=20, description="deposited contours per boundary before hatching")
    hatch_angle_deg: Finite = Field(0.0, description="of the first layer, in the build frame")
    hatch_rotation_deg: Finite = Field(67.0, description="from layer to layer")
    fill: Pattern = Field("auto", description="pattern of the beads in a layer, by the shape of each region or the same everywhere")
    fill_regions: tuple[FillRegion, ...] = Field((), description="where another pattern is wanted")
    step_over: Fraction | None = None
    mill_every_layers: int | None = Field(None, ge=1, description="side walls are milled after this many layers")
    mill_every_mm: Positive | None = Field(None, description="or after this height; default: what the cutter's axial depth and flute allow")
    face_every_layers: int | None = Field(None, ge=1, description="tops are faced after this many layers; the last one always")
    cutter_diameter_mm: Positive | None = None
    small_cutter_diameter_mm: Positive | None = Field(None, description="for what the cutter does not reach: gaps, inside corners, small bores")
    ball_cutter_diameter_mm: Positive | None = Field(None, description="for walls and domes that no flank follows; none: they are milled in steps")
    scallop_mm: Positive | None = Field(None, le=1.0, description="height of the scallops that the ball cutter leaves; none: cusp_mm")
    cutter_teeth: int = Field(4, ge=1, le=12, description="of the cutter: the feed is teeth x feed per tooth x speed")

    @model_validator(mode="after")
    def _cuts_agree(self) -> Recipe:
        if self.cuts and self.decompose == "never":
            raise ValueError("cuts: there are some, but decompose = never: leave one of them out")
        if self.cuts and self.process == "mill":
            raise ValueError("cuts: a part that is milled from a block is not built in pieces: leave them out")
        orders = [cut.order for cut in self.cuts if cut.order is not None]
        if len(set(orders)) < len(orders):
            raise ValueError("cuts: two of them ask for the same order, each place is taken once")
        return self


def parse_recipe(text: str, source: str = "recipe") -> Recipe:
    """Validate TOML text. Raises RecipeError with one line naming the field."""
    try:
        return parse_facts(Recipe, text, source)
    except ConfigError as error:
        raise RecipeError(error.message, error.hint) from None


def load_recipe(path: Path) -> Recipe:
    """Read a recipe file. Raises RecipeError with one line naming the file and the field."""
    try:
        return read_facts(Recipe, path)
    except ConfigError as error:
        raise RecipeError(error.message, error.hint) from None
