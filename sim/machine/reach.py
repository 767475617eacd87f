"""How far the points of two solids can move against each other when the joints between them move by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from config import Cell
from sim.machine.bodies import FRUSTUM, Body
from sim.machine.links import BASE, Links

Array = NDArray[np.float64]

COAXIAL = 1e-9


def pair_reach(cell: Cell, links: Links, solids: list[Body], pairs: NDArray[np.int64]) -> Array:
    """(p, carriers) float   Bound on the relative motion of a pair's points: mm for each mm or rad of a carrier's joint, or the slide's way.

    Only joints between the two solids count: a joint that carries both moves neither against the other.
    """
    travel = {n: max(abs(axis.min), abs(axis.max)) for n, axis in enumerate(cell.axes)}
    own = np.array([_reach(links, travel, solid) for solid in solids]).reshape(len(solids), len(links.column))
    lines = [_line(links, solid.carrier) for solid in solids]
    out = np.zeros((len(pairs), len(links.column)))
    for row, (a, b) in zip(out, pairs.tolist(), strict=True):
        for mine, other in ((a, b), (b, a)):
            for joint in (n for n in lines[mine] if n not in lines[other]):
                row[joint] = own[mine, joint]
    return out


def _line(links: Links, carrier: int) -> list[int]:
    """Carriers from this one down to the base, which is left out."""
    line = []
    while carrier != BASE:
        line.append(carrier)
        carrier = int(links.parent[carrier])
    return line


def _reach(links: Links, travel: dict[int, float], solid: Body) -> Array:
    """(carriers,) mm   Way of the farthest point of a solid for a unit of each joint that carries it."""
    out = np.zeros(len(links.column))
    at, radius = solid.sphere()
    spread = 0.0  # how far the joints passed already may bring the centre from where it is drawn
    for n in _line(links, solid.carrier):
        column = int(links.column[n])
        if column < 0:
            out[n] = float(np.linalg.norm(links.direction[n]))
            spread += out[n]
        elif not links.is_rotary[n]:
            out[n] = 1.0
            spread += travel[column]
        else:
            arm = at - links.pivot[n]
            beside = float(np.linalg.norm(np.cross(arm, links.direction[n])))
            turns_in_itself = solid.kind == FRUSTUM and np.abs(np.cross(solid.pose[:, 2], links.direction[n])).max() < COAXIAL
            if not (turns_in_itself and beside < COAXIAL and spread == 0.0):
                out[n] = beside + radius + spread
            spread += 2.0 * (beside + spread)
    return out
