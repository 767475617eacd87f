"""What the doctor may do, and how it is stopped."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

Ask = Callable[[str], Awaitable[str | None]]
"""Shows a line to the person at the machine; their answer, None when nobody answers any more."""


class DoctorError(Exception):
    """The cell cannot be examined now. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


@dataclass(frozen=True)
class Options:
    """By default nothing is written, moved or asked.

    probe_ports : open every serial port, at several speeds; opening resets some boards, so no machine may be running
    let_dead_man_expire : write heartbeats and one harmless output per device, then fall silent
    locked_out_by : how a person has made emission impossible; needed for the laser's dead-man on a real cell
    ask : asks the person at the machine for E-stop, door and the other contacts; None: nobody is asked
    may_move : steps of each axis after a confirmation, and the head's slide for the I/O coupler's dead-man
    status_queries, requests : how many are timed;  answer_s : how long a contact may take after it was asked for
    """

    who: str = ""
    probe_ports: bool = False
    let_dead_man_expire: bool = False
    locked_out_by: str = ""
    ask: Ask | None = None
    may_move: bool = False
    status_queries: int = 20
    requests: int = 100
    answer_s: float = 10.0
