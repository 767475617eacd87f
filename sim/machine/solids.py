"""From the cell's facts to solids: what the file draws, the nozzle, cutters with shank and holder, the plate and its clamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from config import Cell, ConfigError, MachineGeometry, Solid, Tool
from sim.machine.bodies import BOX, FRUSTUM, HULL, MESH, Body
from sim.machine.facets import Shell, hull_shell, read_shells

Array = NDArray[np.float64]

ROUND_CORNERS = 48  # of a cutter's end with rounded corners: 0.02 mm on a radius of 10
ARC_STEPS = 8
EDGES = {0: (), 2: ((1.0, 0.0), (-1.0, 0.0)), 4: ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))}


def bodies_of(cell: Cell, carriers: dict[str, int]) -> list[Body]:
    """All solids of a cell. carriers : number of each link by name. Raises ConfigError for an STL or a carrier that is no good."""
    if cell.machine is None:
        return []
    bodies = [body for solid in cell.machine.solids for body in _drawn(solid, carriers)]
    heads = sum(tool.kind == "deposition" for tool in cell.tools)
    for tool in cell.tools:
        bodies += _head(tool, heads > 1, carriers["head_slide"]) if tool.kind == "deposition" else _cutter(tool, carriers["spindle"])
    bodies += _clamped(cell, cell.machine, carriers["table"])
    return bodies


def _drawn(solid: Solid, carriers: dict[str, int]) -> list[Body]:
    """A solid of the file; an STL of several bodies becomes several."""
    if solid.carrier not in carriers:
        raise ConfigError(f"machine.solids {solid.name}: the cell has no axis {solid.carrier}", f"carriers: {', '.join(carriers)}")
    carrier = carriers[solid.carrier]
    if solid.shape == "box":
        assert solid.size_mm is not None
        x, y, z = solid.size_mm
        return [Body(solid.name, carrier, BOX, (0.5 * x, 0.5 * y, 0.5 * z), _pose(_turn(solid.turn_deg), solid.at_mm))]
    if solid.shape == "stl":
        pose = _pose(_turn(solid.turn_deg), solid.at_mm)
        return [_faceted(solid.name, carrier, shell, pose) for shell in read_shells(solid.file, solid.name)]
    assert solid.diameter_mm is not None and solid.length_mm is not None
    end = solid.diameter_mm if solid.end_diameter_mm is None else solid.end_diameter_mm
    size = (0.5 * solid.diameter_mm, 0.5 * end, solid.length_mm)
    return [Body(solid.name, carrier, FRUSTUM, size, _pose(_upright(solid.axis), solid.at_mm))]


def _faceted(name: str, carrier: int, shell: Shell, pose: Array, *, cuts: bool = False, tool: int = 0) -> Body:
    return Body(name, carrier, HULL if shell.is_convex else MESH, (0.0, 0.0, 0.0), pose, shell, cuts, tool)


def _head(tool: Tool, is_numbered: bool, carrier: int) -> list[Body]:
    """Cone and body of a deposition head, from its focus upwards."""
    x, y, z = tool.tip_mm
    shape, wide = tool.nozzle, 0.5 * tool.holder_diameter_mm
    mark = f" {tool.number}" if is_numbered else ""
    end = z + shape.standoff_mm
    cone = (0.5 * shape.end_diameter_mm, wide, shape.cone_length_mm)
    return [
        Body(f"nozzle{mark}", carrier, FRUSTUM, cone, _pose(np.eye(3), (x, y, end))),
        Body(f"head body{mark}", carrier, FRUSTUM, (wide, wide, shape.body_length_mm), _pose(np.eye(3), (x, y, end + shape.cone_length_mm))),
    ]


def _cutter(tool: Tool, carrier: int) -> list[Body]:
    """Flutes, shank and holder of a cutter; the holder ends at the gauge line."""
    x, y, z = tool.tip_mm
    radius, number = 0.5 * tool.diameter_mm, tool.number
    flutes = min(tool.flute_length_mm or tool.stickout, tool.stickout)
    shank = radius if tool.shank_diameter_mm is None else 0.5 * tool.shank_diameter_mm
    parts = [
        ("shank", shank, flutes, tool.stickout),
        ("holder", 0.5 * tool.holder_diameter_mm, tool.stickout, -z),
    ]
    if tool.corner_radius_mm > 0.0:
        shell = hull_shell(_revolved(radius, tool.corner_radius_mm, flutes))
        bodies = [_faceted(f"T{number} flutes", carrier, shell, _pose(np.eye(3), tool.tip_mm), cuts=True, tool=number)]
    else:
        bodies = [Body(f"T{number} flutes", carrier, FRUSTUM, (radius, radius, flutes), _pose(np.eye(3), tool.tip_mm), None, True, number)]
    for what, wide, low, high in parts:
        if high > low:
            pose = _pose(np.eye(3), (x, y, z + low))
            bodies.append(Body(f"T{number} {what}", carrier, FRUSTUM, (wide, wide, high - low), pose, None, False, number))
    return bodies


def _revolved(radius: float, corner: float, length: float) -> Array:
    """(n, 3) mm   Points on a cutter's end with rounded corners (a ball where the corner is the radius)."""
    angle = 0.5 * np.pi * np.arange(ARC_STEPS + 1) / ARC_STEPS
    profile = np.column_stack((radius - corner + corner * np.sin(angle), corner - corner * np.cos(angle)))
    profile = np.vstack((profile, [[radius, length]]))
    turn = 2.0 * np.pi * np.arange(ROUND_CORNERS) / ROUND_CORNERS
    rings = [np.column_stack((r * np.cos(turn), r * np.sin(turn), np.full(len(turn), z))) for r, z in profile]
    return np.unique(np.vstack(rings).round(9), axis=0)


def _clamped(cell: Cell, machine: MachineGeometry, carrier: int) -> list[Body]:
    """The plate, and the toe clamps at the middles of its edges."""
    size, top = np.array(cell.plate.size_mm), np.array(cell.plate.top_mm)
    bodies = [_box("plate", carrier, top - [0.0, 0.0, 0.5 * size[2]], 0.5 * size)]
    clamps = machine.clamps
    half_deep, half_high = 0.5 * (clamps.overlap_mm + clamps.outside_mm), 0.5 * (clamps.above_mm + size[2])
    out = 0.5 * (clamps.outside_mm - clamps.overlap_mm)
    for number, (x, y) in enumerate(EDGES[clamps.count], start=1):
        edge = abs(x) * 0.5 * size[0] + abs(y) * 0.5 * size[1]
        middle = top + np.array([x * (edge + out), y * (edge + out), half_high - size[2]])
        half = np.array([half_deep, 0.5 * clamps.width_mm, half_high] if x else [0.5 * clamps.width_mm, half_deep, half_high])
        bodies.append(_box(f"clamp {number}", carrier, middle, half))
    return bodies


def _box(name: str, carrier: int, middle: Array, half: Array) -> Body:
    return Body(name, carrier, BOX, (float(half[0]), float(half[1]), float(half[2])), _pose(np.eye(3), tuple(middle)))


def _pose(rotation: Array, at: tuple[float, ...]) -> Array:
    return np.ascontiguousarray(np.column_stack((rotation, np.asarray(at, dtype=np.float64))))


def _turn(turn_deg: tuple[float, float, float]) -> Array:
    """(3, 3)   About x, then y, then z of the machine."""
    a, b, c = np.radians(turn_deg)
    x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return np.asarray(z @ y @ x, dtype=np.float64)


def _upright(axis: tuple[float, float, float]) -> Array:
    """(3, 3)   A rotation that brings z to a direction."""
    z = np.asarray(axis, dtype=np.float64)
    z = z / np.linalg.norm(z)
    side = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(side, z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))
