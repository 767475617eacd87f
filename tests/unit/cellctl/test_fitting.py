"""Which jobs fit which cells, and that planning says the same."""

from __future__ import annotations

import itertools
from pathlib import Path

import msgspec
import numpy as np
import pytest
import tomli_w
import trimesh

from cellctl.domain.fitting import CellFacts, JobNeeds, ToolFacts, facts_from, least_width, why_not
from cellctl.planning.needs import facts_of, frame_of, needs_of
from cellctl.planning.stages import check_size
from config import Cell, load_cell, load_material
from config.base import FACTS_DIR
from planner.decompose.direction import build_frame
from planner.errors import PlannerError
from planner.mesh.mesh import Mesh, mesh_of
from planner.plan import Operation, Process
from planner.post.room import check_volume, table_from_build
from planner.post.tools import tool_for
from planner.process import Settings
from planner.recipe import Recipe, load_recipe

STEEL = load_material("316L")
CELLS = sorted(path.stem for path in (FACTS_DIR / "cells").glob("*.toml"))
SHIPPED = {name: load_cell(name) for name in CELLS}
PARTS = sorted(path.stem for path in (FACTS_DIR / "parts").glob("*.stl"))
MILL8, MILL4, BALL6 = ToolFacts(2, "end_mill", 8.0, 18000.0), ToolFacts(3, "end_mill", 4.0, 24000.0), ToolFacts(4, "ball_mill", 6.0, 24000.0)
HEAD = ToolFacts(1, "deposition", 2.0, 1.0)
RPM = Settings.from_recipe(Recipe(cutter_diameter_mm=8.0)).spindle_rpm
SMALL = CellFacts(
    "small", (-50.0, -40.0, 0.0), (50.0, 40.0, 60.0), (0.0, 0.0, 10.0), 0.0, (HEAD, MILL8, MILL4), ("316L",),
    {"laser_w": 1000.0, "powder_g_min": 20.0, "carrier_gas_l_min": 10.0, "shield_gas_l_min": 20.0},
)  # fmt: skip


def needs(size: tuple[float, float, float] = (20.0, 20.0, 20.0), **recipe: object) -> JobNeeds:
    fields = {"build_direction": (0.0, 0.0, 1.0), "cutter_diameter_mm": 8.0, **recipe}
    return needs_of([[0.0, 0.0, 0.0], list(size)], Recipe.model_validate(fields), STEEL)


def without(cell: CellFacts, **changes: object) -> CellFacts:
    return msgspec.structs.replace(cell, **changes)


CASES = [
    ("a part that fits", needs(), SMALL, ""),
    ("too wide", needs((120.0, 20.0, 20.0)), SMALL, "size: the part is 120.0 mm in X on the table, the build volume of small 100.0 mm"),
    ("too deep", needs((20.0, 81.0, 20.0)), SMALL, "size: the part is 81.0 mm in Y on the table, the build volume of small 80.0 mm"),
    ("too high", needs((20.0, 20.0, 61.0)), SMALL, "size: the part is 61.0 mm in Z on the table, the build volume of small 60.0 mm"),
    ("too high above its plate", needs((20.0, 20.0, 51.0)), SMALL, "height: the part is 51.0 mm in Z, above the plate of small are 50.0 mm"),
    ("laid down by its build direction", needs((20.0, 20.0, 90.0), build_direction=(1.0, 0.0, 0.0)), SMALL,
     "size: the part is 90.0 mm in Y on the table, the build volume of small 80.0 mm"),
    ("laid down and turned", needs((20.0, 20.0, 90.0), build_direction=(1.0, 0.0, 0.0), turn_deg=90.0), SMALL, ""),
    ("turned by the table", needs((90.0, 20.0, 20.0)), without(SMALL, rotation_deg=90.0),
     "size: the part is 90.0 mm in Y on the table, the build volume of small 80.0 mm"),
    ("a direction left open finds one", needs((20.0, 20.0, 90.0), build_direction="auto"), SMALL, ""),
    ("a direction left open finds none", needs((20.0, 20.0, 150.0), build_direction="auto"), SMALL,
     "size: the part is 150.0 mm in Z on the table, the build volume of small 60.0 mm"),
    ("a turn that a box cannot judge is planning's", needs((90.0, 90.0, 20.0), turn_deg=45.0), SMALL, ""),
    ("a turn that even a box can judge", needs((200.0, 10.0, 20.0), turn_deg=45.0), SMALL,
     "size: the part is 134.4 mm in X on the table, the build volume of small 100.0 mm"),
    ("shifted out of the volume", needs(shift_mm=(45.0, 0.0)), SMALL,
     "shift_mm: the part lies at 35.0 … 55.0 mm in X on the table, the build volume of small is -50.0 … 50.0 mm"),
    ("shifted within it", needs(shift_mm=(40.0, -30.0)), SMALL, ""),
    ("a powder that it is not fed", needs(material="ti6al4v"), SMALL, "material: asked ti6al4v, small is fed 316L only"),
    ("a powder that is only milled", needs(material="ti6al4v", process="mill"), SMALL, ""),
    ("any powder", needs(material="ti6al4v"), without(SMALL, materials=None), ""),
    ("a laser that is too weak", needs(laser_w=1200.0), SMALL, "laser_w: the recipe asks at least 1200 W, small gives at most 1000 W"),
    ("a laser too weak for the material", needs(), without(SMALL, most={"laser_w": 100.0}),
     f"laser_w: 316L asks at least {max(STEEL.deposition.laser_w.min, STEEL.bead.min_power_w):g} W, small gives at most 100 W"),
    ("a feeder that is too slow", needs(powder_g_min=15.0), without(SMALL, most={"powder_g_min": 10.0}),
     "powder_g_min: the recipe asks at least 15 g/min, small gives at most 10 g/min"),
    ("milled without laser and powder", needs(process="mill"), without(SMALL, most={"laser_w": 1.0, "powder_g_min": 0.1}), ""),
    ("milling without a spindle", needs(), without(SMALL, tools=(HEAD,)), "process: asked hybrid, small has no cutter in a spindle"),
    ("deposited without a spindle", needs(process="deposit"), without(SMALL, tools=(HEAD,)), ""),
    ("depositing without a head", needs(process="deposit"), without(SMALL, tools=(MILL8,)), "process: asked deposit, small has no deposition head"),
    ("milled without a head", needs(process="mill"), without(SMALL, tools=(MILL8,)), ""),
    ("a cutter that is not there", needs(cutter_diameter_mm=6.0), SMALL,
     "cutter_diameter_mm: asked 6 mm, small has no end mill or bull nose of that diameter; it has end mill 8 mm, end mill 4 mm"),
    ("a small cutter that is not there", needs(small_cutter_diameter_mm=3.0), SMALL,
     "small_cutter_diameter_mm: asked 3 mm, small has no end mill or bull nose or ball mill of that diameter; it has end mill 8 mm, end mill 4 mm"),
    ("a ball cutter that is not there", needs(ball_cutter_diameter_mm=6.0), SMALL,
     "ball_cutter_diameter_mm: asked 6 mm, small has no ball mill of that diameter; it has end mill 8 mm, end mill 4 mm"),
    ("a ball cutter that is there", needs(ball_cutter_diameter_mm=6.0), without(SMALL, tools=(HEAD, MILL8, BALL6)), ""),
    ("a ball mill faces nothing", needs(cutter_diameter_mm=6.0), without(SMALL, tools=(HEAD, BALL6)),
     "cutter_diameter_mm: asked 6 mm, small has no end mill or bull nose of that diameter; it has ball mill 6 mm"),
    ("a spindle that is too slow", needs(), without(SMALL, tools=(HEAD, ToolFacts(2, "end_mill", 8.0, 2000.0))),
     f"cutter_diameter_mm: 8 mm in 316L asks {RPM:g} 1/min, tool 2 of small allows 2000 1/min"),
]  # fmt: skip


@pytest.mark.parametrize(("needed", "cell", "why"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_a_job_fits_or_is_told_which_field_misses_which_bound(needed: JobNeeds, cell: CellFacts, why: str) -> None:
    assert why_not(needed, cell) == why


def test_facts_survive_the_store_and_those_of_another_version_are_not_guessed_at() -> None:
    facts = facts_of(load_cell("trunnion_tcp"))
    assert facts_from(msgspec.json.decode(msgspec.json.encode(facts))) == facts
    assert facts.most == {"laser_w": 2000.0, "powder_g_min": 40.0, "carrier_gas_l_min": 15.0, "shield_gas_l_min": 30.0}
    assert facts_from({"cell": "x", "volume": 3}) is None


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8), (-0.48, 0.64, 0.6)])
@pytest.mark.parametrize("turn_deg", [0.0, 45.0, 200.0])
def test_a_frame_is_the_planners(direction: tuple[float, float, float], turn_deg: float) -> None:
    mesh = mesh_of(trimesh.creation.box((10.0, 20.0, 30.0)))
    assert np.allclose(frame_of(direction, turn_deg), build_frame(mesh, np.array(direction), turn_deg)[:3, :3], atol=1e-12)


def test_no_body_of_a_box_is_narrower_than_told() -> None:
    random = np.random.default_rng(5)
    for _ in range(200):
        size = random.uniform(1.0, 100.0, 3)
        points = random.uniform(0.0, 1.0, (6, 3)) * size
        points[[0, 1, 2], [0, 1, 2]], points[[3, 4, 5], [0, 1, 2]] = 0.0, size  # each face of its box is touched
        way = random.normal(size=3)
        way /= np.linalg.norm(way)
        assert np.ptp(points @ way) >= least_width(tuple(way), tuple(size)) - 1e-9
    assert least_width((0.0, -1.0, 0.0), (1.0, 2.0, 3.0)) == 2.0


def smaller(cell: Cell, share: float) -> Cell:
    """The cell with a build volume of that share about its plate, which stays as high above the volume's floor."""
    origin = np.array(cell.placement.part_origin_mm)
    low, high = (origin + share * (np.array(corner) - origin) for corner in (cell.build_volume.min_mm, cell.build_volume.max_mm))
    return cell.model_copy(update={"build_volume": type(cell.build_volume)(min_mm=tuple(low), max_mm=tuple(high))})


def refused_by_planning(mesh: Mesh, recipe: Recipe, cell: Cell, file: Path) -> bool:
    """What the stages refuse for the cell's sake, as they do: before the plan, of the placed part, and of the tools of its operations."""
    settings = Settings.from_recipe(recipe)
    cutters = [(Process.MILL_FACE, settings)]
    if (small := settings.with_small_cutter()) is not None:
        cutters.append((Process.MILL_SIDE, small))
    try:
        check_size(mesh, recipe, str(file))
        assert recipe.build_direction != "auto"
        frame = build_frame(mesh, np.array(recipe.build_direction), recipe.turn_deg)
        check_volume(mesh.transformed(frame).bounds, cell, table_from_build(cell.placement.part_origin_mm, cell.placement.rotation_deg))
        for process, used in cutters if recipe.process != "deposit" else []:
            tool_for(Operation(process, 0, (), cutter_diameter_mm=used.cutter_diameter_mm, spindle_rpm=used.spindle_rpm), cell)
    except PlannerError:
        return True
    return False


@pytest.mark.parametrize("part", PARTS)
def test_fitting_and_planning_refuse_the_same_shipped_parts_on_the_same_cells(part: str, tmp_path: Path) -> None:
    mesh = mesh_of(trimesh.load_mesh(FACTS_DIR / "parts" / f"{part}.stl"))
    recipe = load_recipe(FACTS_DIR / "parts" / f"{part}.toml")
    needed = needs_of(mesh.bounds.tolist(), recipe, load_material(recipe.material))
    seen = set()
    for name, (share, tools) in itertools.product(CELLS, ((1.0, ()), (1.0, (2, 5)), (1.0, (3, 6)), (0.35, ()), (0.15, ()))):
        cell = smaller(SHIPPED[name], share)
        cell = cell.model_copy(update={"tools": tuple(tool for tool in cell.tools if tool.number not in tools)})
        file = tmp_path / f"{name}-{share}.toml"
        if not file.exists():
            file.write_text(_toml(cell))
        fits, planned = not why_not(needed, facts_of(cell)), not refused_by_planning(mesh, recipe, cell, file)
        is_square = recipe.turn_deg % 90.0 == 0.0
        assert fits == planned or (fits and not is_square), (name, share, tools)  # a part that stands askew is judged by its box with care
        seen.add(fits)
    assert seen == {True, False}


def _toml(cell: Cell) -> str:
    return tomli_w.dumps(cell.model_dump(mode="json", exclude_none=True, exclude={"machine"}))
