"""How much of a part its directions make: of a way to build it, and in words for the findings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.decompose.blocks import Block
from planner.decompose.buildable import WORTH, buildable_shares, report
from planner.decompose.members import Ways

Floats = NDArray[np.float64]

_HANGS_MM2 = 0.5  # less is rounding
_MOST_DIRECTIONS = 6  # that are compared: a tenth of a second each on a part of many facets
_MOST_SET = 3  # directions in the set that is told


def share_made(ways: Ways, blocks: Sequence[Block]) -> float:
    """Share of the part's volume, 0 … 1, that stands without support when its blocks grow as they are to."""
    made = 0.0
    for block in blocks:
        share = 1.0
        if block.left_mm2 > _HANGS_MM2:
            limits = ways.limits
            found = buildable_shares(block.mesh, block.base[3:], limits.upright_deg, limits.tilted_deg, most=1)
            share = min(float(found.tilted[0]), 1.0 - block.left_mm2 / float(block.mesh.areas.sum()))
        made += share * block.mesh.volume
    return made / ways.mesh.volume


def share_findings(ways: Ways, chosen: Floats, others: Sequence[Floats]) -> list[str]:
    """Lines on what the chosen first direction makes alone and, where that is not all, what others and a set of them make.

    chosen : (3,) float, unit, part frame   others : (3,) each, the most promising first
    """
    limits = ways.limits
    alone = buildable_shares(ways.mesh, chosen, limits.upright_deg, limits.tilted_deg, most=1)
    upright, tilted = float(alone.upright[0]), float(alone.tilted[0])
    line = f"the build direction alone makes {100.0 * upright:.0f} % of the part without support, head upright"
    if tilted > upright + WORTH:
        line += f", {100.0 * tilted:.0f} % with the head tilted over overhangs"
    further = [other for other in others if float(other @ chosen) < 1.0 - 1e-6]
    if upright >= 1.0 - WORTH or not further:
        return [line]
    directions = np.array([chosen, *further][:_MOST_DIRECTIONS])
    return [line, *report(buildable_shares(ways.mesh, directions, limits.upright_deg, limits.tilted_deg, _MOST_SET))]
