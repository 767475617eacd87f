"""Whether any milling pass of a plan cuts into what is to stay: each against the part as far as it is built by then."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from planner.collide.cutting_end import CuttingEnd
from planner.collide.gouge import Gouges, Target, gouge
from planner.decompose.pieces import Piece
from planner.decompose.solids import mesh_of_solid, solid_of
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.plan import Layer, Operation, Process

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

FLUTES = 3.0
"""Of the diameter: length of an ordinary cutter's flutes; the shank above is thinner."""
_OVER_MM = 1e-4  # above a layer's top plane: a finished face in that plane is the part's own
_IN_PLANE_MM = 1e-3  # off a base plane: facets of pieces are flat where they were cut
_INSIDE_MM = 0.02  # facets in such a plane that lie deeper in the part are a joint: the next piece's metal fills what is cut there


@dataclass(frozen=True, eq=False)
class Checked:
    """One milling operation and how deep its passes at feed come into what stands."""

    operation: Operation
    gouges: Gouges

    @property
    def worst_mm(self) -> float:
        """Least signed distance of all passes, mm."""
        return float(self.gouges.least_mm.min(initial=np.inf))

    @property
    def worst_place(self) -> Floats:
        """(3,) float, mm, build frame   Where that is on the part."""
        return np.asarray(self.gouges.place[int(np.argmin(self.gouges.least_mm))])


def end_of(operation: Operation) -> CuttingEnd:
    """The cutting end that does a milling operation."""
    radius = 0.5 * operation.cutter_diameter_mm
    corner = radius if operation.process is Process.MILL_SCALLOP else 0.0
    return CuttingEnd(radius, corner, FLUTES * operation.cutter_diameter_mm)


def checked(
    pieces: Sequence[Piece], layers: Sequence[Layer], part: Mesh, *, look_mm: float, from_block: bool = False
) -> Iterator[Checked]:
    """All milling operations of a plan, each against the part as far as it is built when it is done.

    pieces : in the order of building   part : the finished part, mm, build frame   look_mm : as in `gouge`
    from_block : the part is cut out of a block, so that all of it stands from the beginning.
    Above a layer's top the piece is still to be laid: what a cutter takes of the top itself, the next layer fills, so only what
    is cut deeper than that layer counts there.
    """
    joints = _Joints(FacetTree(part), np.array([piece.base for piece in pieces]))
    fixed = Target.of(part) if from_block else None
    done: list[Mesh] = []
    for number, piece in enumerate(pieces):
        own = [layer for layer in layers if layer.subcomponent == number]
        solid = None if from_block else solid_of(piece.mesh)
        for layer in own:
            cuts = [operation for operation in layer.operations if not operation.process.is_deposit]
            if not cuts:
                continue
            target = fixed
            if target is None:
                plane = None if layer is own[-1] else layer.top
                target = _standing(done, piece.mesh, solid, plane, layer.thickness_mm[1], joints)
            for operation, gouges in zip(cuts, _of_operations(cuts, target, look_mm), strict=True):
                yield Checked(operation, gouges)
        if not from_block:
            done.append(Mesh(piece.mesh.vertices, piece.mesh.facets[~joints.among(piece.mesh)]))


def _of_operations(cuts: Sequence[Operation], target: Target, look_mm: float) -> list[Gouges]:
    """Of the passes at feed: rapid ways are the collision check's."""
    return [
        gouge([step for step in operation.passes if not step.rapid], end_of(operation), target, look_mm=look_mm)
        for operation in cuts
    ]


def _standing(
    done: Sequence[Mesh], piece: Mesh, solid: object, plane: Floats | None, thickness_mm: float, joints: _Joints
) -> Target:
    """What stands of the part when a layer is milled.  plane : (6,) float, the layer's top; None: all of the piece stands."""
    body, spare = piece, np.zeros(len(piece.facets))
    if plane is not None:
        normal = plane[3:]
        at = float(plane[:3] @ normal) + _OVER_MM
        body = mesh_of_solid(solid.trim_by_plane(tuple(-normal), -at))  # type: ignore[attr-defined]
        off = np.abs(body.corners @ normal - at).max(axis=1)
        spare = np.where(off < 0.5 * _OVER_MM, thickness_mm, 0.0)
    kept = ~joints.among(body) | (spare > 0.0)
    bodies = [*done, Mesh(body.vertices, body.facets[kept])]
    spares = np.concatenate([*(np.zeros(len(mesh.facets)) for mesh in done), spare[kept]])
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in bodies[:-1])])
    merged = Mesh(
        np.vstack([mesh.vertices for mesh in bodies]),
        np.vstack([mesh.facets + at for mesh, at in zip(bodies, first.tolist(), strict=True)]),
    )
    return Target.of(merged, spares)


@dataclass(frozen=True, eq=False)
class _Joints:
    """Where pieces meet.  whole : the part's own surface   planes : (n, 6) float, mm, 1, of the pieces' bases"""

    whole: FacetTree
    planes: Floats

    def among(self, mesh: Mesh) -> Flags:
        """(m,) bool   Which facets lie in a joint, inside the part."""
        corners = mesh.corners
        found = np.zeros(len(corners), dtype=np.bool_)
        for plane in self.planes:
            found |= (np.abs((corners - plane[:3]) @ plane[3:]) <= _IN_PLANE_MM).all(axis=1)
        found[found] = self.whole.nearest(mesh.centroids[found])[0] > _INSIDE_MM
        return found


def gouge_findings(
    pieces: Sequence[Piece], layers: Sequence[Layer], part: Mesh, tolerance_mm: float, *, from_block: bool = False
) -> list[str]:
    """One line for each run of layers in which a cutter comes deeper into the part than the tolerance: how deep, where."""
    deep = [
        found
        for found in checked(pieces, layers, part, look_mm=-tolerance_mm, from_block=from_block)
        if found.worst_mm < -tolerance_mm
    ]
    lines = []
    for (process, note), run in groupby(deep, key=lambda found: (found.operation.process, found.operation.note)):
        members = list(run)
        worst = min(members, key=lambda found: found.worst_mm)
        x, y, z = worst.worst_place
        first, last = members[0].operation.layer, members[-1].operation.layer
        where = f"layer {first}" if first == last else f"layers {first}-{last}"
        count = sum(int((found.gouges.least_mm < -tolerance_mm).sum()) for found in members)
        lines.append(
            f"{where}: {count} passes of {process.value} ({note or 'tops'}) cut up to {-worst.worst_mm:.2f} mm into the part, "
            f"allowed {tolerance_mm:g} mm, deepest at ({x:.1f}, {y:.1f}, {z:.1f}) mm"
        )
    return lines
