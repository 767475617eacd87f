"""Where to sample a curve so that its chords stay within a tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.knots import bezier_pieces

if TYPE_CHECKING:
    from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]

_MAX_HALVINGS = 24  # 2^-24 of a span: below any tolerance that a double can tell


def parameters_within(curve: Curve, chord_tolerance_mm: float) -> Floats:
    """Parameters between which every chord stays within the tolerance of the curve: (k,) float.

    Polynomial curves: a proven bound, h²/8 · max|C''| per span by the hull of C''. Rational ones: measured at the
    quarters of each interval, which is halved until they lie within 0.8 of the tolerance.
    Raises ValueError if the tolerance is not positive.
    """
    if not chord_tolerance_mm > 0.0:
        raise ValueError(f"a chord tolerance must be positive, not {chord_tolerance_mm:g} mm")
    if curve.weights is not None:
        return _measured(curve, chord_tolerance_mm)
    edges, pieces = bezier_pieces(curve.degree, curve.knots, curve.control_points)
    p = curve.degree
    bend = p * (p - 1) * np.linalg.norm(np.diff(pieces, n=2, axis=1), axis=2) if p > 1 else np.zeros((len(pieces), 1))
    counts = np.ceil(np.sqrt(bend.max(axis=1) / (8.0 * chord_tolerance_mm)))
    return divide_evenly(edges, np.maximum(counts, 1).astype(np.intp))


def divide_evenly(edges: Floats, counts: NDArray[np.intp]) -> Floats:
    """Each interval between neighbouring edges cut into its count of equal parts: (sum(counts)+1,) float."""
    first = np.repeat(np.cumsum(counts) - counts, counts)
    share = (np.arange(len(first)) - first) / np.repeat(counts, counts)
    low = np.repeat(edges[:-1], counts)
    return np.append(low + share * np.repeat(np.diff(edges), counts), edges[-1])


def _measured(curve: Curve, chord_tolerance_mm: float) -> Floats:
    edges = divide_evenly(curve.breaks, np.full(len(curve.breaks) - 1, 4, dtype=np.intp))
    for _ in range(_MAX_HALVINGS):
        low, step = edges[:-1], np.diff(edges)
        ends = curve.evaluate(edges)
        chord = np.diff(ends, axis=0)
        length2 = np.maximum(np.einsum("ij,ij->i", chord, chord), 1e-300)
        worst = np.zeros(len(step))
        for share in (0.25, 0.5, 0.75):
            away = curve.evaluate(low + share * step) - ends[:-1]
            along = np.clip(np.einsum("ij,ij->i", away, chord) / length2, 0.0, 1.0)
            worst = np.maximum(worst, np.linalg.norm(away - along[:, None] * chord, axis=1))
        bad = worst > 0.8 * chord_tolerance_mm
        if not bad.any():
            break
        edges = divide_evenly(edges, np.where(bad, 2, 1).astype(np.intp))
    return edges
