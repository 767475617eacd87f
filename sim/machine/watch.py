"""Conservative advancement: solids are measured only when, since the last time, they may have come as near as matters.

Every pair has an odometer: a bound of how far any points of the two have moved against each other. A pair that was d apart cannot touch
before its odometer has gone on by d. For two solids of the machine it counts the joints between them, each with the longest arm it can
have (`sim.machine.reach`); for a solid and the stock, the solid's own way in the frame of the table from pose to pose. Between two poses a
point strays from its straight way by at most an eighth of its greatest acceleration; pieces are cut so that this stays small, and it is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.machine.against_solids import pair_distance
from sim.machine.against_stock import stock_distance
from sim.machine.bodies import Bodies, body_distance, is_round
from sim.machine.links import Links, multiply, place
from sim.process.field import Blocks

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STEP_MM = 0.5  # of motion between two looks at solids that are nearly together
TOUCHED_MM = 1e-6  # of motion after which things that are in each other are looked at again, at the next stop
TURN_RAD = 0.02  # of all rotary joints together, between two poses
STOCK = -1  # the partner, where it is the stock
HIT_COLUMNS = 7  # first solid, second or STOCK, piece, depth or gap mm, place mm (table frame)


class Rules(NamedTuple):
    """What is watched. pair : (p, 2) solids   allowed : (p,) mm of overlap, a bound for both kinds of contact.

    counts : (p,) 1 where the pair's gap counts as clearance   meets_stock : (n,) 1 for solids that must not touch the stock
    reach : (carriers, p) mm of relative motion for a unit of each joint
    contact : (1,) mm of overlap with the stock that is rounding   lever : (1,) mm, farthest point from any rotary axis
    """

    pair: Index
    allowed: Array
    counts: Index
    meets_stock: Index
    reach: Array
    contact: Array
    lever: Array


class Odometers(NamedTuple):
    """State between steps. world, table : (carriers, 3, 4) last pose
    of_pair : (p,) mm, odometers of the pairs   in_table : (n,) mm, odometers of the solids against the stock

    pair_due : (p,), stock_due : (n,) mm   Readings at which to measure again; of pairs that are not mounted: never.
    active : (n,) 1 for the solids that are mounted now   hits : (h, HIT_COLUMNS)   found : (1,) rows of hits
    nearest : (HIT_COLUMNS,)   the least gap so far; nearest[3] begins with the gap above which nobody asks
    """

    world: Array
    table: Array
    of_pair: Array
    in_table: Array
    pair_due: Array
    stock_due: Array
    active: Index
    hits: Array
    found: Index
    nearest: Array


class Stand(NamedTuple):
    """The stock: its blocks, the groups of them that are not air, and (3, 4) its frame from the table's."""

    blocks: Blocks
    mask: NDArray[np.uint8]
    from_table: Array


@njit(cache=True, nogil=True)
def _moved(bodies: Bodies, b: int, before: Array, after: Array) -> float:
    """Bound on the straight way of any point of a solid between two motions (3, 4) of its carrier, mm."""
    c = bodies.centre[b]
    way2, turn2 = 0.0, 0.0
    for i in range(3):
        d = after[i, 3] - before[i, 3]
        for j in range(3):
            d += (after[i, j] - before[i, j]) * c[j]
        way2 += d * d
    if is_round(bodies, b):
        for i in range(3):
            d = 0.0
            for j in range(3):
                d += (after[i, j] - before[i, j]) * bodies.pose[b, j, 2]
            turn2 += d * d
    else:
        for i in range(3):
            for j in range(3):
                turn2 += 0.5 * (after[i, j] - before[i, j]) ** 2
    return float(np.sqrt(way2) + bodies.radius[b] * np.sqrt(turn2))


@njit(cache=True, nogil=True)
def _go(bodies: Bodies, rules: Rules, state: Odometers, table: Array, stray: float, ways: Array) -> None:
    """Ways (n,) of all mounted solids against the stock, from the last pose to a new one."""
    for b in range(len(bodies.kind)):
        ways[b] = 0.0
        if state.active[b] and rules.meets_stock[b]:
            n = bodies.carrier[b]
            way = _moved(bodies, b, state.table[n], table[n])
            ways[b] = way + stray if way > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _pair_ways(rules: Rules, moves: Array, of_pairs: Array) -> None:
    """Ways (p,) of all pairs for moves (carriers,) of their joints."""
    of_pairs[:] = 0.0
    for n in range(len(moves)):
        if moves[n] != 0.0:
            for p in range(len(of_pairs)):
                of_pairs[p] += rules.reach[n, p] * moves[n]


@njit(cache=True, nogil=True)
def _first_due(state: Odometers, of_pairs: Array, share: float, ways: Array) -> float:
    """Where on the way the first thing has to be measured, as a share of it, and no sooner than after STEP_MM; 2: nothing has.

    of_pairs : (p,), of which `share` is gone on this way   ways : (n,) against the stock
    """
    first = 2.0
    for p in range(len(of_pairs)):
        way = share * of_pairs[p]
        if state.of_pair[p] + way >= state.pair_due[p] and way > 0.0:
            first = min(first, max(state.pair_due[p] - state.of_pair[p], STEP_MM) / way, 1.0)
    for b in range(len(ways)):
        if ways[b] > 0.0 and state.in_table[b] + ways[b] >= state.stock_due[b]:
            first = min(first, max(state.stock_due[b] - state.in_table[b], STEP_MM) / ways[b], 1.0)
    return first


@njit(cache=True, nogil=True)
def _commit(state: Odometers, world: Array, table: Array, of_pairs: Array, share: float, ways: Array) -> None:
    """Take a new pose; pairs have moved by a share of `of_pairs`, solids against the stock by `ways`."""
    state.world[:] = world
    state.table[:] = table
    for p in range(len(of_pairs)):
        state.of_pair[p] += share * of_pairs[p]
    for b in range(len(ways)):
        state.in_table[b] += ways[b]


@njit(cache=True, nogil=True)
def _note(state: Odometers, line: Index, a: int, b: int, piece: int, depth: float, at: Array) -> None:
    """Keep a hit; of several of one pair in one line, the deepest."""
    row = state.found[0]
    for n in range(state.found[0]):
        hit = state.hits[n]
        if hit[0] == a and hit[1] == b and line[int(hit[2])] == line[piece]:
            if depth <= hit[3]:
                return
            row = n
    if row == len(state.hits):
        return
    state.hits[row, 0], state.hits[row, 1], state.hits[row, 2], state.hits[row, 3] = a, b, piece, depth
    state.hits[row, 4:] = at
    state.found[0] = max(state.found[0], row + 1)


@njit(cache=True, nogil=True)
def _to_table(links: Links, state: Odometers, at: Array) -> None:
    """A point of the machine frame into the table's, in place."""
    pose = state.world[links.table[0]]
    x, y, z = at[0] - pose[0, 3], at[1] - pose[1, 3], at[2] - pose[2, 3]
    for i in range(3):
        at[i] = pose[0, i] * x + pose[1, i] * y + pose[2, i] * z


@njit(cache=True, nogil=True)
def _measure_pairs(links: Links, bodies: Bodies, rules: Rules, state: Odometers, line: Index, piece: int) -> None:
    """Measure the pairs that are due at the last pose."""
    pose_a, pose_b = np.empty((3, 4)), np.empty((3, 4))
    at = np.empty(3)
    for p in range(len(rules.pair)):
        reading = state.of_pair[p]
        if reading < state.pair_due[p]:
            continue
        a, b = rules.pair[p, 0], rules.pair[p, 1]
        multiply(state.world[bodies.carrier[a]], bodies.pose[a], pose_a)
        multiply(state.world[bodies.carrier[b]], bodies.pose[b], pose_b)
        gap = pair_distance(bodies, a, b, pose_a, pose_b, rules.allowed[p], at)
        wanted = min(state.nearest[3], gap) if rules.counts[p] else 0.0
        state.pair_due[p] = reading + max(STEP_MM, gap - max(0.0, wanted))
        if gap < -rules.allowed[p]:
            state.pair_due[p] = reading + TOUCHED_MM
            _to_table(links, state, at)
            _note(state, line, a, b, piece, -gap, at)
        elif rules.counts[p] and gap < state.nearest[3]:
            _to_table(links, state, at)
            _keep_nearest(state, a, b, piece, gap, at)


@njit(cache=True, nogil=True)
def _keep_nearest(state: Odometers, a: int, b: int, piece: int, gap: float, at: Array) -> None:
    state.nearest[0], state.nearest[1], state.nearest[2], state.nearest[3] = a, b, piece, max(0.0, gap)
    state.nearest[4:] = at


@njit(cache=True, nogil=True)
def _measure_stock(bodies: Bodies, rules: Rules, state: Odometers, stand: Stand, line: Index, piece: int) -> None:
    """Measure what is due against the stock at the last pose."""
    turned, pose = np.empty((3, 4)), np.empty((3, 4))
    at, place_of = np.zeros(3), np.zeros(3)
    for b in range(len(rules.meets_stock)):
        if not (rules.meets_stock[b] and state.active[b]) or state.in_table[b] < state.stock_due[b]:
            continue
        multiply(state.table[bodies.carrier[b]], bodies.pose[b], turned)
        multiply(stand.from_table, turned, pose)
        gap = stock_distance(bodies, b, pose, stand.blocks, stand.mask, at)
        state.stock_due[b] = state.in_table[b] + max(STEP_MM, gap - max(0.0, min(state.nearest[3], gap)))
        if gap < state.nearest[3]:
            frame = stand.from_table
            x, y, z = at[0] - frame[0, 3], at[1] - frame[1, 3], at[2] - frame[2, 3]
            for i in range(3):
                place_of[i] = frame[0, i] * x + frame[1, i] * y + frame[2, i] * z
            if gap < -rules.contact[0]:
                state.stock_due[b] = state.in_table[b] + TOUCHED_MM
                _note(state, line, b, int(np.int64(STOCK)), piece, -gap, place_of)
            else:
                _keep_nearest(state, b, int(np.int64(STOCK)), piece, gap, place_of)


@njit(cache=True, nogil=True)
def _expect_metal(bodies: Bodies, rules: Rules, state: Odometers, tip: Array, room: float) -> None:
    """New metal may stand within `room` of a tip (table frame): nothing is surely farther from the stock than from there."""
    for b in range(len(rules.meets_stock)):
        if rules.meets_stock[b] and state.active[b]:
            frame, c = state.table[bodies.carrier[b]], bodies.centre[b]
            away2 = 0.0
            for i in range(3):
                away2 += (frame[i, 0] * c[0] + frame[i, 1] * c[1] + frame[i, 2] * c[2] + frame[i, 3] - tip[i]) ** 2
            away = np.sqrt(away2) - bodies.radius[b]
            if away - room - state.nearest[3] < state.stock_due[b] - state.in_table[b]:
                away = _from_solid(bodies, b, frame, tip)
                state.stock_due[b] = min(state.stock_due[b], state.in_table[b] + max(0.0, away - room - state.nearest[3]))


@njit(cache=True, nogil=True)
def follow(
    links: Links, bodies: Bodies, rules: Rules, state: Odometers, stand: Stand,
    joints: Array, slide: Array, line: Index, tip: Array, room: Array,
) -> None:  # fmt: skip
    """Watch all solids along pieces of motion; what was found is in `state`.

    joints : (k + 1, n) mm or deg, or (k, 2, n) flattened: begin and end of each piece   slide : (k + 1,)
    line : (k,)   tip : (k, 3) mm, table frame, at the piece's begin   room : (k,) mm   Reach of metal laid on the piece; 0: none.
    """
    world, table = np.empty_like(state.world), np.empty_like(state.table)
    ways, moves, of_pairs = np.zeros(len(bodies.kind)), np.zeros(len(links.column)), np.zeros(len(rules.pair))
    for piece in range(len(line)):
        start, end = joints[2 * piece], joints[2 * piece + 1]
        if piece == 0:
            place(links, start, slide[0], world, table)
            _go(bodies, rules, state, table, 0.0, ways)
            _commit(state, world, table, of_pairs, 0.0, ways)
            _measure_pairs(links, bodies, rules, state, line, piece)
            _measure_stock(bodies, rules, state, stand, line, piece)
        if room[piece] > 0.0:
            _expect_metal(bodies, rules, state, tip[piece], room[piece])
        turn, way = _moves(links, start, end, abs(slide[piece + 1] - slide[piece]), moves)
        if turn == 0.0 and way == 0.0:
            continue
        parts = max(1, int(np.ceil(turn / TURN_RAD)))
        _pair_ways(rules, moves, of_pairs)
        stray = (turn * turn * rules.lever[0] + 2.0 * turn * way) / (8.0 * parts * parts)
        for part in range(parts):
            slides = (slide[piece], slide[piece + 1])
            _follow_part(links, bodies, rules, state, stand, start, end, slides, line, piece, (part, parts), stray, world, table, of_pairs, ways)


@njit(cache=True, nogil=True)
def _moves(links: Links, start: Array, end: Array, slide: float, moves: Array) -> tuple[float, float]:
    """Ways of all joints, into moves (mm, rad, share of the slide's way); sums of the rotary (rad) and of the linear ones (mm)."""
    turn, way = 0.0, 0.0
    for n in range(len(links.column)):
        column = links.column[n]
        if column == -2:
            moves[n] = slide
            park = links.direction[n]
            way += slide * np.sqrt(park[0] ** 2 + park[1] ** 2 + park[2] ** 2)
        elif column >= 0 and links.is_rotary[n]:
            moves[n] = np.radians(abs(end[column] - start[column]))
            turn += moves[n]
        elif column >= 0:
            moves[n] = abs(end[column] - start[column])
            way += moves[n]
    return turn, way


@njit(cache=True, nogil=True)
def _follow_part(
    links: Links, bodies: Bodies, rules: Rules, state: Odometers, stand: Stand, start: Array, end: Array, slides: tuple[float, float],
    line: Index, piece: int, part: tuple[int, int], stray: float, world: Array, table: Array, of_pairs: Array, ways: Array,
) -> None:  # fmt: skip
    """Go on over one of the equal parts of a piece, with a stop wherever something has to be measured. part : its number, and how many

    stray : mm, of the whole part; that of a share of it goes with its square
    """
    at, finish = part[0] / part[1], (part[0] + 1) / part[1]
    while True:
        left = finish - at
        rest = left * part[1]
        place(links, start + finish * (end - start), slides[0] + finish * (slides[1] - slides[0]), world, table)
        _go(bodies, rules, state, table, stray * rest * rest, ways)
        first = _first_due(state, of_pairs, left, ways)
        if first > 1.0:
            _commit(state, world, table, of_pairs, left, ways)
            return
        if first < 1.0:
            left *= first
            at += left
            rest *= first
            place(links, start + at * (end - start), slides[0] + at * (slides[1] - slides[0]), world, table)
            _go(bodies, rules, state, table, stray * rest * rest, ways)
        _commit(state, world, table, of_pairs, left, ways)
        _measure_pairs(links, bodies, rules, state, line, piece)
        _measure_stock(bodies, rules, state, stand, line, piece)
        if first == 1.0:
            return


@njit(cache=True, nogil=True)
def _from_solid(bodies: Bodies, b: int, frame: Array, point: Array) -> float:
    """Signed distance of a point, mm, from a solid whose carrier has moved by `frame`."""
    pose = np.empty((3, 4))
    multiply(frame, bodies.pose[b], pose)
    x, y, z = point[0] - pose[0, 3], point[1] - pose[1, 3], point[2] - pose[2, 3]
    own = np.empty(3)
    for i in range(3):
        own[i] = pose[0, i] * x + pose[1, i] * y + pose[2, i] * z
    return float(body_distance(bodies, b, own[0], own[1], own[2]))
