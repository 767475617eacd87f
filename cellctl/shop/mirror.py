"""The cell's data items as last told, what changed, and the numbered observations that an agent keeps."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from cellctl.shop.freshness import Known
from cellctl.shop.mtconnect_words import PART_COUNT, Active, Item, Value, items_of, observe
from cellctl.shop.shdr import condition_lines
from config.cell import Cell

BUFFER = 131_072  # observations: over ten minutes of a cell of which everything changes ten times a second
Change = tuple[Value, Value]


@dataclass(frozen=True)
class Observation:
    """One numbered observation. value : text, or one condition; None: UNAVAILABLE    at : Unix time (s)"""

    sequence: int
    at: float
    item: Item
    value: str | Active | None


class Mirror:
    """Holds the newest value of every data item and the last BUFFER observations."""

    def __init__(self, cell: Cell, at: float, size: int = BUFFER) -> None:
        """at : Unix time (s) of the begin, when everything is unavailable"""
        self.cell = cell
        self.items = [*items_of(cell), PART_COUNT]
        self.by_id = {item.id: item for item in self.items}
        self.conditions = {item.id for item in self.items if item.category == "CONDITION"}
        self.messages = {item.id for item in self.items if item.type == "MESSAGE"}
        self.values: dict[str, Value] = {}
        self.kept: deque[Observation] = deque(maxlen=size)
        self.current: dict[str, list[Observation]] = {}
        self.instance = int(at)
        self.next_sequence = 1
        self.update(Known(cell.name), 0.0, at)

    @property
    def first_sequence(self) -> int:
        """Number of the oldest observation that is kept."""
        return self.kept[0].sequence if self.kept else 1

    def update(self, known: Known, now: float, at: float) -> dict[str, Change]:
        """Look at what is known; what changed, by id. now : s, monotonic    at : Unix time (s)"""
        completed = None if known.completed is None else len(known.completed)
        values = observe(self.items[:-1], known.fresh(now), completed)
        changes = {name: (self.values.get(name), value) for name, value in values.items() if name not in self.values or self.values[name] != value}
        for name, (before, value) in changes.items():
            self._keep(name, before, value, at)
        self.values = values
        return changes

    def everything(self) -> dict[str, Change]:
        """All values as if they had just come: what an agent is told that has just connected."""
        return {name: (None, value) for name, value in self.values.items()}

    def sample(self, first: int, count: int) -> list[Observation]:
        """At most `count` kept observations from number `first` on."""
        skip = max(first - self.first_sequence, 0)
        return [self.kept[index] for index in range(skip, min(skip + count, len(self.kept)))]

    def newest(self) -> Iterator[Observation]:
        """The newest observation of every data item; of a condition all that are active."""
        for found in self.current.values():
            yield from found

    def _keep(self, name: str, before: Value, value: Value, at: float) -> None:
        item = self.by_id[name]
        if name not in self.conditions:
            told: list[str | Active | None] = [value if isinstance(value, str) else None]
        else:
            told = [None if one.level == "UNAVAILABLE" else one for one in condition_lines(before, value)]
        made = [Observation(self.next_sequence + index, at, item, one) for index, one in enumerate(told)]
        self.next_sequence += len(made)
        self.kept.extend(made)
        if isinstance(value, tuple) and value:
            was = [one for one in self.current.get(name, []) if one.value in value]
            self.current[name] = was + [one for one in made if one.value in value]
        else:
            self.current[name] = made[-1:]
