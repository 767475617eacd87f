"""Point to point along two contours: where the surface has the same normal, straight runs in proportion."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.matching.outline import DIRECTION, PARAMETER, Outline, rows_at

Floats = NDArray[np.float64]

_SAMPLES = 160  # on the whole contour for the search
_FINE = 3  # times as many for the refinement, which finds places between samples
_LONGEST_STEP = 4  # samples on the top contour that one step on the bottom contour may cover in the search
_STRETCH = 4e-3  # rad²: what uneven progress costs against a difference of directions
_SAGS = (0.0, 0.3, 1.0, 4.0)
"""rad: what a ruling that leaves the surface by an eighth of the layer's thickness costs. 0 gives developable walls and
is kept where it does; else the one whose rulings sag least."""
_DEVELOPABLE = float(np.radians(5.0))  # largest turn between the ends of a ruling up to which no other is tried
_WORTH = 0.95  # of the sag: another matching must be better by this factor
_APART = 1.0  # rad²: what a distance of the contour's whole length costs in the search
_ROUNDS = 10


def match_outlines(low: Outline, high: Outline, anchors: Floats) -> tuple[Floats, Floats]:
    """Measures of the bottom and the top outline that belong together: (k,) and (k,) float, both not decreasing.

    anchors : (a, 2, 2) float   for corners that one crease joins: measures before and behind the turn, of low and high
    The last row is the first, one round on. Ends of a ruling have parallel tangents where the contours allow: the wall
    is then developable, and of all rulings through a point of a convex wall this one leaves it least. On straight runs
    progress is even. Where tangents turn between the ends, the ruling's sag R·(n1 - n0) / 8, by which its middle leaves
    the surface, counts too: surfaces that bend both ways hold other straight lines.
    """
    spans = _spans(low, high, anchors)
    pieces = []
    for start, stop in spans:
        best, least = np.vstack([start, stop]), np.inf
        for sag in _SAGS:
            table, turn, leaves = _match_span(low, high, start, stop, not len(anchors), sag)
            if leaves < _WORTH * least:
                best, least = table, leaves
            if turn <= _DEVELOPABLE:
                break
        pieces.append(best)
    if len(anchors):
        pieces.append(pieces[0][:1] + 1.0)
    table = np.vstack(pieces)
    return np.maximum.accumulate(table[:, 0]), np.maximum.accumulate(table[:, 1])


def _spans(low: Outline, high: Outline, anchors: Floats) -> list[tuple[Floats, Floats]]:
    """Start and stop, (2,) float measures each, of the stretches between anchored corners; the whole round without."""
    if not len(anchors):
        first = _start(low, high)
        return [(first, first + 1.0)]
    behind, before = anchors[:, :, 1], np.roll(anchors[:, :, 0], -1, axis=0)
    behind = behind + np.cumsum(np.vstack([np.zeros(2), np.diff(behind, axis=0) < 0.0]), axis=0)
    before = before + np.ceil(behind - before - 1e-12)
    return list(zip(behind, before, strict=True))


def _start(low: Outline, high: Outline) -> Floats:
    """(2,) float: measures where both outlines have the same direction, near each other, where the bottom one bends."""
    x = np.arange(_SAMPLES) / _SAMPLES
    rows_low, rows_high = low.at(x), high.at(x)
    bend = np.abs(np.roll(rows_low[:, DIRECTION], -1) - np.roll(rows_low[:, DIRECTION], 1))
    bend[[0, -1]] = 0.0
    at = int(np.argmax(bend))
    points_low, points_high = rows_low[:, 2:5], rows_high[:, 2:5]
    apart = (points_high - points_high.mean(axis=0)) - (points_low[at] - points_low.mean(axis=0))
    angle = (rows_high[:, DIRECTION] - rows_low[at, DIRECTION] + np.pi) % (2.0 * np.pi) - np.pi
    cost = angle**2 + _APART * (4.0 / low.length_mm * np.linalg.norm(apart, axis=1)) ** 2
    return np.array([x[at], x[int(np.argmin(cost))]])


def _match_span(
    low: Outline, high: Outline, start: Floats, stop: Floats, is_round: bool, sag: float
) -> tuple[Floats, float, float]:
    """Measures (k, 2) that belong together from start to stop, (2,) float each, which do; largest turn (rad), sag (mm)."""
    run = stop - start
    if _is_straight(low, start[0], stop[0]) and _is_straight(high, start[1], stop[1]):
        return np.vstack([start, stop]), 0.0, 0.0
    count = max(int(np.ceil(_SAMPLES * float(run.max()))), 6)
    share = np.linspace(0.0, 1.0, count + 1)
    sides = _sides(low, high, share, start, run)
    weight = sag / max(abs(float((sides[1][0, 1:4] - sides[0][0, 1:4]) @ low.axes[2])), 1e-300)
    _turned_like(sides, not is_round)
    shift = sides[1][:, 1:4].mean(axis=0) - sides[0][:, 1:4].mean(axis=0)
    path = cheapest_path(sides[0], sides[1], shift, weight, np.sqrt(_APART) / low.length_mm, _STRETCH)
    fine = np.linspace(0.0, 1.0, _FINE * count + 1)
    sides = _sides(low, high, fine, start, run)
    own = sides[0][:, 0].copy()
    _turned_like(sides, not is_round)
    guess = np.interp(fine, share, path / count) * (len(fine) - 1)
    place = refine_path(sides[0], sides[1], guess, weight, _STRETCH, is_round, _ROUNDS) / (len(fine) - 1)
    reached = _sides(low, high, place, start, run)[1]
    turn = (reached[:, 0] - own + np.pi) % (2.0 * np.pi) - np.pi
    sags = np.einsum("ij,ij->i", reached[:, 1:4] - sides[0][:, 1:4], reached[:, 4:] - sides[0][:, 4:]) / 8.0
    table = np.column_stack([start[0] + fine * run[0], start[1] + place * run[1]])
    return table, float(np.abs(turn).max()), float(np.abs(sags).max() + np.sqrt((sags**2).mean()))


def _is_straight(outline: Outline, start: float, stop: float) -> bool:
    """Whether the outline is one straight run at an even parameter from start to stop."""
    rows = outline.at(np.array([start, 0.75 * start + 0.25 * stop, 0.5 * (start + stop), 0.25 * start + 0.75 * stop]))
    turn = rows[:, DIRECTION] - rows[0, DIRECTION]
    gaps = np.diff(rows[:, PARAMETER]) % 1.0
    return bool(np.abs(turn).max() < 1e-9 and np.ptp(gaps) < 1e-9)


def _sides(low: Outline, high: Outline, x: Floats, start: Floats, run: Floats) -> list[Floats]:
    """Rows (k, 7) of both outlines at shares x of a run of measures: direction (rad), point (mm), surface normal.

    The planes' own directions compare as they are if the planes are parallel. If not, the surface's normals do, seen along
    the middle of both planes' normals: on a cylinder they are equal at both ends of a ruling however it is cut.
    """
    common = low.axes + high.axes
    common /= np.linalg.norm(common, axis=1)[:, None]
    are_parallel = float(low.axes[2] @ high.axes[2]) > 1.0 - 1e-12
    sides = []
    for k, outline in enumerate((low, high)):
        rows = rows_at(outline.x, outline.rows, start[k] + x * run[k])
        normals = outline.normals(rows)
        direction = rows[:, DIRECTION]
        if not are_parallel:
            seen = np.arctan2(normals @ common[1], normals @ common[0]) + 0.5 * np.pi
            direction = direction + (seen - direction + np.pi) % (2.0 * np.pi) - np.pi
        sides.append(np.column_stack([direction, rows[:, 2:5], normals]))
    return sides


def _turned_like(sides: list[Floats], is_between: bool) -> None:
    """Bring the top's directions to within half a turn of the bottom's, in place.

    is_between : both ends are corners that belong together; by how much directions differ there is no news on the way.
    """
    sides[1][:, 0] -= 2.0 * np.pi * np.round((sides[1][:, 0] - sides[0][:, 0]).mean() / (2.0 * np.pi))
    if is_between:
        apart = sides[1][[0, -1], 0] - sides[0][[0, -1], 0]
        sides[0][:, 0] += np.linspace(apart[0], apart[1], len(sides[0]))


@njit(cache=True)
def cheapest_path(
    low: Floats, high: Floats, shift: Floats, sag: float, apart: float, stretch: float
) -> Floats:  # pragma: no cover
    """For each sample of the bottom contour the sample of the top contour: (n,) float, not decreasing, ends to ends.

    low, high : (n, 7) float   direction (rad), point (mm), surface normal
    shift : (3,) float, mm     displacement of the whole contour, which costs nothing
    sag : rad/mm, weight of R·(n1 - n0);  apart : rad/mm, of distance;  stretch : rad², of a step one sample too long
    Source: dynamic programming over monotone paths (Sakoe and Chiba, IEEE Trans. ASSP 26, 1978).
    """
    n = low.shape[0]
    cost, following = np.full(n, np.inf), np.empty(n)
    step = np.zeros((n, n), np.int8)
    cost[0] = 0.0
    for i in range(1, n):
        for j in range(n):
            best = np.inf
            for d in range(min(_LONGEST_STEP, j) + 1):
                value = cost[j - d] + stretch * (d - 1.0) ** 2
                if value < best:
                    best = value
                    step[i, j] = d
            if best < np.inf:
                turn = low[i, 0] - high[j, 0]
                sagging, away = 0.0, 0.0
                for k in range(3):
                    ruling = high[j, 1 + k] - low[i, 1 + k]
                    sagging += ruling * (high[j, 4 + k] - low[i, 4 + k])
                    away += (ruling - shift[k]) ** 2
                best += turn * turn + (sag * sagging) ** 2 + apart * apart * away
            following[j] = best
        cost, following = following, cost
    path = np.empty(n)
    j = n - 1
    for i in range(n - 1, -1, -1):
        path[i] = j
        j -= step[i, j]
    return path


@njit(cache=True)
def refine_path(
    low: Floats, high: Floats, guess: Floats, sag: float, stretch: float, is_round: bool, rounds: int
) -> Floats:  # pragma: no cover
    """The path between samples: least squares of turn, sag and uneven progress.

    low, high, sag, stretch : as for `cheapest_path`;  guess : (n,) float, places on the top contour, 0 ... n - 1
    is_round : the last sample is the first, one round on, and both may move; else the ends stay
    Returns (n,) float, not decreasing. Gauss-Newton; each round solves a (cyclic) tridiagonal system.
    """
    n = low.shape[0]
    unknowns = n - 1 if is_round else n
    place = guess.copy()
    whole_turn = high[n - 1, 0] - high[0, 0]
    diagonal, right = np.empty(unknowns), np.empty((unknowns, 2))
    for _ in range(rounds):
        for i in range(unknowns):
            whole = np.floor(place[i] / (n - 1)) if is_round else 0.0
            rest = place[i] - whole * (n - 1)
            j = min(max(int(rest), 0), n - 2)
            part = rest - j
            slope = high[j + 1, 0] - high[j, 0]
            turn = low[i, 0] - (high[j, 0] + part * slope + whole * whole_turn)
            sagging, change = 0.0, 0.0
            for k in range(3):
                step, tilt = high[j + 1, 1 + k] - high[j, 1 + k], high[j + 1, 4 + k] - high[j, 4 + k]
                ruling = high[j, 1 + k] + part * step - low[i, 1 + k]
                between = high[j, 4 + k] + part * tilt - low[i, 4 + k]
                sagging += sag * ruling * between
                change += sag * (step * between + ruling * tilt)
            before = place[i - 1] if i > 0 else place[unknowns - 1] - (n - 1)
            after = place[i + 1] if i + 1 < unknowns else place[0] + (n - 1)
            diagonal[i] = slope * slope + change * change + 2.0 * stretch
            right[i, 0] = slope * turn - change * sagging + stretch * (before - 2.0 * place[i] + after)
            right[i, 1] = 0.0
            if not is_round and (i == 0 or i == n - 1):
                diagonal[i], right[i, 0] = 1e12, 0.0
        move = _solve_ring(diagonal, right, -stretch) if is_round else _solve_chain(diagonal, right, -stretch)[:, 0]
        largest = 0.0
        for i in range(unknowns):
            place[i] += max(-4.0, min(4.0, move[i]))
            largest = max(largest, abs(move[i]))
        if is_round:
            place[n - 1] = place[0] + (n - 1)
        for i in range(1, n):
            place[i] = max(place[i], place[i - 1])
        ceiling = place[n - 1] if is_round else n - 1.0
        for i in range(n):
            place[i] = min(place[i], ceiling)
        if largest < 1e-5:
            break
    return place


@njit(cache=True)
def _solve_chain(diagonal: Floats, right: Floats, off: float) -> Floats:  # pragma: no cover
    """Solution (n, 2) of the symmetric tridiagonal system with one value beside the diagonal, for two right sides."""
    n = diagonal.shape[0]
    pivot = np.empty(n)
    result = right.copy()
    pivot[0] = diagonal[0]
    for i in range(1, n):
        factor = off / pivot[i - 1]
        pivot[i] = diagonal[i] - factor * off
        for k in range(2):
            result[i, k] -= factor * result[i - 1, k]
    for k in range(2):
        result[n - 1, k] /= pivot[n - 1]
    for i in range(n - 2, -1, -1):
        for k in range(2):
            result[i, k] = (result[i, k] - off * result[i + 1, k]) / pivot[i]
    return result


@njit(cache=True)
def _solve_ring(diagonal: Floats, right: Floats, off: float) -> Floats:  # pragma: no cover
    """Solution (n,) of the tridiagonal system whose corners hold the off-diagonal value too (Sherman-Morrison)."""
    n = diagonal.shape[0]
    first = -diagonal[0]
    changed = diagonal.copy()
    changed[0] -= first
    changed[n - 1] -= off * off / first
    sides = right.copy()
    sides[0, 1], sides[n - 1, 1] = first, off
    both = _solve_chain(changed, sides, off)
    share = (both[0, 0] + off * both[n - 1, 0] / first) / (1.0 + both[0, 1] + off * both[n - 1, 1] / first)
    result: Floats = both[:, 0] - share * both[:, 1]
    return result
