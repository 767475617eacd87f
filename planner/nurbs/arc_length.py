"""Arc length of curves and its inverse: adaptive Gauss-Legendre per Bézier piece, Newton on the way back."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.bezier import BezierPieces, bezier_jet

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_AGREEMENT = 1e-11  # share of the whole length by which a cell and its two halves may differ
_MAX_HALVINGS = 30  # near a point of no speed the error falls only by 4 per halving
_NODES, _WEIGHTS = (np.asarray(part, dtype=np.float64) for part in np.polynomial.legendre.leggauss(8))
_MAX_STEPS = 60  # bisection alone halves a cell down to rounding in about 52


class ArcLengths:
    """Cumulative lengths of some curves at the edges of cells short enough for 8 Gauss-Legendre nodes each."""

    def __init__(self, pieces: BezierPieces) -> None:
        """pieces : the curves, as Bézier pieces."""
        self._pieces = pieces
        shape = (pieces.nets, pieces.degrees, pieces.rational)
        self._piece, self._start, self._reached, self._first = _cells(*shape, pieces.first, _NODES, _WEIGHTS)

    @property
    def totals(self) -> Floats:
        """(c,) float, mm   Length of each curve."""
        return np.asarray(self._reached[self._first[1:] - 1])

    def length_at(self, owner: Indices, u: Floats) -> Floats:
        """Length from the start of curve owner[k] to its parameter u[k], inside its domain: (k,) float, mm."""
        pieces = self._pieces
        table = (self._piece, self._start, self._reached, self._first)
        shape = (pieces.nets, pieces.degrees, pieces.rational, pieces.low, pieces.high)
        return np.asarray(_lengths(*shape, *table, owner, u, _NODES, _WEIGHTS))

    def parameter_at(self, owner: Indices, s: Floats) -> Floats:
        """Parameter at each length from the start of curve owner[k], clipped to it: (k,) float.

        Safeguarded Newton, to about 1e-13 of the length.
        """
        pieces = self._pieces
        table = (self._piece, self._start, self._reached, self._first)
        shape = (pieces.nets, pieces.degrees, pieces.rational, pieces.low, pieces.high)
        return np.asarray(_parameters(*shape, *table, owner, s, _NODES, _WEIGHTS))


@njit(cache=True, error_model="numpy", nogil=True)
def _speed(net: Floats, degree: int, t: float, rational: bool, work: Floats, jet: Floats) -> float:
    """Speed by the piece's own parameter."""
    bezier_jet(net, degree, t, rational, work, jet)
    total = 0.0
    for axis in range(jet.shape[1] - int(rational)):
        total += jet[1, axis] ** 2
    return float(np.sqrt(total))


@njit(cache=True, error_model="numpy", nogil=True)
def _integral(
    net: Floats, degree: int, rational: bool, low: float, high: float, nodes: Floats, weights: Floats,
    work: Floats, jet: Floats,
) -> float:  # fmt: skip
    """Length between two parameters of one piece by one Gauss-Legendre rule."""
    half, middle, total = 0.5 * (high - low), 0.5 * (high + low), 0.0
    for node in range(nodes.size):
        total += weights[node] * _speed(net, degree, middle + half * nodes[node], rational, work, jet)
    return half * total


@njit(cache=True, error_model="numpy", nogil=True)
def _cells(
    nets: Floats, degrees: Indices, rational: bool, first: Indices, nodes: Floats, weights: Floats
) -> tuple[Indices, Floats, Floats, Indices]:
    """Cut pieces into cells whose two halves add up to the whole.

    Returns per cell edge (cells of a curve and one edge more for its end): the piece, the piece's own parameter and
    the length reached; and where each curve's edges start, (c+1,).
    """
    width = nets.shape[2]
    work, jet = np.empty((nets.shape[1], width)), np.empty((3, width))
    room = 2 * len(nets) + len(first)
    piece, start, reached = np.empty(room, dtype=np.intp), np.empty(room), np.empty(room)
    edges = np.zeros(len(first), dtype=np.intp)
    stack = np.empty((_MAX_HALVINGS + 2, 4))
    found = 0
    for curve in range(len(first) - 1):
        rough, done = 0.0, 0.0
        for k in range(first[curve], first[curve + 1]):
            rough += _integral(nets[k], degrees[k], rational, 0.0, 1.0, nodes, weights, work, jet)
        for k in range(first[curve], first[curve + 1]):
            stack[0, 0], stack[0, 1], stack[0, 3] = 0.0, 1.0, 0.0
            stack[0, 2] = _integral(nets[k], degrees[k], rational, 0.0, 1.0, nodes, weights, work, jet)
            height = 1
            while height > 0:
                height -= 1
                low, high, whole, depth = stack[height]
                middle = 0.5 * (low + high)
                left = _integral(nets[k], degrees[k], rational, low, middle, nodes, weights, work, jet)
                right = _integral(nets[k], degrees[k], rational, middle, high, nodes, weights, work, jet)
                if depth < _MAX_HALVINGS and abs(left + right - whole) > _AGREEMENT * rough:
                    stack[height, 0], stack[height, 1], stack[height, 2] = middle, high, right
                    stack[height + 1, 0], stack[height + 1, 1], stack[height + 1, 2] = low, middle, left
                    stack[height, 3] = stack[height + 1, 3] = depth + 1
                    height += 2
                    continue
                if found + 2 > piece.size:
                    piece = np.concatenate((piece, np.empty_like(piece)))
                    start, reached = np.concatenate((start, start)), np.concatenate((reached, reached))
                piece[found], start[found], reached[found] = k, low, done
                done += left + right
                found += 1
        if found + 2 > piece.size:
            piece = np.concatenate((piece, np.empty_like(piece)))
            start, reached = np.concatenate((start, start)), np.concatenate((reached, reached))
        piece[found], start[found], reached[found] = first[curve + 1] - 1, 1.0, done
        found += 1
        edges[curve + 1] = found
    return piece[:found].copy(), start[:found].copy(), reached[:found].copy(), edges


@njit(cache=True, error_model="numpy", nogil=True)
def _lengths(
    nets: Floats, degrees: Indices, rational: bool, lows: Floats, highs: Floats,
    piece: Indices, start: Floats, reached: Floats, first: Indices,
    owner: Indices, u: Floats, nodes: Floats, weights: Floats,
) -> Floats:  # fmt: skip
    """Length reached at each parameter of its curve."""
    width = nets.shape[2]
    work, jet = np.empty((nets.shape[1], width)), np.empty((3, width))
    result = np.empty(u.size)
    for k in range(u.size):
        low, high = first[owner[k]], first[owner[k] + 1] - 1
        while high - low > 1:
            middle = (low + high) // 2
            at = piece[middle]
            if lows[at] + start[middle] * (highs[at] - lows[at]) <= u[k]:
                low = middle
            else:
                high = middle
        at = piece[low]
        t = (u[k] - lows[at]) / (highs[at] - lows[at])
        rest = _integral(nets[at], degrees[at], rational, start[low], t, nodes, weights, work, jet)
        result[k] = reached[low] + rest
    return result


@njit(cache=True, error_model="numpy", nogil=True)
def _parameters(
    nets: Floats, degrees: Indices, rational: bool, lows: Floats, highs: Floats,
    piece: Indices, start: Floats, reached: Floats, first: Indices,
    owner: Indices, lengths: Floats, nodes: Floats, weights: Floats,
) -> Floats:  # fmt: skip
    """Parameter of its curve at which each length is reached."""
    width = nets.shape[2]
    work, jet = np.empty((nets.shape[1], width)), np.empty((3, width))
    result = np.empty(lengths.size)
    for k in range(lengths.size):
        low, high = first[owner[k]], first[owner[k] + 1] - 1
        total = reached[high]
        wanted = min(max(lengths[k], 0.0), total)
        while high - low > 1:
            middle = (low + high) // 2
            if reached[middle] <= wanted:
                low = middle
            else:
                high = middle
        at, rest, whole = piece[low], wanted - reached[low], reached[low + 1] - reached[low]
        net, degree = nets[at], degrees[at]
        left = start[low]
        right = start[low + 1] if piece[low + 1] == at else 1.0
        begin, t = left, left + (right - left) * (rest / whole if whole > 0.0 else 0.0)
        for _ in range(_MAX_STEPS):
            error = _integral(net, degree, rational, begin, t, nodes, weights, work, jet) - rest
            if abs(error) <= 1e-13 * total or right - left <= 4e-16:
                break
            if error > 0.0:
                right = t
            else:
                left = t
            speed = _speed(net, degree, t, rational, work, jet)
            step = t - error / speed if speed > 0.0 else left
            t = step if left < step < right else 0.5 * (left + right)
        result[k] = lows[at] + t * (highs[at] - lows[at])
    return result
