"""Collisions at analytically known lines and depths; nothing is tunnelled through, nothing free is called a hit."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from config import Cell, MachineGeometry, Solid, load_cell, load_material
from sim.cnc.chain import Chain
from sim.machine import Hit, Machine
from sim.process.stock import Stock
from sim.trace import Trace

CELL = load_cell("trunnion_tcp")
TOP = -420.0  # of the plate, machine frame
BUILD = np.eye(4)
BUILD[2, 3] = -TOP
HEAD, D8 = 1, 2


def cell_with(*solids: Solid, clamps: int = 0, **more: object) -> Cell:
    machine = MachineGeometry.model_validate({"solids": solids, "clamps": {"count": clamps}, "parked_offset_mm": (0.0, 0.0, 150.0), **more})
    return CELL.model_copy(update={"machine": machine})


def block(name: str, carrier: str, at: tuple[float, float, float], size: tuple[float, float, float]) -> Solid:
    return Solid.model_validate({"name": name, "carrier": carrier, "shape": "box", "at_mm": at, "size_mm": size})


def stock_of(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]], cell_mm: float = 0.25) -> Stock:
    """Metal in the build frame: boxes by two corners."""
    every = np.array(boxes, dtype=float)
    stock = Stock(np.array([every[:, 0].min(axis=0), every[:, 1].max(axis=0)]), cell_mm, load_material("316L"))
    for box in every:
        stock.fill_box(box)
    return stock


def tip_at(cell: Cell, tool: int, *places: tuple[float, ...]) -> np.ndarray:
    """Joints that bring a tool's tip to places (x, y, z, and A, C if given) of the build frame with the table at zero."""
    tip = np.array(next(each.tip_mm for each in cell.tools if each.number == tool))
    table = np.array([0.0, 0.0, TOP])
    return np.array([[*(np.array(place[:3]) + table - tip), *(place[3:] or (0.0, 0.0))] for place in places])


def trace_of(cell: Cell, tool: int, joints: np.ndarray, lines: list[int], emission: float = 0.0) -> Trace:
    chain, count = Chain(cell), len(joints) - 1
    tips, axes = chain.tip_and_axis_in_table(joints, tool)
    full = np.full(count, emission)
    return Trace(
        tip0=tips[:-1], tip1=tips[1:], axis0=axes[:-1], axis1=axes[1:], down=np.tile([0.0, 0.0, -1.0], (count, 1)), emission_w=full,
        powder_g_min=full, dt=np.full(count, 0.05), line=np.array(lines), joints0=joints[:-1].copy(), joints1=joints[1:].copy(), tool=tool,
        spindle_rpm=0.0, head_deployed=tool == HEAD,
    )  # fmt: skip


def hits_of(cell: Cell, tool: int, joints: np.ndarray, stock: Stock, slide: float | None = None) -> list[Hit]:
    machine = Machine(cell, Chain(cell), BUILD)
    lines = [10 * (n + 1) for n in range(len(joints) - 1)]
    return machine.check(trace_of(cell, tool, joints, lines), stock, float(tool == HEAD) if slide is None else slide)


AWAY = ((-60.0, -60.0, -12.0), (60.0, 60.0, -10.0))  # a sheet of metal far from everything


def test_nozzle_driven_into_a_wall_is_a_hit_at_its_line_and_as_deep_as_it_goes() -> None:
    stock = stock_of(((20.0, -30.0, 0.0), (26.0, 30.0, 30.0)))
    # The nozzle's end (12 wide) is 13 above the tip and widens with 19 on 60: at the wall's top, 17 higher, it is 6 + 17 * 19 / 60 wide.
    wide = 6.0 + 17.0 * 19.0 / 60.0
    joints = tip_at(CELL, HEAD, (0, 0, 0), (20 - wide - 0.6, 0, 0), (20 - wide + 1.5, 0, 0))
    hits = hits_of(cell_with(), HEAD, joints, stock)
    assert [(hit.line, hit.moving, hit.other, hit.tool) for hit in hits] == [(20, "nozzle", "stock", HEAD)]
    slope = np.cos(np.arctan2(19.0, 60.0))
    assert hits[0].depth_mm == pytest.approx(1.5 * slope, abs=0.15)
    assert hits[0].at_mm == pytest.approx([20.0, 0.0, 30.0], abs=2.0)


def test_half_a_millimetre_beside_a_wall_is_free_and_told_as_clearance() -> None:
    stock = stock_of(((20.0, -30.0, 0.0), (26.0, 30.0, 40.0)))
    cell = cell_with()
    machine = Machine(cell, Chain(cell), BUILD)
    x = 20.0 - 4.0 - 0.5  # the D8's holder has 16, its shank 3.75, its flutes 4
    joints = tip_at(cell, D8, (x, -20, 2), (x, 20, 2))
    assert machine.check(trace_of(cell, D8, joints, [1]), stock, 0.0) == []
    assert machine.clearance_mm == pytest.approx(0.75, abs=0.05)
    assert machine.nearest is not None and (machine.nearest.moving, machine.nearest.other) == ("T2 shank", "stock")


def test_holder_meets_the_wall_of_a_pocket_deeper_than_the_cutter_sticks_out() -> None:
    stock = stock_of(((6.0, -30.0, 0.0), (40.0, 30.0, 50.0)))
    # Sticking out 40, at z = 20 the holder (radius 16) is above the wall; at z = 8 it reaches 2 mm into it.
    joints = tip_at(CELL, D8, (0, 0, 20), (0, 0, 11), (0, 0, 8))
    hits = hits_of(cell_with(), D8, joints, stock)
    assert [(hit.line, hit.moving, hit.other) for hit in hits] == [(20, "T2 holder", "stock")]
    assert hits[0].depth_mm == pytest.approx(2.0, abs=0.1)


def test_flutes_may_cut_the_stock_and_the_plate_a_little_but_no_clamp() -> None:
    cell = cell_with(clamps=4)
    stock = stock_of(((-5.0, -30.0, 0.0), (5.0, 30.0, 20.0)))
    assert hits_of(cell, D8, tip_at(cell, D8, (0, 0, 25), (0, 0, -0.4)), stock) == []
    deep = hits_of(cell, D8, tip_at(cell, D8, (30, 0, 5), (30, 0, -1.0)), stock)
    assert [(hit.moving, hit.other) for hit in deep] == [("T2 flutes", "plate")]
    assert deep[0].depth_mm == pytest.approx(1.0, abs=0.01)
    clamp = hits_of(cell, D8, tip_at(cell, D8, (40, 0, 6.5), (58, 0, 6.5), (58, 0, 30)), stock_of(AWAY))
    assert (clamp[0].line, clamp[0].moving, clamp[0].other) == (10, "T2 flutes", "clamp 1")
    assert clamp[0].depth_mm == pytest.approx(1.5, abs=0.01)  # the clamp stands 8 above the plate


def test_table_tilted_until_it_hits_the_head_is_a_hit_where_the_angle_says() -> None:
    table = block("table", "A", (0.0, 0.0, -440.0), (200.0, 200.0, 20.0))
    ram = block("ram", "spindle", (0.0, 0.0, 100.0), (60.0, 60.0, 200.0))
    cell = cell_with(table, ram)
    # The ram's lower front edge is at y = -30, z = -350 - ...; the table's far edge swings up about (y, z) = (0, -450).
    height = 60.0  # of the ram's end above the axis
    angle = np.radians(np.arange(0.0, 91.0, 0.01))
    # top edge of the table at (y, z) = (100, 20) about the pivot, turned by A' = -A about +x: it lifts one of its edges.
    y, z = -(100.0 * np.cos(angle) - 20.0 * np.sin(angle)), 100.0 * np.sin(angle) + 20.0 * np.cos(angle)
    first = np.degrees(angle[np.flatnonzero((z > height) & (y > -100.0) & (y < -40.0))[0]])
    tilts = np.array([0.0, *(np.floor(first) + np.arange(-2.0, 3.0))])  # in one go almost there, then degree by degree
    lines = []
    for sign in (-1.0, 1.0):
        joints = np.array([[0.0, -70.0, -450.0 + height, sign * tilt, 0.0] for tilt in tilts])
        hits = hits_of(cell, 0, joints, stock_of(((-2.0, -2.0, -6.0), (2.0, 2.0, -4.0))), slide=0.0)
        lines += [hit.line // 10 for hit in hits if {hit.moving, hit.other} == {"ram", "table"}]
    assert tilts[min(lines) - 1] - 1e-9 <= first <= tilts[min(lines)]


def test_fast_move_through_a_thin_wall_does_not_tunnel() -> None:
    wall = ((9.9, -30.0, 0.0), (10.3, 30.0, 40.0))
    joints = tip_at(CELL, HEAD, (-100, 0, 0), (100, 0, 0))
    assert [hit.other for hit in hits_of(cell_with(), HEAD, joints, stock_of(wall)) if hit.moving == "nozzle"] == ["stock"]
    sheet = block("sheet", "base", (10.0, 0.0, TOP + 20.0), (0.3, 60.0, 40.0))
    hits = hits_of(cell_with(sheet), HEAD, joints, stock_of(AWAY))
    assert ("nozzle", "sheet") in [(hit.moving, hit.other) for hit in hits]


def test_a_full_turn_of_the_table_in_one_piece_does_not_tunnel() -> None:
    post = block("post", "C", (80.0, 0.0, TOP + 30.0), (2.0, 2.0, 60.0))
    joints = tip_at(CELL, HEAD, (0, 75, 5), (0, 75, 5))
    joints[1, 4] = 360.0
    hits = hits_of(cell_with(post), HEAD, joints, stock_of(AWAY))
    assert [(hit.moving, hit.other) for hit in hits] == [("nozzle", "post")]


def test_the_parked_head_comes_down_on_what_stands_under_it() -> None:
    cell = cell_with()
    stock = stock_of(((20.0, -40.0, 0.0), (100.0, 40.0, 16.0)))
    joints = tip_at(cell, HEAD, (60, 0, 0), (60, 0, 0))
    machine = Machine(cell, Chain(cell), BUILD)
    assert machine.check(trace_of(cell, D8, joints, [1]), stock, 0.0) == []
    hits = machine.check(trace_of(cell, D8, joints, [2]), stock, 1.0)
    assert [(hit.line, hit.moving, hit.other) for hit in hits if hit.moving == "nozzle"] == [(2, "nozzle", "stock")]
    assert max(hit.depth_mm for hit in hits) == pytest.approx(3.0, abs=0.1)  # its end stands 13 above the focus


def test_metal_laid_after_the_nozzle_was_measured_is_met_by_it() -> None:
    cell = cell_with()
    stock = stock_of(((-40.0, -10.0, -4.0), (40.0, 10.0, 0.0)), ((-40.0, -1.0, 18.0), (-39.0, 1.0, 19.0)))
    machine = Machine(cell, Chain(cell), BUILD)
    joints = tip_at(cell, HEAD, *[(x, 0, 0) for x in np.arange(-5, 5.5, 0.5)])
    lines = list(range(len(joints) - 1))
    assert machine.check(trace_of(cell, HEAD, joints, lines, 800.0), stock, 1.0) == []
    stock.fill_box(np.array([[-4.0, -2.0, 0.0], [4.0, 2.0, 4.0]]))
    back = tip_at(cell, HEAD, (5, 0, 0), (0, 0, -10))
    hits = machine.check(trace_of(cell, HEAD, back, [99]), stock, 1.0)
    assert ("nozzle", "stock", 99) in [(hit.moving, hit.other, hit.line) for hit in hits]


def test_an_stl_meets_what_its_analytic_twin_meets(tmp_path: Path) -> None:
    trimesh.creation.box((30, 40, 20)).export(tmp_path / "jaw.stl")
    joints = tip_at(CELL, HEAD, (0, 0, 0), (20, 0, 0), (45, 0, 0))
    drawn = {"name": "jaw", "carrier": "C", "at_mm": (60.0, 0.0, TOP + 10.0)}
    found = []
    for shape in ({"shape": "stl", "file": str(tmp_path / "jaw.stl")}, {"shape": "box", "size_mm": (30.0, 40.0, 20.0)}):
        hits = hits_of(cell_with(Solid.model_validate({**drawn, **shape})), HEAD, joints, stock_of(AWAY))
        found.append([(hit.line, hit.moving, hit.other, round(hit.depth_mm, 2)) for hit in hits])
    assert found[0] == found[1] and [hit[:3] for hit in found[0]] == [(20, "nozzle", "jaw")]


def test_what_touches_as_drawn_is_told_and_only_the_file_excuses_it() -> None:
    solids = (block("rail", "base", (0, 0, 300), (400, 40, 40)), block("slide", "X", (0, 0, 330), (60, 60, 40)))
    assert Machine(cell_with(*solids), Chain(CELL), BUILD).touching == (("rail", "slide"),)
    excused = cell_with(*solids, ignore=(("slide", "rail"),))
    machine = Machine(excused, Chain(CELL), BUILD)
    assert machine.touching == () and machine.ignored == (("slide", "rail"),)
    assert hits_of(excused, HEAD, tip_at(CELL, HEAD, (0, 0, 50), (10, 0, 50)), stock_of(AWAY)) == []


def test_a_restored_machine_goes_on_as_if_it_had_never_stopped() -> None:
    cell, stock = cell_with(), stock_of(((20.0, -30.0, 0.0), (26.0, 30.0, 30.0)))
    way = tip_at(cell, HEAD, *[(0.4 * n, 0, 0) for n in range(40)])
    one, other = Machine(cell, Chain(cell), BUILD), Machine(cell, Chain(cell), BUILD)
    one.check(trace_of(cell, HEAD, way[:20], list(range(19))), stock, 1.0)
    other.restore(one.snapshot())
    rest = trace_of(cell, HEAD, way[19:], list(range(100, 120)))
    first, second = one.check(rest, stock, 1.0), other.check(rest, stock, 1.0)
    assert first and [hit[:5] for hit in first] == [hit[:5] for hit in second]
    assert one.clearance_mm == other.clearance_mm


@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu", "head_table", "head_head"])
def test_nothing_of_a_shipped_cell_overlaps_as_drawn(name: str) -> None:
    cell = load_cell(name)
    machine = Machine(cell, Chain(cell), BUILD)
    assert machine.is_drawn and machine.touching == ()


def test_a_cell_without_geometry_checks_nothing_and_says_so() -> None:
    cell = CELL.model_copy(update={"machine": None})
    machine = Machine(cell, Chain(cell), BUILD)
    assert not machine.is_drawn
    assert machine.check(trace_of(cell, HEAD, tip_at(cell, HEAD, (0, 0, 0), (0, 0, -50)), [1]), stock_of(AWAY), 1.0) == []
