"""Does the device hold what it was told, and does it follow the heartbeat? Compared at every cycle, told after it had time."""

from __future__ import annotations

from collections import deque

SETTLE_S = 0.3  # a device's own cycle, twice the poll period and a write that is repeated


class Disagreements:
    """Per register: since when what is read differs from what is wanted, and how often it did."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._since: dict[str, float] = {}
        self._texts: dict[str, str] = {}

    def agree(self, name: str) -> None:
        """The device holds what is wanted."""
        self._since.pop(name, None)
        self._texts.pop(name, None)

    def differ(self, name: str, text: str, now: float) -> None:
        """The device holds something else; `text` says what."""
        self.counts[name] = self.counts.get(name, 0) + 1
        self._since.setdefault(name, now)
        self._texts[name] = text

    def faults(self, now: float) -> list[str]:
        """What has differed for longer than a device needs."""
        return [f"wrong value read back: {self._texts[name]}" for name, since in self._since.items() if now - since > SETTLE_S]

    def clear(self) -> None:
        """Begin anew (the device was lost)."""
        self._since.clear()
        self._texts.clear()


class Heartbeat:
    """A counter that the device has to echo; without the echo its dead-man cannot be trusted.

    top : greatest value (1 for a bit); the count goes 1..top and round again. limit_s : for the echo.
    """

    def __init__(self, top: int, limit_s: float) -> None:
        self.value = 0
        self._top = top
        self._limit_s = limit_s
        self._sent: deque[tuple[int, float]] = deque(maxlen=256)
        self._echoed_at: float | None = None
        self._followed = 0.0  # when the count that came back last was sent
        self._has_followed = False

    @property
    def following(self) -> int:
        """The count that comes next (a bit toggles)."""
        return 1 - self.value if self._top == 1 else self.value % self._top + 1

    def next(self) -> int:
        """Go on to the next count."""
        self.value = self.following
        return self.value

    def sent(self, now: float) -> None:
        """The count was taken by the device."""
        self._sent.append((self.value, now))
        if self._echoed_at is None:
            self._echoed_at = now  # its time starts with the first beat

    def echo(self, value: float, at: float) -> None:
        """What the device shows in a reading taken at time `at`."""
        told_at = next((sent_at for count, sent_at in reversed(self._sent) if count == value and at - sent_at <= self._limit_s), None)
        if told_at is not None:
            self._echoed_at = at
            self._followed = told_at
            self._has_followed = True

    def is_forgotten(self, value: float) -> bool:
        """Whether the device shows 0, which is never sent, though it has followed before: it was started anew. A bit cannot tell."""
        return self._has_followed and self._top > 1 and value == 0.0

    def is_followed(self, now: float) -> bool:
        """Whether a recent count has come back in time (true before the first one)."""
        return self._echoed_at is None or now - self._echoed_at <= self._limit_s

    def behind_s(self, now: float) -> float:
        """Age of the count that came back last (0 before the first one)."""
        return now - self._followed if self._has_followed else 0.0

    def clear(self) -> None:
        """Begin anew (the device was lost)."""
        self._sent.clear()
        self._echoed_at = None
        self._has_followed = False
