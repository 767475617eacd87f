"""What one way to build a part costs: what hangs first, then tilting, joints, set-ups, height and base."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.decompose.blocks import Block
from planner.decompose.corners import used_vertices
from planner.decompose.members import Ways
from planner.decompose.search import COSTS
from planner.decompose.shares import share_made
from planner.plan import Candidate

Floats = NDArray[np.float64]

_WEIGHTS = {"foot": 6.0, "height": 0.3, "base": 0.5}
"""Of surface that leans over the plate where no cutter comes (it misses the tolerance), of the part's height and of missing
base, each relative to the part's size."""
_SUPPORT = (2.5, 0.3)
"""Of support at all, and of the area that it carries relative to the shadow: cuts that leave some hanging are worth little."""
_SETUP_S = 180.0  # to turn the table, probe and begin anew
_HANGS_MM2 = 0.5  # less is rounding


def weighed(ways: Ways, blocks: Sequence[Block], joints_mm2: float) -> Candidate:
    """Figures and score of a way to build the part, its first block first; the name says in which directions.

    joints_mm2 : area of all joints that were cut because something would hang; branches are cut for the cutter's sake.
    """
    mesh = ways.mesh
    shadow = 0.25 * float(mesh.areas.sum())
    first = blocks[0]
    setups = setup_count([block.base[3:] for block in blocks])
    left = sum((block.left_mm2 for block in blocks), 0.0)
    tilted = sum(block.hangs.tilted_mm2 for block in blocks if block.path is None)
    height = float(np.ptp(mesh.vertices[used_vertices(mesh)] @ first.base[3:]))
    own_shadow = 0.5 * float((first.mesh.areas * np.abs(first.mesh.normals @ first.base[3:])).sum())
    score = (
        _hanging_cost(ways, left / shadow)
        + COSTS["tilted"] * tilted / shadow
        + COSTS["joint"] * joints_mm2 / shadow
        + COSTS["setup"] * (setups - 1)
        + COSTS["piece"] * (len(blocks) - 1)
        + _WEIGHTS["foot"] * (0.0 if first.path is not None else first.hangs.foot_mm2) / shadow
        + _WEIGHTS["height"] * height / mesh.diagonal
        + _WEIGHTS["base"] * (1.0 - min(first.joint_mm2 / max(own_shadow, 1e-9), 1.0))
    )
    return Candidate(
        name=directions_text(blocks),
        subcomponents=len(blocks),
        setups=setups,
        overhang_mm2=round(left, 3),
        joint_mm2=round(sum((block.joint_mm2 for block in blocks if block.cap is not None), 0.0), 3),
        time_s=round(_time_s(ways, blocks, setups), 1),
        score=round(score, 6),
        buildable=round(share_made(ways, blocks), 6),
        chosen=False,
        note=_note(left, tilted, first),
    )


def _hanging_cost(ways: Ways, share: float) -> float:
    """Of what hangs, relative to the shadow: it falls away, or, where support may carry it, is built on metal that is milled away."""
    if share * 0.25 * float(ways.mesh.areas.sum()) <= _HANGS_MM2:
        return 0.0
    return COSTS["hangs"] * share if ways.settings.recipe.support == "never" else _SUPPORT[0] + _SUPPORT[1] * share


def setup_count(directions: Sequence[Floats]) -> int:
    """Set-ups of pieces built in the given order: one more wherever the direction changes."""
    changes = [float(a @ b) < 0.9999 for a, b in pairwise(directions)]
    return 1 + sum(changes)


def directions_text(blocks: Sequence[Block]) -> str:
    """The directions of building, in order, each once in a row."""
    texts: list[str] = []
    for block in blocks:
        text = vector_text(block.base[3:])
        if not texts or texts[-1] != text:
            texts.append(text)
    return "along " + ", then ".join(texts)


def vector_text(vector: Floats) -> str:
    """A direction in words."""
    return "(" + ", ".join(f"{round(float(value), 3) + 0.0:g}" for value in vector) + ")"


def _note(left: float, tilted: float, first: Block) -> str:
    """What speaks against it."""
    said = []
    if left > _HANGS_MM2:
        said.append(f"{left:.0f} mm² hang")
    if first.path is None and first.hangs.foot_mm2 > 1.0:
        said.append(f"{first.hangs.foot_mm2:.0f} mm² lean over the plate where no cutter comes")
    if tilted > 1.0:
        said.append(f"{tilted:.0f} mm² need the head tilted")
    if first.joint_mm2 < 1.0:
        said.append("no flat base")
    return ", ".join(said)


def _time_s(ways: Ways, blocks: Sequence[Block], setups: int) -> float:
    """Rough time, s: metal at the usual rate, the least time of every layer, and the set-ups."""
    settings = ways.settings
    bead = settings.bead_for(settings.layer_max_mm)
    metal = ways.mesh.volume / (bead.area_mm2 * bead.speed_mm_s)
    layers = sum(float(np.ptp(block.mesh.vertices @ block.base[3:])) for block in blocks) / settings.layer_max_mm
    return metal + layers * settings.interpass_s + setups * _SETUP_S
