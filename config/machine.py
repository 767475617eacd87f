"""Facts about a machine's shape: solids on its links, the clamps on its plate, and which of them may touch."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from config.base import Facts, NotNegative, Positive, Vector3

Carrier = Literal["base", "X", "Y", "Z", "A", "B", "C", "spindle", "head_slide", "table"]
UNIT_TOLERANCE = 1e-6


class Solid(Facts):
    """One body of the machine. Its pose is given in the machine frame with all joints at zero (and the head's slide deployed).

    carrier : what moves it: "base" nothing; an axis letter: the link behind that joint; "spindle": the end of the head's chain;
        "head_slide": the same, and the slide of the deposition head; "table": the end of the table's chain.
    box : `at_mm` is its centre, `size_mm` its edges, turned by `turn_deg` about x, then y, then z of the machine
    cylinder, cone : `at_mm` is the centre of its first end; it goes on for `length_mm` along `axis`; `diameter_mm` at the first end,
        for a cone `end_diameter_mm` at the other
    stl : a closed mesh in mm; `at_mm` is where its origin is, turned by `turn_deg`. `file` is a path; a relative one starts at the cell's file.
    """

    name: str = Field(min_length=1)
    carrier: Carrier
    shape: Literal["box", "cylinder", "cone", "stl"]
    at_mm: Vector3 = (0.0, 0.0, 0.0)
    size_mm: tuple[Positive, Positive, Positive] | None = None
    diameter_mm: Positive | None = None
    end_diameter_mm: NotNegative | None = None
    length_mm: Positive | None = None
    axis: Vector3 = (0.0, 0.0, 1.0)
    turn_deg: Vector3 = (0.0, 0.0, 0.0)
    file: str = ""

    @model_validator(mode="after")
    def _has_what_its_shape_needs(self) -> Solid:
        needs = {
            "box": ("size_mm",), "cylinder": ("diameter_mm", "length_mm"), "cone": ("diameter_mm", "end_diameter_mm", "length_mm"), "stl": ("file",)
        }  # fmt: skip
        every = {name for names in needs.values() for name in names}
        given = {name for name in every if getattr(self, name) not in (None, "")}
        missing, foreign = set(needs[self.shape]) - given, given - set(needs[self.shape])
        if missing:
            raise ValueError(f"solid {self.name}: a {self.shape} needs {', '.join(sorted(missing))}")
        if foreign:
            raise ValueError(f"solid {self.name}: a {self.shape} has no {', '.join(sorted(foreign))}")
        length = sum(value * value for value in self.axis) ** 0.5
        if abs(length - 1.0) > UNIT_TOLERANCE:
            raise ValueError(f"solid {self.name}: axis must have length 1 (has {length:.6g})")
        return self


class Clamps(Facts):
    """Toe clamps that hold the plate: boxes at the middles of its edges, carried by the table."""

    count: Literal[0, 2, 4] = Field(4, description="2: on the edges across x")
    width_mm: Positive = Field(24.0, description="along the edge")
    overlap_mm: NotNegative = Field(8.0, description="onto the plate")
    outside_mm: Positive = Field(22.0, description="beside the plate")
    above_mm: Positive = Field(8.0, description="over the plate's top")


class MachineGeometry(Facts):
    """What can collide. Tools, nozzle, plate and clamps come in by themselves from `tools`, `simulation` and `clamps`.

    Bodies on one carrier never meet. All other pairs are watched but those in `ignore`: neighbours that touch by construction
    (a slide on its way) are named there. Names of what comes in by itself: "nozzle", "head body" (with the tool's number behind
    it where a cell has several heads), "T2 flutes", "T2 shank", "T2 holder", "plate", "clamp 1" to "clamp 4".
    """

    solids: tuple[Solid, ...] = ()
    ignore: tuple[tuple[str, str], ...] = Field((), description="pairs of names that may touch")
    clamps: Clamps = Clamps()
    parked_offset_mm: Vector3 = Field((0.0, 0.0, 0.0), description="way of the head's slide from deployed to parked, machine frame at joints zero")
    contact_mm: Positive = Field(0.1, description="bodies that overlap by less only touch: the rounding of stock and solids")
    plate_cut_mm: NotNegative = Field(0.5, description="how deep flutes may go into the plate")

    @model_validator(mode="after")
    def _names_once(self) -> MachineGeometry:
        names = [solid.name for solid in self.solids]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"machine: the name {twice[0]} stands twice")
        return self

    def beside(self, folder: Path) -> MachineGeometry:
        """The same with relative STL paths starting at `folder`."""
        solids = tuple(
            solid.model_copy(update={"file": str(folder / solid.file)}) if solid.shape == "stl" else solid for solid in self.solids
        )
        return self.model_copy(update={"solids": solids})


class ProofLimits(Facts):
    """Thresholds of the proof's verdict."""

    missing_share: Positive = Field(0.005, le=1, description="of the part's volume that may be missing")
    gouge_mm: Positive | None = Field(None, description="how deep a cut may go into the part; none: the job's tolerance")
    clearance_mm: NotNegative = Field(1.0, description="a warning where bodies come closer without touching")
    starved_share: Positive = Field(0.8, le=1, description="powder below this share of its set-point starves the bead")
    standstill_s: Positive = Field(0.02, description="the laser may be on at a standing tip for two ticks")
    stray_s: Positive = Field(0.005, description="light on a line that deposits nothing, beyond the laser's own ramp")
