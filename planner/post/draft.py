"""A program on its way from tape to text: the tape's items that are written, and the lines that come in between."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.kinematics.chain import Floats
from planner.post.macros import MacroBook
from planner.post.tape import Move, Tape
from planner.post.words import Words
from planner.program import LineKind

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_REMARK, _SETTING = -0.5, -0.25  # before the item, in this order
_AXES = 0b11111
_COMMENT = re.compile(r"\([^)]*\)")
_STANDS = re.compile(r"(?:\s*(?:G(?:4|17|21|40|49|54|61|64|80|90|94)(?![\d.])|[MTSPQEFH][\d.]+))*\s*")
"""Words behind which the axes are where they were."""


@dataclass
class Draft:
    """Items in order with their texts, and what is to be put between them.

    items : (n,) ITEM_DTYPE, joints rounded   keys : (n,) float, the tape's item that a row stands for; fractions: rows that came in between
    texts : n, None: a move
    """

    items: NDArray[np.void]
    keys: Floats
    texts: list[str | None]
    _added: list[tuple[float, int, str, bool]] = field(default_factory=list)

    @classmethod
    def of(cls, tape: Tape, words: Words) -> Draft:
        """The tape's items with rounded joints, without moves that do not move."""
        items, keys = _moving(tape.items(), words)
        texts = [tape.commands[index] if index >= 0 else None for index in items["command"].tolist()]
        return cls(items, keys.astype(np.float64), texts)

    def only(self, is_kept: Bools) -> Draft:
        """The rows (n,) bool that are kept."""
        texts = [text for text, kept in zip(self.texts, is_kept.tolist(), strict=True) if kept]
        return Draft(self.items[is_kept], self.keys[is_kept], texts)

    def add(self, item: int, text: str) -> None:
        """A line without motion before the first row at or behind an item of the tape, of the same pass."""
        row = min(int(np.searchsorted(self.keys, item)), len(self.keys) - 1)
        self._added.append((float(self.keys[row]) + _SETTING, row, text, False))

    def add_remark(self, row: int, text: str) -> None:
        """A comment before a row."""
        self._added.append((float(self.keys[row]) + _REMARK, row, text, True))

    def add_first(self, text: str) -> None:
        """A comment before everything."""
        self._added.append((-1.0, 0, text, True))

    def completed(self, book: MacroBook) -> Draft:
        """With all lines that were added, and commands expanded by the macros (behind one that moves, all axes are named)."""
        added = list(self._added)
        texts = list(self.texts)
        gone = np.zeros(len(texts), dtype=np.bool_)
        items = self.items.copy()
        for row, text in enumerate(self.texts):
            if text is None:
                continue
            lines = book.expanded(text)
            gone[row] = not lines
            texts[row] = lines[0] if lines else text
            added += [(float(self.keys[row]) + 1e-3 * k, row, line, False) for k, line in enumerate(lines[1:], 1)]
            if lines != (text,) and _moves(lines):
                _name_all(items, row)
        rows = np.array([row for _, row, _, _ in added], dtype=np.int64)
        extra = _standing(items, rows, np.array([plain for _, _, _, plain in added], dtype=np.bool_))
        keys = np.concatenate([self.keys, [key for key, _, _, _ in added]])
        every = [*texts, *(text for _, _, text, _ in added)]
        order = np.argsort(keys, kind="stable")
        order = order[~np.append(gone, np.zeros(len(added), dtype=np.bool_))[order]]
        return Draft(np.concatenate([items, extra])[order], keys[order], [every[k] for k in order.tolist()])

    def line_of_item(self, count: int) -> Ints:
        """(count,) int: first row at or behind each item of the tape, rows that came in between not counted."""
        own = np.flatnonzero(self.keys == np.floor(self.keys))
        own = own[self.keys[own] >= 0.0]
        return np.asarray(own[np.searchsorted(self.keys[own], np.arange(count)).clip(0, len(own) - 1)])


def _moves(lines: Iterable[str]) -> bool:
    """Whether a macro may leave the axes elsewhere: any G-word but modes, any axis word, anything that is not words."""
    return any(not _STANDS.fullmatch(_COMMENT.sub("", line)) for line in lines)


def _name_all(items: NDArray[np.void], row: int) -> None:
    """Name every axis on the first move behind a row."""
    behind = np.flatnonzero(items["move"][row:] != Move.NONE)
    if behind.size:
        items["named"][row + int(behind[0])] |= _AXES


def _standing(items: NDArray[np.void], rows: Ints, is_remark: Bools) -> NDArray[np.void]:
    """Items without motion at the start of `rows`; comments belong to no pass."""
    extra = items[rows].copy()
    before = np.maximum(rows - 1, 0)
    is_move = extra["move"] != Move.NONE
    for name in ("joints", "tool"):
        extra[name] = items[name][np.where(is_move | (is_remark & (rows > 0)), before, rows)]
    extra["time_s"] = extra["way"] = extra["bulge"] = 0.0
    extra["arc_end_mm"] = extra["arc_start_mm"]
    extra["move"], extra["named"] = Move.NONE, 0
    extra["stop"] &= ~is_move & ~is_remark
    extra["kind"][is_remark] = LineKind.SETUP
    extra["pass_"][is_remark] = -1
    extra["arc_start_mm"][is_remark] = extra["arc_end_mm"][is_remark] = 0.0
    return extra


def _lengthen_arcs(items: NDArray[np.void]) -> None:
    """Give arcs the length of the circle, not of the chord, as their way: sweep / 2 over its sine as long."""
    arcs = np.flatnonzero(items["bulge"] != 0.0)
    half = 2.0 * np.arctan(items["bulge"][arcs])
    before = items["joints"][np.maximum(arcs - 1, 0)]
    chord = np.linalg.norm(items["joints"][arcs] - before, axis=1)
    items["way"][arcs] = chord * half / np.sin(half)


def _moving(items: NDArray[np.void], words: Words) -> tuple[NDArray[np.void], Ints]:
    """Items with rounded joints, without moves that do not move; and which item each was."""
    counts = words.counts(items["joints"])
    items = items.copy()
    _lengthen_arcs(items)
    items["joints"] = words.joints(counts)
    moves = np.append(True, np.any(np.diff(counts, axis=0) != 0, axis=1))
    is_kept = moves | (items["move"] == Move.NONE) | (items["named"] != 0)
    dropped = np.flatnonzero(~is_kept)
    for i in dropped:  # the line before it, of the same pass, stands for its arc length too
        before = i - 1
        while before >= 0 and not is_kept[before]:
            before -= 1
        if before >= 0 and items[before]["chunk"] == items[i]["chunk"]:
            items[before]["arc_end_mm"] = items[i]["arc_end_mm"]
            items[before]["time_s"] += items[i]["time_s"]
            items[before]["way"] += items[i]["way"]
        elif i + 1 < len(items) and items[i + 1]["chunk"] == items[i]["chunk"]:
            items[i + 1]["arc_start_mm"] = items[i]["arc_start_mm"]
    return items[is_kept], np.flatnonzero(is_kept)
