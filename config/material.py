"""Facts about one powder on one kind of head: bead, process window, layers, milling. Every figure's origin is in `source`."""

from __future__ import annotations

from pydantic import Field, model_validator

from config.base import Facts, Finite, Fraction, NotNegative, Positive, find_facts, read_facts


class Window(Facts):
    """Least, usual and greatest value of one set-point."""

    min: NotNegative
    usual: NotNegative
    max: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Window:
        if not self.min <= self.usual <= self.max:
            raise ValueError(f"needs min <= usual <= max (has {self.min}, {self.usual}, {self.max})")
        return self


class Bead(Facts):
    """Cross-section of a single track: a parabola of `width` and of the area that mass conservation gives.

    area_mm2  = catch_efficiency * powder_g_s / (density_g_mm3 * speed_mm_s)
    width_mm  = width_coefficient * power_w**width_power_exponent * speed_mm_s**width_speed_exponent
    height_mm = 1.5 * area / width
    """

    catch_efficiency: Fraction
    width_coefficient: Positive
    width_power_exponent: Finite
    width_speed_exponent: Finite
    min_power_w: Positive = Field(description="below it nothing melts")
    step_over: Fraction = Field(
        description="distance of neighbouring tracks / width; flat top at about 0.66 for a parabola"
    )


class Deposition(Facts):
    """Process window of the head with this powder."""

    laser_w: Window
    speed_mm_s: Window
    powder_g_min: Window
    carrier_gas_l_min: Window
    shield_gas_l_min: Window
    layer_height_mm: Window
    interpass_s: NotNegative = Field(description="least time from the start of one layer to the start of the next")
    max_overhang_deg: Positive = Field(description="wall angle from the build direction that holds without tilting")
    max_tilt_deg: Positive = Field(lt=90, description="head off the layer's direction, over an overhang; beyond it the pool runs")
    cone_deg: NotNegative = Field(15.0, lt=90, description="head off the axis that was planned, to clear an obstacle or to pass the pole; a choice")
    max_unsupported_mm: Positive = Field(
        description="along the side surface: how far a bead laid with the head along that surface may reach beyond what carries it"
    )
    max_layer_ratio: Positive = Field(ge=1, description="greatest over least thickness within one layer of varying height")
    overbuild: NotNegative = Field(
        description="relative: how much more than the layer height is deposited, so that no layer falls short"
    )
    stock_allowance_mm: NotNegative = Field(description="metal outside the part before milling, normal to the wall")
    lead_in_mm: NotNegative
    lead_out_mm: NotNegative
    ramp_mm: NotNegative = Field(0.0, le=10.0, description="of bead at its start, and at its end, over which power rises and falls; 0: at once")
    ramp_power: Fraction = Field(0.6, description="share of the power with which a ramp begins and ends, never below the window's least; a choice")
    first_layer_power: Positive = Field(1.0, ge=0.5, le=2.0, description="times the power, on the cold substrate")
    edge_power: Positive = Field(1.0, ge=0.5, le=2.0, description="times the power, of the outermost contour")
    max_interpass_k: Positive | None = Field(
        None, description="part and plate when a layer begins, by part_heat's balance: layers wait for it; none: no limit"
    )


class Milling(Facts):
    """Cutting data for a carbide cutter in this metal, as deposited."""

    cutting_speed_m_min: Positive
    feed_per_tooth_mm: Positive
    axial_depth_mm: Positive
    radial_depth_mm: Positive
    face_step_over: Fraction = Field(description="of the cutter's diameter")
    cutter_diameter_mm: Positive = Field(description="usual cutter for walls and tops")


class Thermal(Facts):
    """Constants of the solid metal between room temperature and melting, as single effective values; for the melt pool's size."""

    solidus_k: Positive
    liquidus_k: Positive
    hot_density_g_mm3: Positive
    specific_heat_j_g_k: Positive
    conductivity_w_mm_k: Positive
    latent_heat_j_g: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Thermal:
        if not 500.0 < self.solidus_k <= self.liquidus_k:
            raise ValueError(f"needs 500 < solidus_k <= liquidus_k (has {self.solidus_k}, {self.liquidus_k})")
        return self


class Head(Facts):
    """Laser and powder jet of the head with this powder: what single tracks are calibrated with. The spot is the tool's diameter."""

    absorptivity: Fraction = Field(description="share of the laser power that heats pool and powder")
    beam_half_angle_deg: NotNegative = Field(lt=45, description="by which the spot's radius grows off focus")
    jet_diameter_mm: Positive = Field(description="of the powder jet at its focus, to 1/e2 of the peak")
    jet_half_angle_deg: NotNegative = Field(lt=60, description="by which the jet's radius grows off focus")
    sticking: Fraction = Field(description="share of the powder landing in the melt pool that stays there")
    powder_cooling: Fraction = Field(
        description="share of the added height by which the melted depth falls short of that without powder"
    )


class PartHeat(Facts):
    """Lumped heat balance of part and plate between passes."""

    ambient_k: Positive
    plate_heat_capacity_j_k: Positive = Field(
        description="of plate and what is bolted to it, as far as it follows within minutes"
    )
    plate_conductance_w_k: Positive = Field(description="from plate into table")
    convection_w_m2_k: NotNegative
    emissivity: Fraction


class Price(Facts):
    """What the powder costs, as the shop bought it."""

    per_kg: NotNegative = Field(description="currency per kilogram that is fed")
    currency: str = Field(min_length=1, max_length=8, description="e.g. EUR; the same as that of the cell's rates")


class Material(Facts):
    """One powder."""

    schema_version: int = Field(ge=1, le=1)
    name: str
    density_g_mm3: Positive
    source: dict[str, str] = Field(description="field or group -> where its figures come from")
    bead: Bead
    deposition: Deposition
    milling: Milling
    thermal: Thermal
    head: Head
    part_heat: PartHeat
    price: Price | None = Field(None, description="none: estimates show no cost")

    @model_validator(mode="after")
    def _sourced(self) -> Material:
        groups = {"density_g_mm3", "bead", "deposition", "milling", "thermal", "head", "part_heat"}
        if self.price is not None:
            groups.add("price")
        missing = sorted(groups - {key.split(".")[0] for key in self.source})
        if missing:
            raise ValueError(f"source: no origin stated for {', '.join(missing)}")
        return self


def load_material(name: str) -> Material:
    """Material by path or shipped name. Raises ConfigError."""
    return read_facts(Material, find_facts("materials", name))
