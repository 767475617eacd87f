"""Whether a job can be made on a cell: the part's box in the build volume, powder, set-points, processes and tools.

What is refused here, planning, posting or the start would refuse for certain, as far as a box tells. What a box cannot tell (a turned part's
true width, the reach beside a clamp) is left to planning.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec

Three = tuple[float, float, float]
Frame = tuple[Three, Three, Three]
"""Rows of a rotation: build_from_part."""
AXES = "XYZ"
SLACK_MM = 1e-6
SAME_DIAMETER_MM = 0.01
DEPOSITS, MILLS = frozenset({"deposit", "hybrid"}), frozenset({"mill", "hybrid"})
CUTTERS = {"end_mill": "end mill", "bull_nose": "bull nose", "ball_mill": "ball mill"}


class ToolFacts(msgspec.Struct, frozen=True):
    """A tool as it is mounted. kind : as the cell file says; diameter_mm : of the cutter, or the spot"""

    number: int
    kind: str
    diameter_mm: float
    max_rpm: float


class CellFacts(msgspec.Struct, frozen=True):
    """What a cell offers.

    volume_min_mm, volume_max_mm : box in which metal may be, table frame    part_origin_mm, rotation_deg : of the build frame in it
    materials : powders that it may be fed; None: every one that its laser and feeder manage
    most : greatest set-point that its devices take, by field: laser_w (W), powder_g_min (g/min), carrier_gas_l_min, shield_gas_l_min (L/min)
    gate : of the laser, stream or modbus; dialect : of its control
    """

    cell: str
    volume_min_mm: Three
    volume_max_mm: Three
    part_origin_mm: Three
    rotation_deg: float
    tools: tuple[ToolFacts, ...]
    materials: tuple[str, ...] | None = None
    most: dict[str, float] = {}
    gate: str = ""
    dialect: str = ""


class Cutting(msgspec.Struct, frozen=True):
    """A cutter that is asked for. field : of the recipe; kinds : that will do, the first that is mounted is taken; rpm : at the material's speed"""

    field: str
    diameter_mm: float
    kinds: tuple[str, ...]
    rpm: float


class SetPoint(msgspec.Struct, frozen=True):
    """The least that a device has to give. because : whose figure it is"""

    field: str
    least: float
    unit: str
    because: str


class JobNeeds(msgspec.Struct, frozen=True):
    """What a job asks of a cell.

    size_mm : of the part's box, part frame    frames : in which it may be built, any of them; is_open : others may be found by planning
    shift_mm : of the part off the plate's middle, None: decided with the plan
    """

    process: str
    material: str
    size_mm: Three
    frames: tuple[Frame, ...]
    is_open: bool = False
    shift_mm: tuple[float, float] | None = None
    cutters: tuple[Cutting, ...] = ()
    set_points: tuple[SetPoint, ...] = ()


def facts_from(document: dict[str, Any]) -> CellFacts | None:
    """Facts as a service told them; None where a service of another version told them otherwise."""
    try:
        return msgspec.convert(document, CellFacts)
    except msgspec.ValidationError:
        return None


def why_not(needs: JobNeeds, cell: CellFacts) -> str:
    """Why a job cannot be made on a cell, in one line with field, value, bound and unit; empty if it fits."""
    return (
        _processes(needs, cell) or _material(needs, cell) or _set_points(needs, cell) or _tools(needs, cell) or _room(needs, cell)
    )


def _processes(needs: JobNeeds, cell: CellFacts) -> str:
    kinds = {tool.kind for tool in cell.tools}
    if needs.process in DEPOSITS and "deposition" not in kinds:
        return f"process: asked {needs.process}, {cell.cell} has no deposition head"
    if needs.process in MILLS and not kinds & set(CUTTERS):
        return f"process: asked {needs.process}, {cell.cell} has no cutter in a spindle"
    return ""


def _material(needs: JobNeeds, cell: CellFacts) -> str:
    if needs.process in DEPOSITS and cell.materials is not None and needs.material not in cell.materials:
        return f"material: asked {needs.material}, {cell.cell} is fed {', '.join(cell.materials) or 'no powder'} only"
    return ""


def _set_points(needs: JobNeeds, cell: CellFacts) -> str:
    for one in needs.set_points:
        most = cell.most.get(one.field, math.inf)
        if one.least > most:
            return f"{one.field}: {one.because} asks at least {one.least:g} {one.unit}, {cell.cell} gives at most {most:g} {one.unit}"
    return ""


def _tools(needs: JobNeeds, cell: CellFacts) -> str:
    for cutting in needs.cutters:
        found = next(
            (
                tool
                for kind in cutting.kinds
                for tool in cell.tools
                if tool.kind == kind and abs(tool.diameter_mm - cutting.diameter_mm) <= SAME_DIAMETER_MM
            ),
            None,
        )
        if found is None:
            kinds = " or ".join(CUTTERS[kind] for kind in cutting.kinds)
            return f"{cutting.field}: asked {cutting.diameter_mm:g} mm, {cell.cell} has no {kinds} of that diameter; it has {_listed(cell)}"
        if cutting.rpm > found.max_rpm:
            asked = f"{cutting.field}: {cutting.diameter_mm:g} mm in {needs.material} asks {cutting.rpm:g} 1/min"
            return f"{asked}, tool {found.number} of {cell.cell} allows {found.max_rpm:g} 1/min"
    return ""


def _listed(cell: CellFacts) -> str:
    return ", ".join(f"{CUTTERS[tool.kind]} {tool.diameter_mm:g} mm" for tool in cell.tools if tool.kind in CUTTERS) or "none"


def _room(needs: JobNeeds, cell: CellFacts) -> str:
    """Empty if the part may have room in one of its frames; else what hinders it in the first."""
    told = [_room_in(needs, cell, frame) for frame in needs.frames]
    if not all(told):
        return ""
    if needs.is_open:
        longest, diagonal = max(needs.size_mm), math.dist(cell.volume_min_mm, cell.volume_max_mm)
        return told[0] if longest > diagonal + SLACK_MM else ""
    return told[0]


def _room_in(needs: JobNeeds, cell: CellFacts, frame: Frame) -> str:
    angle = math.radians(cell.rotation_deg)
    cos, sin = math.cos(angle), math.sin(angle)
    x, y, z = frame
    turned = (_sum(x, cos, y, -sin), _sum(x, sin, y, cos), z)
    least = [least_width(row, needs.size_mm) for row in turned]
    for k in range(3):
        room = cell.volume_max_mm[k] - cell.volume_min_mm[k]
        if least[k] > room + SLACK_MM:
            return f"size: the part is {least[k]:.1f} mm in {AXES[k]} on the table, the build volume of {cell.cell} {room:.1f} mm"
    over = cell.part_origin_mm[2] + least[2] - cell.volume_max_mm[2]
    if over > SLACK_MM:
        above = cell.volume_max_mm[2] - cell.part_origin_mm[2]
        return f"height: the part is {least[2]:.1f} mm in Z, above the plate of {cell.cell} are {above:.1f} mm"
    return "" if needs.shift_mm is None else _beside(needs.shift_mm, least, cell, (cos, sin))


def _beside(shift_mm: tuple[float, float], width: list[float], cell: CellFacts, turn: tuple[float, float]) -> str:
    cos, sin = turn
    moved = (cos * shift_mm[0] - sin * shift_mm[1], sin * shift_mm[0] + cos * shift_mm[1])
    for k in range(2):
        middle = cell.part_origin_mm[k] + moved[k]
        low, high = middle - 0.5 * width[k], middle + 0.5 * width[k]
        bounds = cell.volume_min_mm[k], cell.volume_max_mm[k]
        if low < bounds[0] - SLACK_MM or high > bounds[1] + SLACK_MM:
            return (
                f"shift_mm: the part lies at {low:.1f} … {high:.1f} mm in {AXES[k]} on the table, "
                f"the build volume of {cell.cell} is {bounds[0]:.1f} … {bounds[1]:.1f} mm"
            )
    return ""


def least_width(direction: Three, size_mm: Three) -> float:
    """mm   The least that a body is wide along a unit direction if its box has this size: it touches all six faces of the box.

    Along an axis of the box it is the box's own size; along others less is known. Its two points on the faces across axis i differ by
    size_i along i, and by no more than the box along the others.
    """
    shares = [abs(value) * size for value, size in zip(direction, size_mm, strict=True)]
    return max(0.0, 2.0 * max(shares) - sum(shares))


def _sum(first: Three, a: float, second: Three, b: float) -> Three:
    x, y, z = (a * one + b * other for one, other in zip(first, second, strict=True))
    return x, y, z
