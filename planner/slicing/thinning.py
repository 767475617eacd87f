"""Dense outlines led through fewer nodes: as many as the bend of the contour needs, whatever the mesh's fineness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.mesh.smooth import SmoothSurface, bezier_at
from planner.nurbs.handles import equal_speed
from planner.slicing.nodes import Nodes, Outline, lifted_nodes, node_kinds

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

THIN_MM = 1e-4
"""How far a point that is left out may lie from the piece that passes it: a hundredth of what a machine holds."""
_TURN_RAD = 0.06  # between nodes: a cubic over an arc that turns so much is within 4e-8 of its radius
_PARTS = 64  # of a loop at least, so that straight runs have nodes too
_DENSE = 3.0  # a loop with fewer times the nodes it needs keeps them all
_PROBES = (0.25, 0.5, 0.75)  # of the points left out of a piece, those that are looked at
_NEWTON_STEPS = 3


def thinned(outline: Outline, surface: SmoothSurface) -> Outline:
    """The outline with the nodes that its curves need; most loops keep all of theirs.

    Loops of fine meshes are led through corners and points about _TURN_RAD of bend apart. Of the points left out of each
    piece some are lifted onto the smooth surface too; where one lies farther than THIN_MM from the cubic between the
    piece's ends, the piece and its neighbours keep all of their points.
    """
    keep = _chosen(outline, surface)
    if keep.all():
        return outline
    kept = np.flatnonzero(keep)
    piece = np.searchsorted(kept, np.arange(len(keep)), side="right") - 1
    following = _after_kept(outline, kept)
    counts = np.bincount(piece[~keep & (piece >= 0)], minlength=len(kept))
    gaps = np.flatnonzero(counts)
    probes = kept[gaps] + 1 + (np.array(_PROBES)[:, None] * counts[gaps]).astype(np.int64)
    is_asked = keep.copy()
    is_asked[probes.ravel()] = True
    asked = np.flatnonzero(is_asked)
    nodes = lifted_nodes(outline.taken(is_asked), surface)
    start, end = np.searchsorted(asked, kept[gaps]), np.searchsorted(asked, kept[following[gaps]])
    off = np.max([_away(nodes, start, end, np.searchsorted(asked, row)) for row in probes], axis=0)
    is_bad = np.zeros(len(kept), dtype=bool)
    is_bad[gaps] = ~(off <= THIN_MM)
    bad = np.flatnonzero(is_bad)
    before = np.empty(len(kept), dtype=np.int64)
    before[following] = np.arange(len(kept))
    is_bad[before[bad]] = is_bad[following[bad]] = True
    return outline.taken(keep | is_bad[piece])


def _chosen(outline: Outline, surface: SmoothSurface) -> Flags:
    """The first choice of nodes, by bend and length; the first point of each loop is among them: (n,) bool."""
    corners, _ = node_kinds(outline, surface)
    ahead = outline.points[outline.after] - outline.points
    length = np.linalg.norm(ahead, axis=1)
    way = ahead / np.maximum(length, 1e-300)[:, None]
    before = np.empty(len(length), dtype=np.int64)
    before[outline.after] = np.arange(len(length))
    turn = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(way - way[before], axis=1), 1.0))
    turn[corners] = 0.0
    counts = np.diff(outline.start)
    whole = np.repeat(np.add.reduceat(length, outline.start[:-1]), counts)
    cost = turn / _TURN_RAD + length * _PARTS / np.maximum(whole, 1e-300)
    reached = np.concatenate([[0.0], np.cumsum(cost)])
    step = np.floor(reached[:-1] - reached[outline.start[:-1]][outline.loop])
    keep = corners.copy()
    keep[1:] |= step[1:] != step[:-1]
    keep[outline.start[:-1]] = True
    needed = np.add.reduceat(keep.astype(np.int64), outline.start[:-1])
    return np.asarray(keep | np.repeat(counts < _DENSE * needed, counts))


def _after_kept(outline: Outline, kept: Ints) -> Ints:
    """For each kept point the number of the next one, cyclically within its loop: (k,) int64."""
    start = np.searchsorted(kept, outline.start)
    following = np.arange(1, len(kept) + 1)
    following[start[1:] - 1] = start[:-1]
    return following


def _away(nodes: Nodes, start: Ints, end: Ints, probe: Ints) -> Floats:
    """Distance, mm, of a node from the cubic of equal speed between two others; NaN where a direction is unknown: (k,)."""
    chord = nodes.points[end] - nodes.points[start]
    leaving, arriving = nodes.tangents[start, 1], nodes.tangents[end, 0]
    handle = equal_speed(chord, leaving, arriving)[:, None] / 3.0
    bezier = np.stack(
        [
            nodes.points[start],
            nodes.points[start] + handle * leaving,
            nodes.points[end] - handle * arriving,
            nodes.points[end],
        ],
        axis=1,
    )
    asked = nodes.points[probe]
    length2 = np.maximum(np.einsum("nd,nd->n", chord, chord), 1e-300)
    t = np.clip(np.einsum("nd,nd->n", asked - nodes.points[start], chord) / length2, 0.0, 1.0)
    for _ in range(_NEWTON_STEPS):
        point, along = bezier_at(bezier, t)
        slope2 = np.maximum(np.einsum("nd,nd->n", along, along), 1e-300)
        t = np.clip(t + np.einsum("nd,nd->n", asked - point, along) / slope2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(asked - bezier_at(bezier, t)[0], axis=1))
