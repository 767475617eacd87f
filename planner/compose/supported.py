"""Pieces with sacrificial support: built as one with it, which is milled away again when they stand."""

from __future__ import annotations

from dataclasses import replace

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
from numpy.typing import NDArray

from planner.compose.work import Work
from planner.decompose.solids import mesh_of_solid, solid_of
from planner.errors import PlanningError
from planner.mesh.mesh import Mesh
from planner.plan import Operation
from planner.process import Settings
from planner.toolpath.clear import Clearing, clearing
from planner.toolpath.links import linked
from planner.toolpath.placed import in_build

Floats = NDArray[np.float64]

_LEFT_SHARE = 0.02  # of a support: how much may stay that no cutter comes to, rests in inside corners not counted


def with_support(mesh: Mesh, support: Mesh | None) -> Mesh:
    """A piece and its support as one body; the piece itself where it needs none.  Raises PlanningError"""
    return mesh if support is None else mesh_of_solid(solid_of(mesh) + solid_of(support))


def cleared(mesh: Mesh, support: Mesh, work: Work, layer: int) -> tuple[list[Operation], list[str]]:
    """How the support of a piece is milled away, with all links, and what there is to say about it, piece frame.

    mesh : the piece without support   layer : after which it is done.
    Raises PlanningError, one line with the place, where no cutter reaches it.
    """
    settings = work.settings
    standing = [] if work.standing is None else list(work.standing.meshes)
    stays = manifold3d.Manifold.batch_boolean([solid_of(body) for body in (mesh, *standing)], manifold3d.OpType.Add)
    plate = None if work.standing is None else work.standing.plate
    found = clearing(support, mesh_of_solid(stays), settings, plate=plate)
    if found.stuck_mm3 > _LEFT_SHARE * support.volume:
        why = next((line for line in found.findings if "no cutter reaches" in line), found.findings[-1])
        raise PlanningError(
            f"{found.stuck_mm3:.0f} mm³ of the support of piece {work.piece.name} cannot be milled away: {why}",
            "choose another build_direction or cut the part with cuts, or set support = never",
        )
    return [_placed(step, layer, settings) for step in found.clearings], list(found.findings)


def _placed(step: Clearing, layer: int, settings: Settings) -> Operation:
    """A clearing with its links, piece frame. It begins clear above all that stands."""
    done, _ = linked(step.operation, None, step.top_mm, settings)
    return replace(in_build(done, step.piece_from_clearing), layer=layer)
