"""A part with leaning walls uses the whole machine: the cutter's flank follows the rulings, table and head move together."""

from __future__ import annotations

import numpy as np
import trimesh

import planner
from config import load_cell
from planner.plan import Process
from planner.program import LineKind
from planner.recipe import Recipe


def test_milling_a_frustum_moves_all_five_axes_at_once_with_the_axis_on_its_rulings() -> None:
    frustum = trimesh.creation.revolve([[0.0, 0.0], [12.0, 0.0], [10.0, 4.0], [0.0, 4.0]], sections=96)
    plan = planner.plan(frustum, Recipe(tolerance_mm=0.2, layer_height_mm=0.8))
    program = planner.post(plan, load_cell("trunnion_tcp"))
    milled = [index for index, operation in enumerate(plan.operations) if operation.process is Process.MILL_SIDE]
    rows = program.table[(program.table["kind"] == LineKind.PROCESS) & np.isin(program.table["operation"], milled)]
    at_once = (np.abs(np.diff(rows["joints_end"], axis=0)) > 1e-6).sum(axis=1)
    assert np.ptp(rows["joints_end"], axis=0).min() > 1.0, "every axis travels"
    assert (at_once >= 4).any()
    leaning = rows["axis_end"][:, 2] < 0.999
    ruling_deg = np.degrees(np.arctan2(2.0, 4.0))
    tilt_deg = np.degrees(np.arccos(rows["axis_end"][leaning, 2]))
    assert leaning.any() and np.median(np.abs(tilt_deg - ruling_deg)) < 0.5
