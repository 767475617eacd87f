"""The program before it is text: moves and commands in order, with what each stands for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from planner.kinematics.chain import Floats
from planner.post.arc_shape import arc_over_chord
from planner.program import SCHEDULE_DTYPE, Channel, LineKind

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Move(IntEnum):
    """How an item moves."""

    NONE = 0
    RAPID = 1
    FEED = 2


ITEM_DTYPE = np.dtype(
    [
        ("kind", "u1"),
        ("layer", "<i4"),
        ("operation", "<i4"),
        ("pass_", "<i4"),
        ("arc_start_mm", "<f8"),
        ("arc_end_mm", "<f8"),
        ("joints", "<f8", (5,)),  # at the end, mm or deg, machine coordinates
        ("tool", "<i4"),  # number of the tool in the spindle
        ("time_s", "<f8"),  # nominal
        ("way", "<f8"),  # of the joints, mm and deg alike, before rounding
        ("bulge", "<f8"),  # of an arc in the machine's XY plane: tan(sweep / 4), counter-clockwise > 0; 0: straight
        ("move", "u1"),
        ("named", "u1"),  # bit k: axis k is named even if it does not move
        ("stop", "?"),  # the machine stands before and after
        ("chunk", "<i4"),  # moves that were added together
        ("command", "<i4"),  # index of the command's text, -1: a move
    ]
)


@dataclass(frozen=True)
class Origin:
    """What the next items belong to; -1: none."""

    kind: LineKind = LineKind.SETUP
    layer: int = -1
    operation: int = -1
    pass_: int = -1


@dataclass(frozen=True)
class Entry:
    """One entry of the process schedule at an item of the tape."""

    item: int
    channel: Channel
    value: float
    is_barrier: bool


@dataclass
class Tape:
    """Items in order; grows by commands and by chunks of moves.

    joints : (5,) float, where the machine stands at the end   tool : number of the tool that is in, 0: none
    """

    joints: Floats
    tool: int = 0
    commands: list[str] = field(default_factory=list)
    entries: list[Entry] = field(default_factory=list)
    count: int = 0
    dwells: dict[int, tuple[float, int]] = field(default_factory=dict)
    """Item of a dwell -> (least time, s, since the start of an item; that item)."""
    _chunks: list[NDArray[np.void]] = field(default_factory=list)

    def command(self, text: str, origin: Origin, stops: bool = False, time_s: float = 0.0) -> int:
        """Add a line that is not a motion and takes time_s; returns its item. `stops` : the machine stands for it."""
        item = self._items(1, origin)
        item["command"] = len(self.commands)
        item["stop"] = stops
        item["time_s"] = time_s
        item["joints"] = self.joints
        self.commands.append(text)
        return self._add(item)

    def dwell(self, origin: Origin, least_s: float, since_item: int) -> None:
        """Add a dwell that ends at least so long after the start of an item."""
        item = self.command("", origin, stops=True)
        self.dwells[item] = (least_s, since_item)

    def moves(
        self,
        joints: Floats,
        arcs_mm: Floats,
        times_s: Floats,
        move: Move,
        origin: Origin,
        named: int = 0,
        bulge: Floats | float = 0.0,
    ) -> int:
        """Add joint moves to (n, 5) joints; arcs_mm : (n + 1,) at their ends; named : bits of axes; bulge : (n,) of arcs.

        Returns the first item.
        """
        items = self._items(len(joints), origin)
        items["joints"] = joints
        items["arc_start_mm"] = arcs_mm[:-1]
        items["arc_end_mm"] = arcs_mm[1:]
        items["time_s"] = times_s
        items["move"] = move
        items["named"] = named
        items["bulge"] = bulge
        chords = np.linalg.norm(np.diff(joints, axis=0, prepend=self.joints[None, :]), axis=1)
        items["way"] = chords * arc_over_chord(items["bulge"])
        self.joints = np.array(joints[-1])
        return self._add(items)

    def schedule(self, channel: Channel, value: float, item: int, is_barrier: bool = False) -> None:
        """Set a channel when an item begins."""
        self.entries.append(Entry(item, channel, value, is_barrier))

    def since(self, item: int) -> NDArray[np.void]:
        """(k,) ITEM_DTYPE: the items from one on, at which a chunk begins."""
        kept, begin = len(self._chunks), self.count
        while begin > item:
            kept -= 1
            begin -= len(self._chunks[kept])
        return _joined(self._chunks[kept:]) if kept < len(self._chunks) else np.zeros(0, ITEM_DTYPE)

    def items(self) -> NDArray[np.void]:
        """(count,) ITEM_DTYPE."""
        return _joined(self._chunks)

    def _items(self, count: int, origin: Origin) -> NDArray[np.void]:
        items = np.zeros(count, ITEM_DTYPE)
        items["kind"], items["layer"], items["operation"], items["pass_"] = (
            origin.kind,
            origin.layer,
            origin.operation,
            origin.pass_,
        )
        items["tool"], items["chunk"], items["command"] = self.tool, len(self._chunks), -1
        return items

    def _add(self, items: NDArray[np.void]) -> int:
        first = self.count
        self._chunks.append(items)
        self.count += len(items)
        return first


def _joined(chunks: Sequence[NDArray[np.void]]) -> NDArray[np.void]:
    """All rows one after the other: as bytes, which np.concatenate puts together without looking at each field."""
    plain = [chunk.view(np.dtype((np.void, ITEM_DTYPE.itemsize))) for chunk in chunks]
    return np.concatenate(plain).view(ITEM_DTYPE) if plain else np.zeros(0, ITEM_DTYPE)


def schedule_of(entries: Sequence[Entry], line_of_item: Ints) -> NDArray[np.void]:
    """(k,) SCHEDULE_DTYPE in order of lines; of two values of one channel at one line only the last stays.

    line_of_item : (items,) int, index of the first line at or after each item
    """
    found: dict[tuple[int, Channel], Entry] = {}
    for entry in entries:
        key = (int(line_of_item[entry.item]), entry.channel)
        found.pop(key, None)
        found[key] = entry
    rows = sorted(((line, entry) for (line, _), entry in found.items()), key=lambda row: row[0])
    schedule = np.zeros(len(rows), SCHEDULE_DTYPE)
    for place, (line, entry) in enumerate(rows):
        schedule[place] = (line + 1, int(entry.channel), int(entry.is_barrier), entry.value)
    return schedule
