"""NURBS in the XY plane for LinuxCNC's G5.2: runs of moves in which only X and Y go become one curve where that is shorter as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import linear_joints
from planner.nurbs.basis import basis_functions, find_spans
from planner.nurbs.curve import Curve
from planner.plan import Operation
from planner.post.draft import Draft
from planner.post.pass_curve import PassCurve
from planner.post.tape import Entry, Move
from planner.post.words import Words, decimal, feed_word

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_LEAST_ROWS = 4  # a run of fewer moves is shorter as moves
_MOST_ROWS = 200  # of one curve: its equations stay small
_CORNER_RAD = np.deg2rad(15.0)  # between two moves: there the curve is not smooth, or the moves would be shorter
_SAME_FEED = 0.002  # relative
_FIT_SHARE = 0.6  # of the moves' tolerance: what the fit may leave; rounding of the poles takes the rest
_CUBIC = 3
_STRAIGHT_SHARE = 0.02  # of the greatest curvature
_SAMPLES_PER_ROW = 6
_MAX_ORDER = 6
_WEIGHT_DECIMALS = 6
_POLE_BYTES = 18  # at least, of a pole's line: with more poles than that the moves are shorter
_MOVE_BYTES = 5  # what a move's line has beside its number and its words: N, the new line, X, Y


@dataclass(frozen=True)
class Planar:
    """One clamped B-spline with knots one apart.

    poles : (k, 2) int, words of X and Y, the first where the machine stands   weights : (k,) float, the first 1   order : degree + 1
    arcs_mm : (k + 1,) float, length along the pass where each line's share of the knots begins, and the end
    """

    poles: Ints
    weights: Floats
    order: int
    arcs_mm: Floats


class Splines:
    """Finds and writes the curves of one draft."""

    def __init__(
        self,
        draft: Draft,
        words: Words,
        chain: Chain,
        posted: Mapping[int, Operation],
        placed: Floats,
        tool_tips: Mapping[int, Floats],
        tolerance_mm: float,
    ) -> None:
        self._draft, self._words, self._chain = draft, words, chain
        self._posted, self._placed, self._tool_tips = posted, placed, tool_tips
        self._tolerance_mm = tolerance_mm
        self._xy = [words.letters.index("X"), words.letters.index("Y")]
        self._curves: dict[tuple[int, int], PassCurve] = {}

    def applied(self, start: Floats, entries: Sequence[Entry]) -> Draft:
        """The draft with curves where they are shorter. start : (5,) float, joints before the first row   entries : of the schedule"""
        draft, words = self._draft, self._words
        counts = np.vstack([words.counts(start[None, :]), words.counts(draft.items["joints"])])
        parts: list[tuple[NDArray[np.void], Floats, list[str | None]]] = []
        done = 0
        for begin, end in self._runs(counts, entries):
            found = self._curve(counts, begin, end)
            if found is None:
                continue
            parts.append((draft.items[done:begin], draft.keys[done:begin], draft.texts[done:begin]))
            parts.append(self._rows(found, begin, end))
            done = end
        if not parts:
            return draft
        parts.append((draft.items[done:], draft.keys[done:], draft.texts[done:]))
        items, keys = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
        return Draft(items, keys, [text for part in parts for text in part[2]])

    def _runs(self, counts: Ints, entries: Sequence[Entry]) -> Iterator[tuple[int, int]]:
        """First row and one past the last of moves at one feed in which only X and Y go, smoothly, and nothing is set."""
        items = self._draft.items
        steps = np.diff(counts, axis=0)
        others = [k for k in range(steps.shape[1]) if k not in self._xy]
        joins = (items["move"] == Move.FEED) & (items["command"] < 0) & (items["pass_"] >= 0) & ~items["stop"]
        joins &= np.all(steps[:, others] == 0, axis=1) & (items["named"] == 0)
        feed = items["way"] / np.maximum(items["time_s"], 1e-9)
        cut = np.append(True, ~(joins[1:] & joins[:-1]))
        cut[1:] |= (np.diff(items["pass_"]) != 0) | (np.diff(items["operation"]) != 0)
        cut[1:] |= np.abs(np.diff(feed)) > _SAME_FEED * np.maximum(feed[1:], feed[:-1])
        way = steps[:, self._xy] / 10.0 ** self._words.decimals[self._xy]
        cut[1:] |= self._turn(way, items["bulge"])
        due = np.array([entry.item for entry in entries], dtype=np.float64)
        cut[np.searchsorted(self._draft.keys, due).clip(0, len(items) - 1)] = True
        edges = np.append(np.flatnonzero(cut), len(items))
        for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if not joins[low]:
                continue
            for begin in range(low, high, _MOST_ROWS):
                end = min(begin + _MOST_ROWS, high)
                if end - begin >= _LEAST_ROWS:
                    yield begin, end

    def _turn(self, way: Floats, bulge: Floats) -> Bools:
        """(n - 1,) bool: corners between moves; way : (n, 2) mm."""
        angle = np.arctan2(way[:, 1], way[:, 0])
        half = 2.0 * np.arctan(bulge)
        turned = np.diff(angle) - half[1:] - half[:-1]
        return np.asarray(np.abs((turned + np.pi) % (2.0 * np.pi) - np.pi) > _CORNER_RAD)

    def _curve(self, counts: Ints, begin: int, end: int) -> Planar | None:
        """The curve of rows begin to end, None where moves are shorter or no curve keeps the tolerance."""
        row = self._draft.items[begin]
        curve = self._pass(int(row["operation"]), int(row["pass_"]))
        if curve.source.tip.degree < 2 or not curve.has_constant_axis:
            return None
        budget = self._bytes(counts, begin, end)
        low, high = float(row["arc_start_mm"]), float(self._draft.items["arc_end_mm"][end - 1])
        exact = self._exact(curve, counts, begin, (low, high))
        if exact is not None and self._size(exact, begin) < budget:
            return exact
        arcs = np.linspace(low, high, _SAMPLES_PER_ROW * (end - begin) + 1)
        points = self._plane(curve.tips(curve.at_arc_length(arcs)), begin)
        if points is None:
            return None
        share = _rhythm(points)
        most = budget // _POLE_BYTES - _CUBIC
        spans = 1
        while spans <= most:
            poles = self._fit(points, share * spans, counts[[begin, end]][:, self._xy])
            if poles is not None:
                lines = len(poles)  # the first pole stands already; G5.3 is one line more
                reached = np.interp(np.linspace(0.0, 1.0, lines + 1), share, arcs)
                found = Planar(poles, np.ones(lines), _CUBIC + 1, reached)
                return found if self._size(found, begin) < budget else None
            spans += 1 + spans // 6
        return None

    def _pass(self, operation: int, index: int) -> PassCurve:
        key = operation, index
        if key not in self._curves:
            item = self._posted[operation].passes[index]
            self._curves = {key: PassCurve(item, self._placed, f"pass {index} of operation {operation}")}
        return self._curves[key]

    def _plane(self, tips: Floats, row: int) -> Floats | None:
        """(k, 2) mm: words of X and Y for tips (k, 3), table frame, the other joints as in a row; None if Z would have to move."""
        item = self._draft.items[row]
        joints = np.repeat(np.asarray(item["joints"])[None, :], len(tips), axis=0)
        moved = linear_joints(self._chain, joints, tips, self._tool_tips[int(item["tool"])])
        others = [k for k in range(joints.shape[1]) if k not in self._xy]
        if np.abs(moved[:, others] - joints[:, others]).max() > (1.0 - _FIT_SHARE) * self._tolerance_mm:
            return None
        return np.asarray((moved - self._words.offset)[:, self._xy])

    def _fit(self, points: Floats, u: Floats, ends: Ints) -> Ints | None:
        """(spans + 3, 2) int: poles of the cubic through both ends nearest, by least squares, to points (k, 2) at u (k,); None: too far."""
        spans = round(float(u[-1]))
        knots = np.concatenate([np.zeros(_CUBIC), np.arange(spans + 1.0), np.full(_CUBIC, float(spans))])
        at = find_spans(_CUBIC, knots, u)
        matrix = np.zeros((len(u), spans + _CUBIC))
        matrix[np.arange(len(u))[:, None], at[:, None] - _CUBIC + np.arange(_CUBIC + 1)] = basis_functions(
            _CUBIC, knots, at, u
        )
        scale = 10.0 ** self._words.decimals[self._xy]
        fixed = ends / scale
        rest = points - matrix[:, [0, -1]] @ fixed
        inner = matrix[:, 1:-1]
        solved = np.linalg.solve(inner.T @ inner, inner.T @ rest) if len(u) > spans + _CUBIC else None
        if solved is None:
            return None
        poles = np.vstack([ends[:1], np.rint(solved * scale).astype(np.int64), ends[1:]])
        off = np.linalg.norm(matrix @ (poles / scale) - points, axis=1)
        return poles if off.max() <= _FIT_SHARE * self._tolerance_mm else None

    def _exact(self, curve: PassCurve, counts: Ints, begin: int, arcs: tuple[float, float]) -> Planar | None:
        """The pass's own NURBS, if it is one of the kind that G5.2 has and the run is all of it."""
        tip = curve.source.tip
        if arcs[0] > 0.0 or arcs[1] < curve.length_mm - 1e-6 or tip.degree + 1 > _MAX_ORDER or not _is_uniform(tip):
            return None
        poles = tip.control_points @ self._placed[:3, :3].T + self._placed[:3, 3]
        points = self._plane(poles, begin)
        if points is None:
            return None
        rounded = np.rint(points * 10.0 ** self._words.decimals[self._xy]).astype(np.int64)
        if np.any(rounded[0] != counts[begin, self._xy]):
            return None
        weights = np.ones(len(rounded)) if tip.weights is None else tip.weights / tip.weights[0]
        low, high = tip.domain
        reached = curve.arc_length(np.linspace(low, high, len(rounded) + 1))
        return Planar(rounded, np.round(weights, _WEIGHT_DECIMALS), tip.degree + 1, reached)

    def _rows(self, found: Planar, begin: int, end: int) -> tuple[NDArray[np.void], Floats, list[str | None]]:
        """Items, keys and texts of a curve's lines: one per pole but the first, and G5.3; each stands for its share of the curve."""
        items, count = self._draft.items, len(found.poles)
        rows = np.repeat(items[begin : begin + 1], count)
        rows["arc_start_mm"], rows["arc_end_mm"] = found.arcs_mm[:-1], found.arcs_mm[1:]
        curve = self._pass(int(rows["operation"][0]), int(rows["pass_"][0]))
        places = self._plane(curve.tips(curve.at_arc_length(found.arcs_mm[1:])), begin)
        assert places is not None
        rows["joints"][:, self._xy] = places + self._words.offset[self._xy]
        rows["joints"][-1] = items["joints"][end - 1]
        length = float(items["way"][begin:end].sum())
        time_s = float(items["time_s"][begin:end].sum())
        share = np.diff(found.arcs_mm) / (found.arcs_mm[-1] - found.arcs_mm[0])
        rows["way"], rows["time_s"], rows["bulge"] = length * share, time_s * share, 0.0
        keys = self._draft.keys[begin] + np.arange(count) * 1e-6
        keys[1:] += 1e-3
        return rows, keys, self._texts(found, 60.0 * length / time_s)

    def _texts(self, found: Planar, feed_mm_min: float) -> list[str | None]:
        places = [int(self._words.decimals[k]) for k in self._xy]
        made: list[str | None] = []
        for (x, y), weight in zip(found.poles[1:].tolist(), found.weights[1:].tolist(), strict=True):
            weight_text = decimal(round(weight * 10**_WEIGHT_DECIMALS), _WEIGHT_DECIMALS)
            made.append(f"X{decimal(x, places[0])}Y{decimal(y, places[1])}P{weight_text}")
        made[0] = f"G94G5.2{made[0]}L{found.order}{feed_word(feed_mm_min)}"
        return [*made, "G5.3"]

    def _size(self, found: Planar, begin: int) -> int:
        """Bytes of a curve's lines, their numbers not counted but for N, and what the next move has to say again."""
        texts = self._texts(found, 600.0)
        return sum(len(text or "") + 3 + len(str(begin)) for text in texts) + 6

    def _bytes(self, counts: Ints, begin: int, end: int) -> int:
        """Bytes of the moves, counted as `_size` counts."""
        size = (end - begin) * (2 + len(str(begin)))
        for k in self._xy:
            places = int(self._words.decimals[k])
            column = counts[begin : end + 1, k]
            says = np.flatnonzero(np.diff(column) != 0) + 1
            size += sum(1 + len(decimal(count, places)) for count in column[says].tolist())
        arcs = int(np.count_nonzero(self._draft.items["bulge"][begin:end]))
        return size + arcs * 2 * (_MOVE_BYTES + int(self._words.decimals[self._xy[0]]))


def _rhythm(points: Floats) -> Floats:
    """(k,) float from 0 to 1: parameters for points (k, 2) of a curve whose knots are to be evenly apart: its affine arc length.

    That is the integral of the cube root of the curvature: spans are short where the way bends. Near straight stretches keep a little.
    """
    steps = np.diff(points, axis=0)
    length = np.linalg.norm(steps, axis=1)
    angle = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    bend = np.abs(np.diff(angle)) / np.maximum(0.5 * (length[1:] + length[:-1]), 1e-12)
    bend = np.concatenate([bend[:1], bend, bend[-1:]])
    density = np.cbrt(bend / max(float(bend.max()), 1e-12) + _STRAIGHT_SHARE)
    whole = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1]) * length))
    return np.asarray(whole / whole[-1])


def _is_uniform(curve: Curve) -> bool:
    """Whether inner knots are simple and evenly apart, and the degree is one that G5.2 has."""
    inner = curve.knots[curve.degree : len(curve.knots) - curve.degree]
    steps = np.diff(inner)
    return curve.degree >= 2 and bool(np.all(np.abs(steps - steps.mean()) <= 1e-9 * (inner[-1] - inner[0])))
