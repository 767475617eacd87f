"""Arcs and NURBS of a text read back: where a line's motion is at a share of it, by the circle's and de Boor's own formulas."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import PostError
from planner.kinematics.chain import Floats

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_RADIUS_MM, _RADIUS_SHARE = (
    0.005,
    0.001,
)  # grbl 1.1 gcode.c: how far the end may lie off the circle, LinuxCNC takes more
_SAMPLES = 8  # of a line's stretch of a spline, for its length


@dataclass(frozen=True)
class Arcs:
    """Lines (k,) that move on circles: centre (k, 2) mm, first angle and sweep (k,) rad, radius (k,) mm; columns: of X and Y."""

    lines: Ints
    centre: Floats
    radius: Floats
    first: Floats
    sweep: Floats
    columns: tuple[int, int]

    @property
    def length(self) -> Floats:
        """(k,) mm."""
        return np.asarray(self.radius * np.abs(self.sweep))

    def at(self, lines: Ints, share: float) -> tuple[Ints, Floats]:
        """Which of the lines (m,), in order, are arcs, and the points (j, 2) at a share of those."""
        rows, mine = _common(lines, self.lines)
        angle = self.first[mine] + share * self.sweep[mine]
        away = np.column_stack([np.cos(angle), np.sin(angle)])
        return rows, self.centre[mine] + self.radius[mine, None] * away


@dataclass(frozen=True)
class Splines:
    """Lines (k,) that stand for a stretch of a NURBS: its number (k,) and the parameters (k, 2) where the stretch begins and ends.

    points, weights, order : per NURBS   follows : (n,) bool, lines whose feed is that of the block's first   length : (k,) mm
    """

    lines: Ints
    number: Ints
    stretch: Floats
    points: tuple[Floats, ...]
    weights: tuple[Floats, ...]
    order: tuple[int, ...]
    follows: Bools
    columns: tuple[int, int]

    @property
    def length(self) -> Floats:
        """(k,) mm, of chords."""
        if not len(self.lines):
            return np.zeros(0)
        places = np.stack([self.at(self.lines, share)[1] for share in np.linspace(0.0, 1.0, _SAMPLES + 1)])
        return np.asarray(np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=0))

    def at(self, lines: Ints, share: float) -> tuple[Ints, Floats]:
        """Which of the lines (m,), in order, belong to splines, and the points (j, 2) at a share of those."""
        rows, mine = _common(lines, self.lines)
        points = np.empty((len(rows), 2))
        u = self.stretch[mine, 0] + share * (self.stretch[mine, 1] - self.stretch[mine, 0])
        for k in np.unique(self.number[mine]):
            here = self.number[mine] == k
            points[here] = de_boor(self.points[k], self.weights[k], self.order[k], u[here])
        return rows, points


def _common(lines: Ints, own: Ints) -> tuple[Ints, Ints]:
    """Rows of `lines` that are in `own` (ascending), and where there."""
    if not len(own):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    place = np.searchsorted(own, lines).clip(0, len(own) - 1)
    rows = np.flatnonzero(own[place] == lines)
    return rows, place[rows]


def read_arcs(joints: Floats, is_arc: Bools, is_clockwise: Bools, offsets: list[Floats], xy: tuple[int, int]) -> Arcs:
    """The arcs of G2 and G3 with I and J from the start. Raises PostError where the end is not on the circle."""
    lines = np.flatnonzero(is_arc)
    columns = list(xy)
    start, end = joints[lines][:, columns], joints[lines + 1][:, columns]
    away = np.column_stack([np.nan_to_num(offset[lines]) for offset in offsets])
    centre, radius = start + away, np.linalg.norm(away, axis=1)
    off = np.abs(np.linalg.norm(end - centre, axis=1) - radius)
    wrong = ~((off <= _RADIUS_MM) | (off <= _RADIUS_SHARE * radius)) | (radius <= 0.0)
    if wrong.any():
        at = int(lines[np.argmax(wrong)])
        raise PostError(f"line {at + 1}: the arc's end is not on its circle", "report this program")
    first = np.arctan2(-away[:, 1], -away[:, 0])
    turned = (np.arctan2(end[:, 1] - centre[:, 1], end[:, 0] - centre[:, 0]) - first) % (2.0 * np.pi)
    turned = np.where(turned == 0.0, 2.0 * np.pi, turned)
    sweep = np.where(is_clockwise[lines] & (turned < 2.0 * np.pi), turned - 2.0 * np.pi, turned)
    sweep = np.where(is_clockwise[lines] & (turned == 2.0 * np.pi), -2.0 * np.pi, sweep)
    return Arcs(lines, centre, radius, first, sweep, xy)


def read_splines(
    joints: Floats, in_spline: Bools, is_end: Bools, order: Floats, weight: Floats, xy: tuple[int, int]
) -> Splines:
    """The NURBS of G5.2 … G5.3; `joints` (n + 1, 5) of their lines become the points where each line's stretch ends.

    The first control point is where the machine stands, with weight 1; knots are 0 … 0, 1, 2, … n - L + 2 … n - L + 2
    (source: LinuxCNC, G-code reference G5.2 and nurbs_additional_functions.cc). Each line stands for an equal share of the knots.
    Raises PostError where a block is not whole.
    """
    rows = np.flatnonzero(in_spline)
    number = np.zeros(len(rows), dtype=np.int64)
    stretch = np.zeros((len(rows), 2))
    points, weights, orders = [], [], []
    follows = np.zeros(len(in_spline), dtype=np.bool_)
    columns = list(xy)
    for k, block in enumerate(_blocks(rows, is_end)):
        lines = rows[block]
        given = lines[:-1]
        if not is_end[lines[-1]] or len(given) + 1 < order[given[0] if len(given) else 0]:
            raise PostError(
                f"line {int(lines[0]) + 1}: a NURBS without its end or with too few points", "report this program"
            )
        points.append(np.vstack([joints[lines[0], columns], joints[given + 1][:, columns]]))
        weights.append(np.append(1.0, weight[given]))
        orders.append(int(order[given[0]]))
        number[block] = k
        top = len(given) - orders[-1] + 2.0
        parts = np.linspace(0.0, top, len(lines) + 1)
        stretch[block] = np.column_stack([parts[:-1], parts[1:]])
        follows[lines[1:]] = True
        joints[lines[:, None] + 1, columns] = de_boor(points[-1], weights[-1], orders[-1], parts[1:])
    return Splines(rows, number, stretch, tuple(points), tuple(weights), tuple(orders), follows, xy)


def _blocks(rows: Ints, is_end: Bools) -> list[slice]:
    """Slices of the rows, each up to an end and with it."""
    cuts = np.flatnonzero(is_end[rows]) + 1
    edges = np.unique(np.concatenate([[0], cuts, [len(rows)]]))
    return [slice(int(begin), int(end)) for begin, end in itertools.pairwise(edges)]


def de_boor(points: Floats, weights: Floats, order: int, u: Floats) -> Floats:
    """(m, 2) points of a rational B-spline with clamped knots one apart at parameters u (m,). Source: de Boor 1972; Piegl & Tiller A4.1.

    points : (k, 2)   weights : (k,)   order : degree + 1
    """
    degree = order - 1
    spans = len(points) - degree
    knots = np.concatenate([np.zeros(degree), np.arange(spans + 1.0), np.full(degree, float(spans))])
    span = np.clip(np.floor(u), 0, spans - 1).astype(np.int64) + degree
    whole = np.column_stack([points * weights[:, None], weights])
    here = whole[span[:, None] - degree + np.arange(order)]
    for level in range(1, order):
        for j in range(degree, level - 1, -1):
            low, high = knots[span - degree + j], knots[span + 1 + j - level]
            share = ((u - low) / (high - low))[:, None]
            here[:, j] = (1.0 - share) * here[:, j - 1] + share * here[:, j]
    return np.asarray(here[:, degree, :2] / here[:, degree, 2:])
