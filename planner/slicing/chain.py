"""The nodes that a curve is led through: which slice points say something, and which of them cannot be believed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.mesh.smooth import STORED, SmoothSurface
from planner.slicing.nodes import Outline, lifted_nodes, node_kinds
from planner.slicing.thinning import thinned

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_STRAIGHT_MM = 1e-5  # points of flat faces that lie this near to the line of their neighbours are dropped
_ASTRAY = 0.3  # cosine: a direction more than 72 degrees off the way to the next node belongs to another contour
_LONG = 5.0  # a piece this much longer than the one beside it
_BENT = 1e-3  # rad; and leaving it at more than this angle
_ONE_SIDED = 0.1  # while it arrives at less than this share of it: curves within the node, not along the piece


@dataclass(frozen=True, eq=False)
class Chain:
    """The nodes of all loops, loop after loop.

    start    : (k+1,) int64       where each loop begins
    points   : (n, 3) float, mm
    tangents : (n, 2, 3) float    unit, arriving and leaving; NaN where the curve finds its own
    corners  : (n,) bool
    """

    start: Ints
    points: Floats
    tangents: Floats
    corners: Flags


def chain_of(outline: Outline, surface: SmoothSurface) -> Chain:
    """The nodes that say something (`kept_nodes`, `thinned`), made safe.

    A node goes back to where the facets have it, and loses its directions, where the smooth surface would lead the
    contour backwards or across itself: near a saddle or a grazing plane its section has another shape than the
    facets'. Where a long piece would leave a node at a much larger angle than it arrives at the next, all of the bend
    lies within the node (next to the tip of a cone): the node becomes a corner and the piece the arc of the far end.
    """
    said = thinned(outline.taken(kept_nodes(outline, surface)), surface)
    nodes, raw, after = lifted_nodes(said, surface), said.points, said.after
    points, tangents, corners = nodes.points, nodes.tangents, nodes.corners
    for _ in range(3):
        chord = points[after] - points
        length = np.maximum(np.linalg.norm(chord, axis=1), 1e-300)[:, None]
        backwards = np.einsum("nd,nd->n", raw[after] - raw, chord) <= 0.0
        leaving = np.einsum("nd,nd->n", tangents[:, 1], chord / length) < _ASTRAY
        arriving = np.einsum("nd,nd->n", tangents[after, 0], chord / length) < _ASTRAY
        wrong = backwards | leaving
        wrong[after[backwards | arriving]] = True
        wrong &= np.isfinite(tangents[:, 0, 0]) | (points != raw).any(axis=1)
        if not wrong.any():
            break
        points[wrong], tangents[wrong] = raw[wrong], np.nan
    _straighten(points, tangents, corners, after)
    return Chain(said.start, points, tangents, corners)


def _straighten(points: Floats, tangents: Floats, corners: Flags, after: Ints) -> None:
    """Take the bend out of long pieces that have it at one end only; in place."""
    chord = points[after] - points
    length = np.linalg.norm(chord, axis=1)
    unit = chord / np.maximum(length, 1e-300)[:, None]
    leaving = np.linalg.norm(tangents[:, 1] - unit, axis=1)
    arriving = np.linalg.norm(tangents[after, 0] - unit, axis=1)
    before = np.empty(len(points), dtype=np.int64)
    before[after] = np.arange(len(points))
    at_start = (leaving > _BENT) & (arriving < _ONE_SIDED * leaving) & (length >= _LONG * length[before])
    at_end = (arriving > _BENT) & (leaving < _ONE_SIDED * arriving) & (length >= _LONG * length[after])
    far_start, far_end = tangents[after, 0].copy(), tangents[:, 1].copy()
    rows = np.flatnonzero(at_start)
    tangents[rows, 1], corners[rows] = _mirrored(far_start[rows], unit[rows]), True
    rows = np.flatnonzero(at_end)
    tangents[after[rows], 0], corners[after[rows]] = _mirrored(far_end[rows], unit[rows]), True


def _mirrored(tangents: Floats, unit: Floats) -> Floats:
    """The direction at the other end of the circular arc over each chord."""
    return np.asarray(2.0 * np.einsum("nd,nd->n", tangents, unit)[:, None] * unit - tangents)


def kept_nodes(outline: Outline, surface: SmoothSurface) -> Flags:
    """Which points stay: all but those between facets of one plane that lie on the line of their neighbours.

    At least three points of a loop stay.
    """
    corners, flat = node_kinds(outline, surface)
    keep = ~flat | corners
    tolerance = max(_STRAIGHT_MM, 4.0 * STORED * float(np.abs(surface.mesh.bounds).max()))
    counts = np.diff(outline.start)
    few = np.add.reduceat(keep, outline.start[:-1]) < 3 if len(counts) else np.zeros(0, dtype=bool)
    keep |= few[outline.loop]
    for _ in range(8):
        low, high = _kept_neighbours(outline, keep)
        chord = outline.points[high] - outline.points[low]
        away = outline.points - outline.points[low]
        length2 = np.maximum(np.einsum("nd,nd->n", chord, chord), 1e-300)
        share = np.clip(np.einsum("nd,nd->n", away, chord) / length2, 0.0, 1.0)
        off = ~keep & (np.linalg.norm(away - share[:, None] * chord, axis=1) > tolerance)
        if not off.any():
            break
        keep |= off
    return np.asarray(keep)


def _kept_neighbours(outline: Outline, keep: Flags) -> tuple[Ints, Ints]:
    """For every point the kept one at or before it and the kept one after it, within its loop, cyclically."""
    kept = np.flatnonzero(keep)
    first_kept = np.searchsorted(kept, outline.start[:-1])
    last_kept = np.searchsorted(kept, outline.start[1:]) - 1
    at = np.searchsorted(kept, np.arange(len(keep)), side="right") - 1
    low = np.where(at < first_kept[outline.loop], last_kept[outline.loop], at)
    high = np.where(at + 1 > last_kept[outline.loop], first_kept[outline.loop], at + 1)
    return kept[low], kept[high]
