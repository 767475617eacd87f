"""Which bodies of a cell are looked at together, and which against the part."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.collide.bodies import PLATE, Body
from planner.collide.carriers import BASE, SLIDE, Carriers, Motion
from planner.collide.follow import STILL, Watch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_ALWAYS = -1.0  # in `Watch.cut_mm`: bodies that may not be in each other at all


def watched(
    bodies: list[Body], cell: Cell, carriers: Carriers, table_from_build: Floats, bounds: Floats, cuts: bool
) -> tuple[Watch, list[tuple[str, str]]]:
    """What is looked at with these bodies mounted, and the names of its pairs, the head's side first.

    bounds : (2, 3) float, mm, of the part, build frame   cuts : flutes may be in the part, and so deep in the plate as the cell allows
    Bodies on one carrier never meet; all others are looked at but those that the cell's file lets touch.
    """
    machine = cell.machine
    assert machine is not None
    motion, table = carriers.motion, carriers.number["table"]
    lines = [_line(motion, carrier) for carrier in range(len(motion.parent))]
    of_head = set(lines[carriers.number["head_slide"]])
    ignore = {frozenset(pair) for pair in machine.ignore}
    pairs, cut, between, names = [], [], [], []
    for (i, one), (j, other) in itertools.combinations(enumerate(bodies), 2):
        if one.carrier == other.carrier or frozenset((one.name, other.name)) in ignore:
            continue
        first, second = (i, j) if one.carrier in of_head and one.carrier != BASE else (j, i)
        in_plate = cuts and (one.is_flutes or other.is_flutes) and PLATE in (one.name, other.name)
        pairs.append((first, second))
        cut.append(machine.plate_cut_mm if in_plate else _ALWAYS)
        columns = {int(motion.column[n]) for n in set(lines[one.carrier]) ^ set(lines[other.carrier])}
        between.append(STILL | sum(1 << column for column in columns if column >= 0))
        names.append((bodies[first].name, bodies[second].name))
    build_from_table = np.ascontiguousarray(np.linalg.inv(table_from_build)[:3])
    meets = np.array([body.carrier != table and not (cuts and body.is_flutes) for body in bodies], dtype=np.bool_)
    arm = np.array([_arm(n, bodies, cell, motion, lines, table, table_from_build, bounds) for n in range(len(lines))])
    watch = Watch(
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
        np.array(cut, dtype=np.float64),
        np.array(between, dtype=np.int64),
        meets,
        arm,
        table,
        build_from_table,
    )
    return watch, names


def _line(motion: Motion, carrier: int) -> list[int]:
    """A carrier and those that carry it, down to the base, which is left out."""
    line = []
    while carrier != BASE:
        line.append(carrier)
        carrier = int(motion.parent[carrier])
    return line


def _arm(
    n: int, bodies: list[Body], cell: Cell, motion: Motion, lines: list[list[int]], table: int, table_from_build: Floats, bounds: Floats
) -> float:
    """How far (mm) what carrier n carries, the part too, can be from its joint's point; 0 for a joint that does not turn."""
    if not motion.is_rotary[n]:
        return 0.0
    travel = {k: max(abs(axis.min), abs(axis.max)) for k, axis in enumerate(cell.axes)}
    farthest = 0.0
    carried = [(body.carrier, *_ball(body)) for body in bodies if n in lines[body.carrier]]
    if n in lines[table]:
        corners = np.array(list(itertools.product(*bounds.T))) @ table_from_build[:3, :3].T + table_from_build[:3, 3]
        carried += [(table, corner, 0.0) for corner in corners]
    for carrier, centre, radius in carried:
        way = radius + float(np.linalg.norm(centre - motion.point[n]))
        for k in lines[carrier][: lines[carrier].index(n)]:  # what lies between may bring it farther out
            if motion.column[k] == SLIDE:
                way += float(np.linalg.norm(motion.direction[k]))
            elif motion.is_rotary[k]:
                way += 2.0 * float(np.linalg.norm(motion.point[k] - motion.point[n]))
            else:
                way += travel[int(motion.column[k])]
        farthest = max(farthest, way)
    return farthest


def _ball(body: Body) -> tuple[Floats, float]:
    """Centre, machine frame at all joints zero, and radius (mm) of a ball that holds a body."""
    centre, radius = body.sphere()
    return body.pose[:, :3] @ centre + body.pose[:, 3], radius
