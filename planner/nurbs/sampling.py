"""Where to sample curves so that the chords stay within a tolerance of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.bezier import BezierPieces, bezier_jet

if TYPE_CHECKING:
    from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_MAX_HALVINGS = 24  # 2^-24 of a span: below any tolerance that a double can tell
_FIRST_PARTS = 4  # of a rational piece, before it is measured


def parameters_within(curve: Curve, chord_tolerance_mm: float) -> Floats:
    """Parameters between which every chord stays within the tolerance of the curve: (k,) float, knots included.

    Raises ValueError if the tolerance is not positive. See `parameters_of_pieces`.
    """
    return parameters_of_pieces(curve.pieces, chord_tolerance_mm)[0]


def parameters_of_pieces(pieces: BezierPieces, chord_tolerance_mm: float) -> tuple[Floats, Indices]:
    """Parameters between which every chord stays within the tolerance of its curve.

    Polynomial pieces: a proven bound, h²/8 · max|C''| by the hull of C''. Rational ones: measured at the quarters of
    each interval, which is halved until they lie within 0.8 of the tolerance.
    Returns (u (k,) float: ends and knots of one curve after the other; first (c+1,) int: where each curve's begin).
    Raises ValueError if the tolerance is not positive.
    """
    if not chord_tolerance_mm > 0.0:
        raise ValueError(f"a chord tolerance must be positive, not {chord_tolerance_mm:g} mm")
    parts = (pieces.nets, pieces.degrees, pieces.rational, pieces.low, pieces.high, pieces.first)
    u, first = _parameters(*parts, chord_tolerance_mm)
    return u, first


def divide_evenly(edges: Floats, counts: NDArray[np.intp]) -> Floats:
    """Each interval between neighbouring edges cut into its count of equal parts: (sum(counts)+1,) float."""
    first = np.repeat(np.cumsum(counts) - counts, counts)
    share = (np.arange(len(first)) - first) / np.repeat(counts, counts)
    low = np.repeat(edges[:-1], counts)
    return np.append(low + share * np.repeat(np.diff(edges), counts), edges[-1])


@njit(cache=True, error_model="numpy", nogil=True)
def _proven_count(net: Floats, degree: int, dimension: int, tolerance: float) -> int:
    """Equal parts of a polynomial piece, as many as the second differences of its control points ask for."""
    most = 0.0
    for j in range(degree - 1):
        bend2 = 0.0
        for axis in range(dimension):
            bend2 += (net[j + 2, axis] - 2.0 * net[j + 1, axis] + net[j, axis]) ** 2
        most = max(most, bend2)
    return max(int(np.ceil(np.sqrt(degree * (degree - 1) * np.sqrt(most) / (8.0 * tolerance)))), 1)


@njit(cache=True, error_model="numpy", nogil=True)
def _is_polynomial(net: Floats, degree: int) -> bool:
    """Whether all weights of a piece are 1."""
    return bool(np.all(net[: degree + 1, net.shape[1] - 1] == 1.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _stray2(net: Floats, degree: int, low: float, high: float, work: Floats, jet: Floats, ends: Floats) -> float:
    """Largest squared distance from the chord of a rational piece at the quarters between two of its parameters."""
    dimension = net.shape[1] - 1
    for side in range(2):
        bezier_jet(net, degree, high if side else low, True, work, jet)
        ends[side] = jet[0]
    length2 = 0.0
    for axis in range(dimension):
        length2 += (ends[1, axis] - ends[0, axis]) ** 2
    worst = 0.0
    for quarter in range(1, 4):
        bezier_jet(net, degree, low + 0.25 * quarter * (high - low), True, work, jet)
        along, away2 = 0.0, 0.0
        for axis in range(dimension):
            along += (jet[0, axis] - ends[0, axis]) * (ends[1, axis] - ends[0, axis])
        along = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        for axis in range(dimension):
            away2 += (jet[0, axis] - ends[0, axis] - along * (ends[1, axis] - ends[0, axis])) ** 2
        worst = max(worst, away2)
    return worst


@njit(cache=True, error_model="numpy", nogil=True)
def _measured(
    net: Floats, degree: int, tolerance: float, work: Floats, jet: Floats, ends: Floats, stack: Floats, starts: Floats
) -> tuple[Floats, int]:
    """Own parameters where the parts of a rational piece begin, and how many: halved until near enough to the chord."""
    for part in range(_FIRST_PARTS):
        start = (_FIRST_PARTS - 1 - part) / _FIRST_PARTS
        stack[part, 0], stack[part, 1], stack[part, 2] = start, start + 1.0 / _FIRST_PARTS, 0.0
    height, found, allowed = _FIRST_PARTS, 0, (0.8 * tolerance) ** 2
    while height > 0:
        top = height - 1
        low, high, depth = stack[top]
        if depth < _MAX_HALVINGS and _stray2(net, degree, low, high, work, jet, ends) > allowed:
            middle = 0.5 * (low + high)
            stack[top, 0], stack[top, 2] = middle, depth + 1.0
            stack[height, 0], stack[height, 1], stack[height, 2] = low, middle, depth + 1.0
            height += 1
            continue
        if found == starts.size:
            starts = np.concatenate((starts, np.empty_like(starts)))
        starts[found] = low
        found += 1
        height -= 1
    return starts, found


@njit(cache=True, error_model="numpy", nogil=True)
def _parameters(
    nets: Floats, degrees: Indices, rational: bool, low: Floats, high: Floats, first: Indices, tolerance: float
) -> tuple[Floats, Indices]:
    """The parameters of all curves, and where each curve's begin."""
    u, edges = np.empty(8 * len(nets) + len(first)), np.zeros(len(first), dtype=np.intp)
    work, jet, ends = np.empty(nets.shape[1:]), np.empty((3, nets.shape[2])), np.empty((2, nets.shape[2]))
    stack, starts = np.empty((_MAX_HALVINGS + _FIRST_PARTS + 2, 3)), np.empty(64)
    dimension, found = nets.shape[2] - int(rational), 0
    for curve in range(len(first) - 1):
        for k in range(first[curve], first[curve + 1]):
            proven = not rational or _is_polynomial(nets[k], degrees[k])
            if proven:
                count = _proven_count(nets[k], degrees[k], dimension, tolerance)
            else:
                starts, count = _measured(nets[k], degrees[k], tolerance, work, jet, ends, stack, starts)
            while found + count + 1 > u.size:
                u = np.concatenate((u, np.empty_like(u)))
            for part in range(count):
                share = part / count if proven else starts[part]
                u[found + part] = low[k] + share * (high[k] - low[k])
            found += count
        u[found] = high[first[curve + 1] - 1]
        found += 1
        edges[curve + 1] = found
    return u[:found].copy(), edges
