"""The estimate against the planner itself: the same part planned and posted whole, live for one, as recorded for the four of the paper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from config import Cell, load_cell, load_material
from config.base import FACTS_DIR
from config.cell import Rates
from config.material import Price
from planner.estimate import estimate
from planner.estimate.estimate import POWDER_SHARE, TIME_SHARE
from planner.estimate.prices import cost_of
from planner.mesh import load
from planner.mesh.mesh import Mesh, mesh_of
from planner.pipeline import plan
from planner.plan import Plan
from planner.post import post
from planner.recipe import Recipe, load_recipe

# Layers, time of the program (s) and powder (g) of the plans of config/parts with their recipes, posted for trunnion_tcp in grblHAL's
# dialect; recorded by planning and posting them (a minute), as `planner.plan` and `planner.post` do it.
PLANNED = {
    "pipe": (14, 1110.3, 126.2),
    "bearing": (51, 4901.9, 666.4),
    "double_arc": (151, 6129.9, 187.0),
    "hinge": (175, 9121.7, 564.6),
}


def part(name: str) -> tuple[Mesh, Recipe]:
    folder = FACTS_DIR / "parts"
    return load(folder / f"{name}.stl", "mm"), load_recipe(Path(folder / f"{name}.toml"))


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell("trunnion_tcp")


def powder_g(made: Plan) -> float:
    """Powder of all passes by their own set-points: rate times time."""
    fed = 0.0
    for operation in made.operations:
        for step in operation.passes:
            rows = step.setpoints
            ends = np.append(rows[1:, 0], step.tip.length)
            fed += float((np.maximum(ends - rows[:, 0], 0.0) / rows[:, 1] * rows[:, 3]).sum()) / 60.0
    return fed


@pytest.mark.parametrize("name", PLANNED)
def test_estimate_keeps_its_range_to_the_plan_of_each_part_of_the_paper(name: str, cell: Cell) -> None:
    mesh, recipe = part(name)
    found = estimate(mesh, recipe, cell)
    layers, time_s, powder = PLANNED[name]
    assert found.layers == pytest.approx(layers, rel=0.05)
    assert found.build_time_s - found.times_s["waits"] == pytest.approx(time_s, rel=TIME_SHARE)
    assert found.powder_g == pytest.approx(powder, rel=POWDER_SHARE)


def test_estimate_keeps_its_range_to_a_plan_made_now(cell: Cell) -> None:
    mesh, recipe = part("pipe")
    made = plan(mesh, recipe)
    program = post(made, cell, dialect="grblhal")
    found = estimate(mesh, recipe, cell)
    assert found.layers == len(made.layers)
    assert found.build_time_s - found.times_s["waits"] == pytest.approx(program.duration_s, rel=TIME_SHARE)
    assert found.powder_g == pytest.approx(powder_g(made), rel=POWDER_SHARE)
    assert found.deposited_mm3 == pytest.approx(made.volumes_mm3["deposited"], rel=0.1)


def test_finer_layers_take_longer_and_more_allowance_takes_more_powder(cell: Cell) -> None:
    block = mesh_of(trimesh.creation.box((30.0, 20.0, 12.0)))
    usual = estimate(block, Recipe(layer_height_mm=0.8), cell)
    fine = estimate(block, Recipe(layer_height_mm=0.4), cell)
    assert (usual.layers, fine.layers) == (15, 30) and fine.build_time_s > usual.build_time_s
    thick = estimate(block, Recipe(layer_height_mm=0.8, stock_allowance_mm=1.5), cell)
    assert thick.powder_g > usual.powder_g and thick.milled_mm3 > usual.milled_mm3 and thick.mass_g == usual.mass_g
    density = load_material("316L").density_g_mm3
    assert usual.mass_g == pytest.approx(30.0 * 20.0 * 12.0 * density)


def test_cost_is_the_sum_of_what_the_rates_say_and_none_while_one_is_missing(cell: Cell) -> None:
    steel = load_material("316L")
    cost, missing = cost_of(7200.0, 500.0, 3000.0, steel, cell)
    assert cost is None and [rate.field for rate in missing] == ["rates.machine_per_h", "rates.gas_per_m3", "price.per_kg"]
    priced = steel.model_copy(update={"price": Price(per_kg=40.0, currency="EUR")})
    rated = cell.model_copy(update={"rates": Rates(currency="EUR", machine_per_h=60.0, gas_per_m3=8.0)})
    cost, missing = cost_of(7200.0, 500.0, 3000.0, priced, rated)
    assert not missing and cost is not None
    assert (cost.machine, cost.powder, cost.gas) == pytest.approx((120.0, 20.0, 24.0)) and cost.total == pytest.approx(164.0)
    other = cell.model_copy(update={"rates": Rates(currency="USD", machine_per_h=60.0, gas_per_m3=8.0)})
    cost, missing = cost_of(7200.0, 500.0, 3000.0, priced, other)  # dollars and euros are not added
    assert cost is None and [rate.field for rate in missing] == ["price.per_kg"]


def test_rates_do_not_change_what_a_program_depends_on(cell: Cell) -> None:
    assert cell.model_copy(update={"rates": Rates(currency="EUR", machine_per_h=60.0)}).sha256 == cell.sha256
