"""The tube about sampled joints that straight moves have to stay in, and few straight moves through it.

The middle of the tube is the polyline of the samples. A vertex of the moves lies anywhere on a sample's line outward, that is to the side
that the path bends away from, within the tube: a move leaves the path to both sides, and is longer by a factor of up to sqrt(2) for it.
For one beginning the ends that a move can have at one place are an interval, since the rows between put two-sided bounds on it that are
convex; the furthest place with an interval that is not empty is searched for, and its outermost end is where the next move begins.
Source: ordered stabbing, Guibas, Hershberger, Mitchell & Snoeyink, Approximating Polygons and Subdivisions with Minimum-Link Paths (1993).
"""  # fmt: skip

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_SMOOTH_COSINE = 0.9  # of the angle between neighbouring steps: a corner that turns more has no tangent
_BENT = 0.5  # of its half width: a window of the path that leaves its chord by so much shows which way is outward
_STRAIGHT = 1e-3  # of the tube's half width: what bends less than this has no outward side
_WINDOW_MAX = 64  # rows to each side
_PROBES = 32  # rows looked at within one move; what they miss is found when the moves are checked at every row
_FRACTIONS = 4  # halvings of the way between two rows, when the furthest end of a move is searched
_EVEN_UP_TO = 6  # moves between two pinned rows: so few are made equally long
_EVENINGS = 5  # halvings of the tube when they are
_EVEN_LEAST = 0.2  # of the tube's half width
_TURN_MOST = 10.0  # of what the axis may be off: how far a rotary joint is turned out of the way, however little that does at a pole
_NO_SLOPE = 1e-18  # square of a way off that is none


class Tube(NamedTuple):
    """Samples with the measure of how far joints may be off there.

    joints : (n, 5) float   way_mm : (n,) float, arc length, increasing within a pass   pinned : (n,) bool, ends of passes and the like
    weight : (n, 6, 5) float: joints that are off (5,) bring the tip (rows 0 to 2) and the axis (rows 3 to 5) off by this, in units of what is allowed
    bend : (n, 2) float: what the square of the rotary part, rad^2, adds to both in second order
    outward : (n, 5) float: the way out of the bend, at most 1 unit long   is_rotary : (5,) bool
    """  # fmt: skip

    joints: Floats
    way_mm: Floats
    pinned: Bools
    weight: Floats
    bend: Floats
    outward: Floats
    is_rotary: Bools


def tube_about(
    joints: Floats, way_mm: Floats, pinned: Bools, per_joint: Floats, is_rotary: Bools, budget: Floats
) -> Tube:
    """The tube of samples.

    per_joint : (n, 6, 5) float, mm and deg per mm or degree of each joint   budget : (n, 2) float, mm and deg, off the path
    Where the path is smooth, what is off along it is not off.
    """
    weight, rate, along = _across(joints, way_mm, pinned, per_joint)
    weight[:, :3] /= budget[:, 0].reshape(-1, 1, 1)
    weight[:, 3:] /= budget[:, 1].reshape(-1, 1, 1)
    reach = np.rad2deg(np.linalg.norm(per_joint[:, :3][:, :, is_rotary], axis=1)).sum(axis=1)
    bend = 0.5 * np.column_stack([reach / budget[:, 0], np.rad2deg(1.0) / budget[:, 1]])
    outward = _outward(joints, way_mm, pinned, weight, rate, along)
    turn = np.abs(outward[:, is_rotary]).max(axis=1, initial=0.0) / (_TURN_MOST * budget[:, 1])
    outward /= np.maximum(turn, 1.0)[:, None]
    return Tube(joints, way_mm, pinned, weight, bend, outward, is_rotary)


def straight_moves(tube: Tube, pinned: Bools) -> tuple[Floats, Floats]:
    """Vertices of few straight moves through a tube: their places (k,), in rows and fractions of rows, and joints (k, 5).

    pinned : (n,) bool, rows that are vertices, exactly; ends of passes among them
    """
    place, joints, count = _straight_moves(tube, pinned)
    return place[:count], joints[:count]


def _across(joints: Floats, way_mm: Floats, pinned: Bools, per_joint: Floats) -> tuple[Floats, Floats, Floats]:
    """per_joint (n, 6, 5) without what is off along the path: the tip's share along the tangent, and the axis' turn on that way.

    Also joints per mm of the way (n, 5), and the way, mm, per mm or degree of each joint (n, 5); zero where the path is not smooth.
    """
    weight, along = np.array(per_joint), np.zeros_like(joints)
    if len(joints) < 3:
        return weight, along, along
    step, gone = np.diff(joints, axis=0), np.diff(way_mm)
    tangent = np.zeros_like(joints)
    both = np.flatnonzero(~pinned[1:-1] & (gone[:-1] > 0.0) & (gone[1:] > 0.0)) + 1
    rate = step / np.where(gone > 0.0, gone, 1.0)[:, None]
    before = np.einsum("nij,nj->ni", per_joint[both, :3], rate[both - 1])
    after = np.einsum("nij,nj->ni", per_joint[both, :3], rate[both])
    size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    smooth = both[np.einsum("ij,ij->i", before, after) > _SMOOTH_COSINE * np.maximum(size, 1e-300)]
    tangent[smooth] = (joints[smooth + 1] - joints[smooth - 1]) / (way_mm[smooth + 1] - way_mm[smooth - 1])[:, None]
    moved = np.einsum("nij,nj->ni", per_joint[smooth], tangent[smooth])
    speed = np.linalg.norm(moved[:, :3], axis=1, keepdims=True)
    along[smooth] = np.einsum("ni,nij->nj", moved[:, :3] / speed, per_joint[smooth, :3])
    tangent[smooth] /= speed
    weight[smooth] -= np.einsum("ni,nj->nij", moved / speed, along[smooth])
    return weight, tangent, along


@njit(cache=True)
def _outward(joints: Floats, way_mm: Floats, pinned: Bools, weight: Floats, rate: Floats, along: Floats) -> Floats:
    """(n, 5) float: from the chord of a window about each row to the row, 1 unit long; zero on pinned rows and where the path is straight."""
    n = len(joints)
    found = np.zeros_like(joints)
    off = np.zeros(5)
    left, right = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for row in range(1, n):
        left[row] = row if pinned[row] else left[row - 1]
    right[n - 1] = n - 1
    for row in range(n - 2, -1, -1):
        right[row] = row if pinned[row] else right[row + 1]
    for row in range(n):
        if pinned[row]:
            continue
        half = 1
        while True:
            low, high = max(row - half, left[row]), min(row + half, right[row])
            gone = way_mm[high] - way_mm[low]
            if gone <= 0.0:
                break
            share = (way_mm[row] - way_mm[low]) / gone
            for k in range(5):
                off[k] = joints[row, k] - joints[low, k] - share * (joints[high, k] - joints[low, k])
            gone = 0.0
            for k in range(5):
                gone += along[row, k] * off[k]
            off -= gone * rate[row]
            tip, axis = _units(weight[row], off)
            size = np.sqrt(max(tip, axis))
            if size > _STRAIGHT:
                for k in range(5):
                    found[row, k] = off[k] / size
            if size > _BENT or half >= _WINDOW_MAX or (low == left[row] and high == right[row]):
                break
            half *= 2
    return found


@njit(cache=True)
def _units(weight: Floats, off: Floats) -> tuple[float, float]:
    """Squares of how far tip and axis are off, in units of what is allowed."""
    tip, axis = 0.0, 0.0
    for k in range(3):
        a, b = 0.0, 0.0
        for j in range(5):
            a += weight[k, j] * off[j]
            b += weight[3 + k, j] * off[j]
        tip += a * a
        axis += b * b
    return tip, axis


@njit(cache=True)
def _ends(
    tube: Tube, begin: float, start: Floats, place: float, end: Floats, out: Floats, width: float
) -> tuple[float, float]:
    """Between which multiples of `out` the end of a move may lie off `end`, all rows on the way within the tube; (1, -1) if nowhere."""
    low, high = -width, width
    first, last = int(np.floor(begin)) + 1, int(np.ceil(place)) - 1
    if last < first:
        return low, high
    way = tube.way_mm
    at = way[first - 1] + (begin - (first - 1)) * (way[first] - way[first - 1])
    gone = way[last] + (place - last) * (way[last + 1] - way[last]) - at
    if gone <= 0.0:
        return 1.0, -1.0
    stride = 1 + (last - first) // _PROBES
    off, slope = np.empty(5), np.empty(5)
    row = last
    while row >= first:
        share = (way[row] - at) / gone
        turn = 0.0
        for k in range(5):
            off[k] = start[k] + share * (end[k] - start[k]) - tube.joints[row, k]
            slope[k] = share * out[k]
            if tube.is_rotary[k]:
                turn += abs(off[k])
        turn = (np.pi / 180.0 * turn) ** 2
        for part in range(2):
            here = _bounds(tube.weight[row, 3 * part : 3 * part + 3], off, slope, width - tube.bend[row, part] * turn)
            low, high = max(low, here[0]), min(high, here[1])
            if low > high:
                return 1.0, -1.0
        row -= stride
    return low, high


@njit(cache=True)
def _bounds(weight: Floats, off: Floats, slope: Floats, radius: float) -> tuple[float, float]:
    """Between which multiples of `slope` (5,), added to `off` (5,), weight (3, 5) brings it into a ball; (1, -1) if nowhere."""
    aa, ab, bb = 0.0, 0.0, 0.0
    for k in range(3):
        a, b = 0.0, 0.0
        for j in range(5):
            a += weight[k, j] * off[j]
            b += weight[k, j] * slope[j]
        aa += a * a
        ab += a * b
        bb += b * b
    over = aa - radius * radius
    if radius <= 0.0:
        return 1.0, -1.0
    if bb < _NO_SLOPE:
        return (-np.inf, np.inf) if over <= 0.0 else (1.0, -1.0)
    root = ab * ab - bb * over
    if root < 0.0:
        return 1.0, -1.0
    root = np.sqrt(root)
    return (-ab - root) / bb, (-ab + root) / bb


@njit(cache=True)
def reach(tube: Tube, begin: float, start: Floats, limit: int, guess: int, width: float, end: Floats) -> float:
    """Furthest place where a straight move may end that begins at joints `start` (5,) beside place `begin`.

    limit : row that it does not pass, and meets exactly   guess : rows that it will take, or so   width : of the tube, 1: all of it
    end : (5,) float, its joints are written there
    """
    base = int(np.floor(begin))
    nothing = np.zeros(5)
    good, bad, step = base + 1, limit + 1, max(guess, 1)
    offset = 0.0
    while good < limit and bad - good > 1:
        row = min(good + step, limit) if bad > limit else (good + bad) // 2
        out = nothing if row == limit else tube.outward[row]
        low, high = _ends(tube, begin, start, float(row), tube.joints[row], out, width)
        if low <= high:
            good, offset = row, high
            step *= 2
        else:
            bad = row
    if good == limit:
        end[:] = tube.joints[limit]
        return float(good)
    if good == base + 1:
        offset = width
    end[:] = tube.joints[good] + offset * tube.outward[good]
    return _between(tube, begin, start, good, width, end)


@njit(cache=True)
def _between(tube: Tube, begin: float, start: Floats, good: int, width: float, end: Floats) -> float:
    """The furthest place between row `good` and the next, its joints in `end` if it is not that row."""
    middle, out = np.empty(5), np.empty(5)
    place, part, half = float(good), 0.0, 0.5
    for _ in range(_FRACTIONS):
        share = part + half
        for k in range(5):
            middle[k] = tube.joints[good, k] + share * (tube.joints[good + 1, k] - tube.joints[good, k])
            out[k] = tube.outward[good, k] + share * (tube.outward[good + 1, k] - tube.outward[good, k])
        low, high = _ends(tube, begin, start, good + share, middle, out, width)
        if low <= high:
            part, place = share, good + share
            end[:] = middle + high * out
        half *= 0.5
    return place


@njit(cache=True)
def _stretch(tube: Tube, first: int, last: int, width: float, most: int, places: Floats, vertices: Floats) -> int:
    """Moves from one pinned row to the next, their ends in `places` and `vertices`; most + 1 when they are more than `most`."""
    start, end = tube.joints[first].copy(), np.empty(5)
    begin, count, guess = float(first), 0, 1
    while begin < last:
        if count == most:
            return most + 1
        place = reach(tube, begin, start, last, guess, width, end)
        guess = max(int(place - begin) - 1, 1)
        places[count], begin = place, place
        vertices[count] = end
        start[:] = end
        count += 1
    return count


@njit(cache=True)
def _straight_moves(tube: Tube, pinned: Bools) -> tuple[Floats, Floats, int]:
    """Places and joints of all vertices, and how many: between pinned rows as few as the tube allows, few ones as far inside it as they go."""
    n = len(tube.way_mm)
    places, vertices = np.empty(n), np.empty((n, 5))
    places[0], vertices[0], count = 0.0, tube.joints[0], 1
    trial_places, trial = np.empty(_EVEN_UP_TO), np.empty((_EVEN_UP_TO, 5))
    first = 0
    while first < n - 1:
        last = first + 1
        while not pinned[last]:
            last += 1
        moves = _stretch(tube, first, last, 1.0, n, places[count:], vertices[count:])
        if 1 < moves <= _EVEN_UP_TO:
            low, high = _EVEN_LEAST, 1.0
            for _ in range(_EVENINGS):
                width = 0.5 * (low + high)
                narrow = _stretch(tube, first, last, width, moves, trial_places, trial)
                if narrow <= moves:
                    high, moves = width, narrow
                    places[count : count + moves] = trial_places[:moves]
                    vertices[count : count + moves] = trial[:moves]
                else:
                    low = width
        count += moves
        first = last
    return places, vertices, count
