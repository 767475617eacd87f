"""Arcs in the machine's XY plane, in the place of straight moves where they are fewer: joint X and joint Y on a circle, all others still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Chain, Floats
from planner.post.arc_shape import arc_points
from planner.post.linearise import OVER, LinearOperation, Sampled, move_errors, rows_at, way_at
from planner.post.poses import Poses
from planner.post.tube import Tube, reach

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

RADIUS_MM = (0.05, 1000.0)
"""Smaller ones are corners; of greater ones the centre's rounding tells more than the bend."""
TANGENT_RAD = 0.05
"""An arc meets the path's direction at its ends within this: corners of arcs are flatter than those of straight moves."""
_LONGER = 1.5  # an arc that gets on by less than this times a straight move is not worth its longer line
_LEAST_SHARE = 0.25  # of the tube: an arc's, when the firmware's chords have taken theirs
_STILL = 1e-6  # mm or deg: joints that move less do not move
_PROBES = 64  # rows looked at within one arc; all are when the arcs are measured
_NEAR = 2.0  # half widths of the tube: rows nearer to an arc's end put no bound on it
_EVEN_UP_TO = 16  # moves between two pinned rows: so few are made equally long
_EVENINGS = 5
_SQUARE = 1e-9  # of the directions of X and Y


def with_arcs(moves: LinearOperation, cell: Cell) -> LinearOperation:
    """The same operation with arcs between pinned rows where that takes fewer moves.

    Ends of arcs lie on the pass; their middles within what the straight moves may be off, less what the firmware's chords add.
    Rapid links, and stretches where other joints than X and Y move, stay as they are.
    """
    sampled = moves.sampled
    if sampled is None or not cell.cnc.takes_arcs or not _has_square_plane(sampled.chain):
        return moves
    columns = (sampled.chain.letters.index("X"), sampled.chain.letters.index("Y"))
    if moves.places is None:
        return moves
    dropped, chord_mm = np.zeros(0, dtype=np.int64), cell.cnc.arc_tolerance_mm
    while True:
        laid = _laid(sampled, columns, moves.places, moves.poses.joints, dropped, chord_mm)
        if laid is None:
            return moves
        place, joints, bulge = laid
        errors = move_errors(sampled, place, joints, bulge)
        on_arcs = _on_arcs(place, bulge, len(errors))
        errors[on_arcs, 0] += chord_mm
        errors[:, 0] = np.maximum(errors[:, 0], _off_between(sampled, columns, place, joints, bulge, chord_mm))
        bad = np.flatnonzero((errors > OVER * sampled.budget).any(axis=1) & on_arcs)
        if bad.size == 0:
            break
        dropped = np.union1d(dropped, bad)
    rows = rows_at(sampled, place, joints)
    needs = np.zeros(len(place), dtype=np.bool_)
    needs[rows.is_first] = moves.poses.needs_positioning[moves.rows.is_first]
    tip, axis = errors.max(axis=0)
    tip, axis = float(tip) + sampled.tip_share_mm, float(axis) + sampled.axis_share_deg
    poses = Poses(joints, needs)
    return replace(moves, rows=rows, poses=poses, bulge=bulge, places=place, tip_mm=tip, axis_deg=axis)


def _on_arcs(place: Floats, bulge: Floats, count: int) -> Bools:
    """(count,) bool: rows that lie inside arcs, the moves that end at `place` with a bulge."""
    return np.asarray(bulge[np.searchsorted(place, np.arange(count), side="left")] != 0.0)


def _off_between(
    sampled: Sampled, columns: tuple[int, int], place: Floats, joints: Floats, bulge: Floats, chord_mm: float
) -> Floats:
    """(n,) mm: distance of arcs from the pass in the middle between each row and the one before, with what the control's chords add; else 0."""
    way, xy = sampled.rows.arc_mm, sampled.tube.joints[:, columns]
    move = np.searchsorted(place, np.arange(len(way)), side="left")
    rows = np.flatnonzero(bulge[move])
    move = move[rows]
    middle = 0.5 * (np.maximum(way[rows - 1], way_at(way, place[move - 1])) + way[rows])
    low, high = way_at(way, place[move - 1]), way_at(way, place[move])
    ends = joints[move - 1][:, columns], joints[move][:, columns]
    points = arc_points(*ends, bulge[move], (middle - low) / (high - low))
    step, off = xy[rows] - xy[rows - 1], points - xy[rows]
    size = np.maximum(np.linalg.norm(step, axis=1), 1e-300)
    result = np.zeros(len(way))
    result[rows] = np.abs(step[:, 0] * off[:, 1] - step[:, 1] * off[:, 0]) / size + chord_mm
    return result


def _has_square_plane(chain: Chain) -> bool:
    """Whether the chain has X and Y as linear joints at right angles."""
    linear = {joint.letter: joint for joint in chain.linear}
    if not {"X", "Y"} <= linear.keys():
        return False
    directions = dict(
        zip((joint.letter for joint in chain.linear), chain.linear_directions(np.zeros((1, 5)))[0], strict=True)
    )
    return bool(abs(float(directions["X"] @ directions["Y"])) < _SQUARE)


def _laid(
    sampled: Sampled, columns: tuple[int, int], places: Floats, vertices: Floats, dropped: Ints, chord_mm: float
) -> tuple[Floats, Floats, Floats] | None:
    """Places, joints and bulges of all vertices, with arcs in the stretches that they shorten; none if there is no such stretch.

    dropped : rows whose stretch keeps its straight moves   chord_mm : what the control's own chords of an arc may leave it by
    """
    tube, rows = sampled.tube, sampled.rows
    pins = np.flatnonzero(tube.pinned)
    wanted = _still_between(tube, pins, columns) & (rows.pass_[pins[:-1]] == rows.pass_[pins[1:]])
    wanted &= (np.diff(pins) > 2) & ~rows.is_rapid[pins[:-1]]
    wanted[np.searchsorted(pins, dropped, side="right") - 1] = False
    at = np.searchsorted(places, pins)
    xy = np.ascontiguousarray(tube.joints[:, columns])
    kept = np.ones(len(places), dtype=np.bool_)
    found: list[tuple[Floats, Floats, Floats]] = []
    for k in np.flatnonzero(wanted).tolist():
        first, last, moves = int(pins[k]), int(pins[k + 1]), int(at[k + 1] - at[k])
        width = float(sampled.budget[first + 1 : last, 0].min())
        free = width - chord_mm
        if free < _LEAST_SHARE * width or moves < 2:
            continue
        place, points, bulge = _few_moves(tube, xy, columns, first, last, (free, free / width))
        if len(place) >= moves or not bulge.any():
            continue
        kept[at[k] + 1 : at[k + 1] + 1] = False
        joints = np.repeat(tube.joints[first][None, :], len(place), axis=0)
        joints[:, columns] = points
        found.append((place, joints, bulge))
    if not found:
        return None
    place = np.concatenate([places[kept], *(item[0] for item in found)])
    joints = np.concatenate([vertices[kept], *(item[1] for item in found)])
    bulge = np.concatenate([np.zeros(int(kept.sum())), *(item[2] for item in found)])
    order = np.argsort(place, kind="stable")
    return place[order], joints[order], bulge[order]


def _still_between(tube: Tube, pins: Ints, columns: tuple[int, int]) -> Bools:
    """(k - 1,) bool: between neighbouring pinned rows (k,) only the joints of two columns move."""
    others = [k for k in range(tube.joints.shape[1]) if k not in columns]
    values = tube.joints[:, others]
    low, high = np.minimum.reduceat(values, pins)[:-1], np.maximum.reduceat(values, pins)[:-1]
    low, high = np.minimum(low, values[pins[1:]]), np.maximum(high, values[pins[1:]])
    return np.asarray((high - low < _STILL).all(axis=1))


def _few_moves(
    tube: Tube, xy: Floats, columns: tuple[int, int], first: int, last: int, free: tuple[float, float]
) -> tuple[Floats, Floats, Floats]:
    """Ends of few moves from one pinned row to the next: places (k,), points (k, 2) and bulges (k,); as long as each other if they are few.

    free : what moves may be off the path, mm, and as a share of the tube
    """
    size = last - first
    places, points, bulges = np.empty(size), np.empty((size, 2)), np.empty(size)
    count = _stretch(tube, xy, columns, first, last, free, np.inf, size, places, points, bulges)
    best = places[:count].copy(), points[:count].copy(), bulges[:count].copy()
    if 1 < count <= _EVEN_UP_TO:
        high = float(tube.way_mm[last] - tube.way_mm[first])
        low = high / count
        for _ in range(_EVENINGS):
            longest = 0.5 * (low + high)
            even = _stretch(tube, xy, columns, first, last, free, longest, count, places, points, bulges)
            if even <= count:
                high, count = longest, even
                best = places[:count].copy(), points[:count].copy(), bulges[:count].copy()
            else:
                low = longest
    return best


@njit(cache=True)
def _stretch(
    tube: Tube, xy: Floats, columns: tuple[int, int], first: int, last: int, free: tuple[float, float], longest: float, most: int,
    places: Floats, points: Floats, bulges: Floats,
) -> int:  # fmt: skip
    """Straight moves and arcs from one pinned row to the next, whichever gets on further; most + 1 when they are more than `most`."""
    way = tube.way_mm
    start, end = tube.joints[first].copy(), np.empty(5)
    begin, count, guess, guess_arc = float(first), 0, 1, 8
    while begin < last:
        if count == most:
            return most + 1
        base = int(np.floor(begin))
        here = way[base] + (begin - base) * (way[base + 1] - way[base])
        place = reach(tube, begin, start, last, guess, free[1], end)
        below = min(int(np.floor(place)), last - 1)
        gone = way[below] + (place - below) * (way[below + 1] - way[below]) - here
        row, bulge = _arc_reach(
            xy, way, begin, here, start[columns[0]], start[columns[1]], last, free[0], longest, guess_arc
        )
        is_arc = bulge != 0.0 and (way[row] - here >= _LONGER * gone or (row == last and place < last))
        if is_arc:
            guess_arc = max(row - base, 2)
            end[:] = tube.joints[row]
            place = float(row)
        else:
            guess = max(int(place - begin) - 1, 1)
        places[count], bulges[count] = place, bulge if is_arc else 0.0
        points[count, 0], points[count, 1] = end[columns[0]], end[columns[1]]
        begin = place
        start[:] = end
        count += 1
    return count


@njit(cache=True)
def _arc_reach(
    xy: Floats, way: Floats, begin: float, here: float, x: float, y: float, last: int, free: float, longest: float, guess: int
) -> tuple[int, float]:  # fmt: skip
    """Furthest row where an arc from (x, y) beside place `begin` can end, and its bulge; 0 where there is none that the control takes."""
    base = int(np.floor(begin))
    limit = last
    while limit > base + 1 and way[limit] - here > longest * (1.0 + 1e-9):
        limit -= 1
    good, bad, step, bulge = base + 1, limit + 1, max(guess, 2), 0.0
    while good < limit and bad - good > 1:
        row = min(good + step, limit) if bad > limit else (good + bad) // 2
        fits, found = _fitted(xy, base, x, y, row, free)
        if fits:
            good, bulge = row, found
            step *= 2
        else:
            bad = row
    half_chord = 0.5 * np.hypot(xy[good, 0] - x, xy[good, 1] - y)
    if bulge == 0.0:
        return good, 0.0
    radius = half_chord * (1.0 + bulge * bulge) / (2.0 * abs(bulge))
    if radius < RADIUS_MM[0] or radius > RADIUS_MM[1]:
        return good, 0.0
    first = base if begin == base else base + 1
    if good < first + 3 or not _is_tangent(xy, way, first, here, x, y, good, bulge):
        return good, 0.0
    return good, bulge


@njit(cache=True)
def _fitted(xy: Floats, base: int, x: float, y: float, row: int, free: float) -> tuple[bool, float]:
    """Whether an arc from (x, y) to a row passes all rows between within `free`, mm, and the bulge in the middle of those that do.

    Arcs with the same ends are ordered by their bulge, and each row bounds it from both sides.
    """
    low, high = -1.0, 1.0
    half = 0.5 * np.hypot(xy[row, 0] - x, xy[row, 1] - y)
    if half < free:
        return False, 0.0
    frame = (
        0.5 * (xy[row, 0] + x),
        0.5 * (xy[row, 1] + y),
        0.5 * (xy[row, 0] - x) / half,
        0.5 * (xy[row, 1] - y) / half,
    )
    stride = 1 + (row - base - 1) // _PROBES
    k = row - 1
    while k > base:
        ahead = xy[k + 1] - xy[k]
        here = _bulges(frame, half, xy[k], xy[k + 1] - xy[k - 1], free)
        between = _bulges(frame, half, xy[k] + 0.5 * ahead, ahead, free)
        low, high = max(low, here[0], between[0]), min(high, here[1], between[1])
        if low > high:
            return False, 0.0
        k -= stride
    begin = np.array([x, y])
    ahead = xy[base + 1] - begin
    between = _bulges(frame, half, begin + 0.5 * ahead, ahead, free)
    low, high = max(low, between[0]), min(high, between[1])
    return low <= high, 0.5 * (low + high)


@njit(cache=True)
def _bulges(
    frame: tuple[float, float, float, float], half: float, point: Floats, way: Floats, free: float
) -> tuple[float, float]:
    """Between which bulges an arc over a chord passes a point (2,) within `free`, mm, of it on both sides of its way (2,).

    frame : middle of the chord and its direction   half : of its length
    """
    mx, my, ex, ey = frame
    px, py = point[0] - mx, point[1] - my
    size = np.hypot(way[0], way[1])
    along, right = px * ex + py * ey, px * ey - py * ex
    if size == 0.0 or min(np.hypot(along - half, right), np.hypot(along + half, right)) <= _NEAR * free:
        return -1.0, 1.0
    nx, ny = -way[1] / size * free, way[0] / size * free
    a, b = nx * ex + ny * ey, nx * ey - ny * ex
    one, two = _bulge_through(half, along + a, right + b), _bulge_through(half, along - a, right - b)
    return min(one, two), max(one, two)


@njit(cache=True)
def _bulge_through(half: float, along: float, right: float) -> float:
    """Bulge of the arc over a chord from -half to half through a point beside it."""
    across = 2.0 * half * right
    power = half * half - along * along - right * right
    below = np.hypot(power, across) + power
    return float(across / below) if below > 1e-12 * half * half else float(np.copysign(1e9, across))


@njit(cache=True)
def _is_tangent(xy: Floats, way: Floats, first: int, here: float, x: float, y: float, row: int, bulge: float) -> bool:
    """Whether an arc from (x, y) meets the path's direction at both ends; first : the first row that lies ahead of it."""
    chord = np.arctan2(xy[row, 1] - y, xy[row, 0] - x)
    turn = 2.0 * np.arctan(bulge)
    off = chord - turn - _direction(xy, way, first, first + 1, first + 2, here)
    end = chord + turn - _direction(xy, way, row - 2, row - 1, row, way[row])
    return bool(abs(np.sin(0.5 * off)) < 0.5 * TANGENT_RAD and abs(np.sin(0.5 * end)) < 0.5 * TANGENT_RAD)


@njit(cache=True)
def _direction(xy: Floats, way: Floats, a: int, b: int, c: int, at: float) -> float:
    """Direction, rad, of the path at a way `at`, mm, from three rows near it: it turns evenly there."""
    one = np.arctan2(xy[b, 1] - xy[a, 1], xy[b, 0] - xy[a, 0])
    turn = np.arctan2(xy[c, 1] - xy[b, 1], xy[c, 0] - xy[b, 0]) - one
    turn -= 2.0 * np.pi * np.round(turn / (2.0 * np.pi))
    span = 0.5 * (way[c] - way[a])
    return float(one + turn * (at - 0.5 * (way[a] + way[b])) / span) if span > 0.0 else float(one)
