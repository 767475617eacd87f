"""Watches a read-back cross a level after a write, and brackets the time of it between two readings."""

from __future__ import annotations

from drivers.modbus.latency import Edge


class Crossing:
    """One read-back of one device. longest_s : after so long without a crossing nothing is learnt."""

    def __init__(self, longest_s: float) -> None:
        self._longest_s = longest_s
        self._edge: Edge | None = None
        self._began_at = 0.0
        self._level = 0.0
        self._is_rising = True
        self._seen_old_s = 0.0

    def begin(self, edge: Edge, began_at: float, level: float, *, is_rising: bool) -> None:
        """A write that began at wire time `began_at` (s) will take the read-back across `level`."""
        self._edge, self._began_at, self._level, self._is_rising = edge, began_at, level, is_rising
        self._seen_old_s = 0.0

    def drop(self) -> None:
        """Something else was written: the reading no longer tells of the first write."""
        self._edge = None

    @property
    def is_open(self) -> bool:
        """Whether a crossing is waited for."""
        return self._edge is not None

    def read(self, value: float, sent_at: float, answered_at: float) -> None:
        """A reading that was asked for at `sent_at` and answered at `answered_at` (wire time, s)."""
        if self._edge is None or sent_at < self._began_at:
            return
        if answered_at - self._began_at > self._longest_s:
            self._edge = None
        elif (value >= self._level) == self._is_rising:
            self._edge.bracket(self._seen_old_s, answered_at - self._began_at)
            self._edge = None
        else:
            self._seen_old_s = sent_at - self._began_at
