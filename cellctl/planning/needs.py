"""What a job needs of a cell, from its part's box, its recipe and its material; and what a cell offers, from its file."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cellctl.domain.fitting import MILLS, CellFacts, Cutting, Frame, JobNeeds, SetPoint, Three, ToolFacts
from config import Cell, Material
from config.device import load_device
from planner.recipe import Recipe

UPRIGHT: tuple[Three, ...] = (
    (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0),
)  # fmt: skip
"""The axes of the part; `planner.decompose.direction` tries these first where the recipe leaves the direction open."""
FACING, WALLS, SCALLOPS = ("end_mill", "bull_nose"), ("end_mill", "bull_nose", "ball_mill"), ("ball_mill",)
REGISTERS = {
    "laser_w": ("laser", "power_setpoint"),
    "powder_g_min": ("feeder", "rate_setpoint"),
    "carrier_gas_l_min": ("feeder", "carrier_gas_setpoint"),
    "shield_gas_l_min": ("feeder", "shield_gas_setpoint"),
}


def facts_of(cell: Cell) -> CellFacts:
    """What a cell offers, as it stands. Raises ConfigError for a device map that cannot be read."""
    maps = {name: load_device(link.device).registers for name, link in cell.links.items()}
    greatest = {field: maps[device][name].max for field, (device, name) in REGISTERS.items() if device in maps}
    return CellFacts(
        cell=cell.name,
        volume_min_mm=cell.build_volume.min_mm,
        volume_max_mm=cell.build_volume.max_mm,
        part_origin_mm=cell.placement.part_origin_mm,
        rotation_deg=cell.placement.rotation_deg,
        tools=tuple(ToolFacts(tool.number, tool.kind, tool.diameter_mm, tool.max_rpm) for tool in cell.tools),
        materials=cell.materials,
        most={field: most for field, most in greatest.items() if most is not None},
        gate="modbus" if cell.cnc.laser_gate_output is None else "stream",
        dialect=cell.cnc.firmware,
    )


def needs_of(bbox_mm: Sequence[Sequence[float]], recipe: Recipe, material: Material) -> JobNeeds:
    """What a job asks of a cell.  bbox_mm : (2, 3) lowest and highest corner of the part, part frame"""
    low, high = bbox_mm
    x, y, z = (float(b) - float(a) for a, b in zip(low, high, strict=True))
    is_open = recipe.build_direction == "auto"
    directions = UPRIGHT if recipe.build_direction == "auto" else (_unit(recipe.build_direction),)
    shift = recipe.shift_mm
    if shift == "auto":  # only what grows sideways moves the part off the middle, and that is another piece
        shift = (0.0, 0.0) if recipe.process == "mill" or recipe.decompose == "never" else "auto"
    return JobNeeds(
        process=recipe.process,
        material=recipe.material,
        size_mm=(x, y, z),
        frames=tuple(frame_of(direction, recipe.turn_deg) for direction in directions),
        is_open=is_open,
        shift_mm=None if shift == "auto" else shift,
        cutters=_cutters(recipe, material) if recipe.process in MILLS else (),
        set_points=_set_points(recipe, material) if recipe.process != "mill" else (),
    )


def _cutters(recipe: Recipe, material: Material) -> tuple[Cutting, ...]:
    """Those that the recipe names, and the material's usual one: each part's last top is faced with it."""
    asked = (
        ("cutter_diameter_mm", recipe.cutter_diameter_mm or material.milling.cutter_diameter_mm, FACING),
        ("small_cutter_diameter_mm", recipe.small_cutter_diameter_mm, WALLS),
        ("ball_cutter_diameter_mm", recipe.ball_cutter_diameter_mm, SCALLOPS),
    )
    speed = 1000.0 * material.milling.cutting_speed_m_min / math.pi
    return tuple(Cutting(field, diameter, kinds, round(speed / diameter, 0)) for field, diameter, kinds in asked if diameter is not None)


def _set_points(recipe: Recipe, material: Material) -> tuple[SetPoint, ...]:
    window = material.deposition
    power = max(window.laser_w.min, material.bead.min_power_w) if recipe.laser_w is None else recipe.laser_w
    powder = window.powder_g_min.min if recipe.powder_g_min is None else recipe.powder_g_min
    return (
        SetPoint("laser_w", power, "W", material.name if recipe.laser_w is None else "the recipe"),
        SetPoint("powder_g_min", powder, "g/min", material.name if recipe.powder_g_min is None else "the recipe"),
        SetPoint("carrier_gas_l_min", window.carrier_gas_l_min.usual, "L/min", material.name),
        SetPoint("shield_gas_l_min", window.shield_gas_l_min.usual, "L/min", material.name),
    )


def frame_of(direction: Three, turn_deg: float) -> Frame:
    """build_from_part as a rotation: z along the unit direction, x as the planner lays it, turned counter-clockwise about z.

    Source: `planner.decompose.direction.build_frame`, which this agrees with; that one needs the mesh, and the planner's memory.
    """
    wx, wy, wz = direction
    u = (1.0 - wx * wx, -wy * wx, -wz * wx) if abs(wx) < 0.9 else (-wx * wy, 1.0 - wy * wy, -wz * wy)
    length = math.sqrt(sum(value * value for value in u))
    ux, uy, uz = (value / length for value in u)
    vx, vy, vz = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
    cos, sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    first = (cos * ux - sin * vx, cos * uy - sin * vy, cos * uz - sin * vz)
    second = (sin * ux + cos * vx, sin * uy + cos * vy, sin * uz + cos * vz)
    return first, second, direction


def _unit(asked: Three) -> Three:
    length = math.sqrt(sum(value * value for value in asked))
    x, y, z = (value / length if length > 0.0 else value for value in asked)  # a direction without length is the planner's to refuse
    return x, y, z
