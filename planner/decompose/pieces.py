"""What decomposition comes to: pieces of the part in the order of building, each with its base, its direction and its reasons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.plan import Candidate, Skeleton
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Piece:
    """One subcomponent to be.

    mesh : closed, mm, build frame, flat where it was cut   parent : index in `Division.pieces`, -1: the substrate
    base : (6,) float   point (mm) of its base plane and the unit direction in which it grows, build frame
    path : (k, 6) float, planes along its centroidal axis from the base to past its end; None where it grows straight
    joint_mm2 : area with which it stands on its parent   axis : (m, 3) float, mm, centroidal axis from base to end
    support : closed mesh, mm, build frame, of sacrificial metal built with it and milled away when it stands; None: none
    why : one line each
    """

    name: str
    mesh: Mesh
    parent: int
    base: Floats
    joint_mm2: float
    axis: Floats
    path: Floats | None = None
    support: Mesh | None = None
    why: tuple[str, ...] = ()

    @property
    def direction(self) -> Floats:
        """(3,) float   Unit direction in which it grows from its base, build frame."""
        return self.base[3:]

    @property
    def build_from_piece(self) -> Floats:
        """(4, 4) float   From the piece's own frame (z = its direction, z = 0 its base plane) to the build frame."""
        frame = plane_frame(self.base)
        matrix = np.eye(4)
        matrix[:3, :3] = frame[1:].T
        matrix[:3, 3] = self.base[:3]
        return matrix




@dataclass(frozen=True, eq=False)
class Division:
    """A part in pieces, in the order in which they are built; the first stands on the substrate.

    build_from_part : (4, 4) float, rigid   candidates : what was weighed   findings : one line each
    """

    build_from_part: Floats
    pieces: tuple[Piece, ...]
    skeleton: Skeleton
    candidates: tuple[Candidate, ...] = ()
    findings: tuple[str, ...] = ()
