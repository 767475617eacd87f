"""The whole plan is one way of the tool: every pass begins where the last one ended, and links stay clear."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from planner.pipeline import plan
from planner.plan import Plan
from planner.recipe import Recipe
from planner.toolpath.links import CLEARANCE_MM, end_of, start_of
from tests.unit.planner.small_parts import box, frustum, points_of, steps_of, tube

MADE = {
    "tube": lambda: plan(tube(8.0, 15.0, 4.0), Recipe(layer_height_mm=0.8)),
    "frustum": lambda: plan(frustum(15.0, 12.0, 5.0), Recipe(layer_height_mm=0.8)),
    "thin": lambda: plan(tube(8.5, 10.0, 2.4), Recipe(process="deposit", layer_height_mm=0.8)),
    "block": lambda: plan(box(20.0, 14.0, 5.0), Recipe(process="mill")),
}


@pytest.fixture(scope="module", params=MADE)
def made(request: pytest.FixtureRequest) -> Plan:
    return MADE[request.param]()


def test_every_pass_begins_in_the_pose_in_which_the_last_one_ended(made: Plan) -> None:
    steps = [step for _, step in steps_of(made)]
    for before, after in pairwise(steps):
        assert np.abs(end_of(before).tip - start_of(after).tip).max() < 1e-9
        assert np.abs(end_of(before).axis - start_of(after).axis).max() < 1e-9


def test_plan_begins_and_every_operation_ends_clear_above_the_metal(made: Plan) -> None:
    first = made.operations[0]
    assert start_of(first.passes[0]).tip[2] >= CLEARANCE_MM
    for layer in made.layers:
        for operation in layer.operations:
            assert end_of(operation.passes[-1]).tip[2] >= layer.top[2] + CLEARANCE_MM - 1e-6


def test_rapids_touch_nothing_and_the_last_stretch_down_is_run_at_feed(made: Plan) -> None:
    for layer in made.layers:
        for operation in layer.operations:
            for k, step in enumerate(operation.passes):
                if not step.rapid:
                    continue
                points = points_of(step)
                low = min(points[0, 2], points[-1, 2])
                moving = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1) > 1e-6
                assert (points[1:][moving, 2] > low - 1e-9).all()
                if k + 1 < len(operation.passes):
                    approach = operation.passes[k + 1]
                    assert approach.is_link and not approach.rapid
                    assert approach.tip.length >= 1.99


def test_axis_curves_share_the_tips_domain_and_are_near_unit_length(made: Plan) -> None:
    for _, step in steps_of(made):
        if isinstance(step.axis, np.ndarray):
            assert np.linalg.norm(step.axis) == pytest.approx(1.0, abs=1e-12)
        else:
            assert step.axis.domain == pytest.approx(step.tip.domain, abs=1e-12)
            values = step.axis.evaluate(np.linspace(*step.axis.domain, 50))
            assert np.abs(np.linalg.norm(values, axis=1) - 1.0).max() < 0.1
