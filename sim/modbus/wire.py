"""The state of one device's wire: what a server does to answers when the wire or the device's front end is at fault."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Wire:
    """Faults of one device's link. All off: the device answers at once and rightly."""

    is_silent: bool = False
    exception: int = 0  # answered to every request when not 0
    delay_s: float = 0.0  # wire time before every answer
    extra_count: int = 0  # registers too many (or too few) in answers to reads

    def mend(self) -> None:
        """Back to a good wire."""
        self.is_silent, self.exception, self.delay_s, self.extra_count = False, 0, 0.0, 0
