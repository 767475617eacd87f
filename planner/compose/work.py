"""A piece that is to be made, with everything that its making needs to know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.compose.lean import Lean
from planner.compose.standing import Standing
from planner.decompose.pieces import Piece
from planner.handout import outlines_of
from planner.mesh.mesh import Mesh
from planner.plan import Layer
from planner.process import Settings
from planner.slicing.regions import LayerRegion

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Work:
    """A piece to be made.

    number : of the piece   first_layer : layers before it   standing : what stands, piece frame; None: the plate alone
    build_from_part : (4, 4) float, of the part   on_layer : handed each layer   say : told stage and share of this piece
    cooled : a finished layer, put off until what stands is cool enough; asked in the order of building
    """

    piece: Piece
    number: int
    first_layer: int
    standing: Standing | None
    settings: Settings
    build_from_part: Floats
    on_layer: Callable[[Layer], None] | None
    say: Callable[[str, float], None]
    cooled: Callable[[Layer], Layer] = lambda layer: layer

    def support(self) -> Mesh | None:
        """Sacrificial metal that is built with the piece, closed, mm, piece frame."""
        if self.piece.support is None:
            return None
        return self.piece.support.transformed(np.linalg.inv(self.piece.build_from_piece))

    def lean(self) -> Lean | None:
        """How the head keeps clear of what stands; None where that is the plate alone."""
        if self.standing is None:
            return None
        return Lean(self.standing.tree, self.settings.material.deposition.max_tilt_deg)

    @staticmethod
    def outlines(region: LayerRegion, build_from_layer: Floats) -> tuple[Floats, ...]:
        """Outlines of what of a layer rests on nothing, (n, 3) float, mm, build frame."""
        return tuple(
            ring @ build_from_layer[:3, :3].T + build_from_layer[:3, 3] for ring in outlines_of(region)
        )
