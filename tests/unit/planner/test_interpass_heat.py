"""Waiting between layers by the heat balance, against the twin's own balance."""

from __future__ import annotations

import numpy as np
import pytest

from planner.compose.heating import HeatCourse
from planner.errors import RecipeError
from planner.pipeline import plan
from planner.plan import Plan
from planner.process import Settings
from planner.recipe import Recipe
from sim.process.heat import add_metal, cold_state, heat_law, heat_step
from tests.unit.planner.small_parts import box

LIMIT_K = 330.0


def twins_course(made: Plan, settings: Settings) -> list[float]:
    """Temperature of part and plate when each layer begins, by the twin's law, run along the plan's passes and waits."""
    law, material = heat_law(settings.material), settings.material
    state, since = cold_state(law), 0.0
    begins: list[float] = []
    for layer in made.layers:
        started = False
        for operation in layer.operations:
            if operation.process.is_deposit and not started:
                wait = operation.interpass_s - since if begins else 0.0
                heat_step(law, state, 0.0, max(wait, 0.0))
                begins.append(float(state[0]))
                started, since = True, 0.0
            for step in operation.passes:
                ends = np.append(step.setpoints[1:, 0], step.tip.length)
                for (at, feed, power, powder, _), end in zip(step.setpoints.tolist(), ends.tolist(), strict=True):
                    seconds = (end - at) / (100.0 if step.rapid else feed)
                    heat_step(law, state, material.head.absorptivity * power, seconds)
                    if power > 0.0:
                        add_metal(law, state, material.bead.catch_efficiency * powder / 60.0 * seconds)
                    since += seconds
    return begins


@pytest.fixture(scope="module")
def block() -> Plan:
    return plan(box(24.0, 20.0, 4.0), Recipe(process="deposit", layer_height_mm=0.8, max_interpass_k=LIMIT_K, decompose="never"))


def test_layers_wait_until_part_and_plate_are_as_cool_as_asked_and_no_longer(block: Plan) -> None:
    begins = twins_course(block, Settings.from_recipe(Recipe(process="deposit", layer_height_mm=0.8)))
    assert begins[0] == pytest.approx(293.0)
    assert max(begins) < LIMIT_K + 0.15 * (LIMIT_K - 293.0)
    assert min(begins[2:]) > LIMIT_K - 0.15 * (LIMIT_K - 293.0)


def test_waiting_is_told_and_set_as_the_least_time_from_layer_to_layer(block: Plan) -> None:
    assert any("interpass: layers wait" in line for line in block.findings)
    usual = plan(box(24.0, 20.0, 4.0), Recipe(process="deposit", layer_height_mm=0.8, decompose="never"))
    waits, before = ([layer.operations[0].interpass_s for layer in made.layers] for made in (block, usual))
    assert max(waits) > max(before) and waits[0] == before[0]
    assert not any("interpass" in line for line in usual.findings)


def test_temperature_below_that_of_the_plate_is_refused_in_one_line() -> None:
    with pytest.raises(RecipeError, match="max_interpass_k: asked 280 K"):
        HeatCourse(Settings.from_recipe(Recipe(max_interpass_k=280.0)))
