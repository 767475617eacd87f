"""The state of one device's wire: what a server does to answers when the wire or the device's front end is at fault."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Wire:
    """Faults of one device's link. All off: the device answers at once and rightly.

    `breaks` only counts: a connection that was made before the last one is closed by the device without a word.
    """

    is_silent: bool = False
    is_gone: bool = False  # nothing listens: a TCP connection is refused, an RTU line's port is not there
    exception: int = 0  # answered to every request when not 0
    delay_s: float = 0.0  # wire time before every answer
    extra_count: int = 0  # registers too many (or too few) in answers to reads
    late_answers: int = 0  # so many answers come late; what is asked meanwhile is answered in its turn
    late_s: float = 0.0
    breaks: int = 0

    def take_delay_s(self) -> float:
        """Wire time before the answer that is made now; a late one counts."""
        if not self.late_answers:
            return self.delay_s
        self.late_answers -= 1
        return max(self.delay_s, self.late_s)

    def mend(self) -> None:
        """Back to a good wire."""
        self.is_silent, self.is_gone, self.exception, self.delay_s, self.extra_count = False, False, 0, 0.0, 0
        self.late_answers, self.late_s = 0, 0.0
