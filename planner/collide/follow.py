"""Clearance of all bodies of a cell from each other and from the part as it stands, in poses of the machine or along its motion.

What was measured once is measured again only when, less what the two have moved since, it may be nearer than what is asked for.
Along a motion the next place to look at is as far on as that lets pass, but at least _STEP_MM: nothing deeper than that is missed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.bodies import Packed
from planner.collide.carriers import Motion, moved, place, product, relative
from planner.collide.solids import back, ball_bound, pair_distance, way_of
from planner.collide.standing import Forest, nearest_point

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

NOTHING = -1
STILL = 1 << 40
"""In `Watch.between`: set for every pair, those that nothing moves against each other too; they are looked at where a row is by itself."""
_STEP_MM = 0.5
_AHEAD_MM = 6.0  # beyond what is asked for, that is measured too: the farther, the less often
_TURN_DEG = 3.0  # of any rotary joint: between two places a point strays from its chord by less than a part in 2000 of its arm
_DEPTH = 64


class Watch(NamedTuple):
    """What is looked at.

    pairs : (p, 2) bodies   cut_mm : (p,) how deep they may be in each other before it counts; less than 0: it always counts
    between : (p,) bits of the joints between them, and STILL   meets_part : (n,) whether the part is an obstacle to a body
    arm : (c,) mm, how far what a joint carries is from its axis   table : carrier of the part   build_from_table : (3, 4)
    """

    pairs: Ints
    cut_mm: Floats
    between: Ints
    meets_part: Bools
    arm: Floats
    table: int
    build_from_table: Floats


class _State(NamedTuple):
    """Where everything was at the last place, and lower bounds of its distances since.

    world : (c, 3, 4)   poses, in_part : (n, 3, 4) of the bodies, machine and build frame   middle : (n, 3) of their balls
    ways, part_ways : (n,) mm, of the bodies since the place before   bound : (p,)   part_bound : (n,)   warm : (n,)
    """

    world: Floats
    poses: Floats
    in_part: Floats
    middle: Floats
    ways: Floats
    part_ways: Floats
    bound: Floats
    part_bound: Floats
    warm: Ints


@njit(cache=True)
def follow(
    motion: Motion, bodies: Packed, watch: Watch, forest: Forest, joints: Floats, joined: Bools, steps: Ints, is_parked: bool, limit: float
) -> tuple[Floats, Ints, Floats]:
    """Least signed distance at every row, or on the way to it.

    joints : (n, 5) float, mm or deg   joined : (n,) whether the machine comes straight from the row before, else only the row itself counts
    steps : (n,) points of the part that are gone by then do not count   limit : mm, what is farther is not looked for
    Returns (n,) mm, at most the limit; (n,) the pair, or the number of pairs and the body that is nearest to the part, NOTHING at the
    limit; (n, 3) mm, where, build frame.
    """
    count, pairs = len(bodies.kind), len(watch.pairs)
    least, nearest, places = np.full(len(joints), limit), np.full(len(joints), NOTHING), np.zeros((len(joints), 3))
    state = _State(
        np.empty((len(motion.parent), 3, 4)), np.zeros((count, 3, 4)), np.zeros((count, 3, 4)), np.empty((count, 3)), np.zeros(count),
        np.zeros(count), np.full(pairs, -np.inf), np.full(count, -np.inf), np.full(count, NOTHING),
    )  # fmt: skip
    stack, bounds = np.empty(_DEPTH, dtype=np.int64), np.empty(_DEPTH)
    at = np.empty(3)
    for row in range(len(joints)):
        all_joints = -1
        if not joined[row] or row == 0:
            _go(motion, bodies, watch, joints[row], is_parked, state)
            best, code, _ = _look(bodies, watch, forest, state, all_joints, steps[row], limit, limit, at, stack, bounds)
            if code != NOTHING:
                least[row], nearest[row], places[row] = best, code, at
            continue
        changed, turn, most = _motion_between(motion, watch, joints[row - 1], joints[row])
        here, slack = 0.0, 0.0
        parts = max(np.ceil(turn / _TURN_DEG), 1.0)
        while here < 1.0:
            step = max(_STEP_MM, slack) / max(most, 1e-9)
            here = min(here + min(step, 1.0 / parts), 1.0)
            _go(motion, bodies, watch, joints[row - 1] + here * (joints[row] - joints[row - 1]), is_parked, state)
            best, code, slack = _look(bodies, watch, forest, state, changed, steps[row], least[row], limit, at, stack, bounds)
            if code != NOTHING:
                least[row], nearest[row], places[row] = best, code, at
    return least, nearest, places


@njit(cache=True)
def _motion_between(motion: Motion, watch: Watch, begin: Floats, end: Floats) -> tuple[int, float, float]:
    """Bits of the joints that move, the greatest turn (deg), and a bound (mm) of how far any two points move against each other."""
    changed, turn, most = np.int64(0), 0.0, 0.0
    for n in range(len(motion.parent)):
        column = motion.column[n]
        if column < 0 or begin[column] == end[column]:
            continue
        changed |= np.int64(1) << column
        way = abs(end[column] - begin[column])
        if motion.is_rotary[n]:
            turn = max(turn, way)
            way *= np.pi / 180.0 * watch.arm[n]
        most += way
    return int(changed), turn, most


@njit(cache=True)
def _go(motion: Motion, bodies: Packed, watch: Watch, joints: Floats, is_parked: bool, state: _State) -> None:
    """Bring everything to new joints (5,)."""
    place(motion, joints, is_parked, state.world)
    new, in_table = np.empty((3, 4)), np.empty((3, 4))
    for b in range(len(bodies.kind)):
        product(state.world[bodies.carrier[b]], bodies.pose[b], new)
        state.ways[b] = way_of(state.poses[b], new, bodies.centre[b], bodies.radius[b])
        state.poses[b] = new
        moved(new, bodies.centre[b], state.middle[b])
        if watch.meets_part[b]:
            relative(state.world[watch.table], state.poses[b], in_table)
            product(watch.build_from_table, in_table, new)
            state.part_ways[b] = way_of(state.in_part[b], new, bodies.centre[b], bodies.radius[b])
            state.in_part[b] = new


@njit(cache=True)
def _look(
    bodies: Packed, watch: Watch, forest: Forest, state: _State, changed: int, step: int, best: float, limit: float,
    at: Floats, stack: Ints, bounds: Floats,
) -> tuple[float, int, float]:  # fmt: skip
    """Least distance here if it is less than `best`, and what has it; and how far (mm) everything may move on before it has to be measured.

    at : (3,), gets the place, build frame
    """
    code, slack = NOTHING, np.inf
    here = np.empty(3)
    for p in range(len(state.bound)):
        if not changed & watch.between[p]:
            continue
        a, b = watch.pairs[p, 0], watch.pairs[p, 1]
        wanted = min(best, -watch.cut_mm[p]) if watch.cut_mm[p] >= 0.0 else best
        state.bound[p] -= state.ways[a] + state.ways[b]
        if state.bound[p] < wanted:
            state.bound[p] = ball_bound(bodies, state.poses, state.middle, a, b)
        if state.bound[p] < wanted:
            state.bound[p] = pair_distance(bodies, state.poses, a, b, wanted + _AHEAD_MM, here)
            if state.bound[p] < wanted:
                best, code = state.bound[p], p
                back(state.world[watch.table], here, at)
                moved(watch.build_from_table, at, at)
        slack = min(slack, state.bound[p] - wanted)
    for b in range(len(bodies.kind)):
        if not watch.meets_part[b]:
            continue
        state.part_bound[b] -= state.part_ways[b]
        if state.part_bound[b] < best:
            corners = bodies.points[bodies.first[b] : bodies.last[b]]
            distance, place_of = nearest_point(
                forest, step, bodies.kind[b], bodies.size[b], corners, state.in_part[b], best + _AHEAD_MM, state.warm[b], stack, bounds
            )
            state.part_bound[b] = distance
            if place_of >= 0:
                state.warm[b] = place_of
            if distance < best:
                best, code = distance, len(state.bound) + b
                at[:] = forest.points[place_of]
        slack = min(slack, state.part_bound[b] - best)
    return best, code, slack
