"""What the CNC driver tells: one frozen record per thing that happened, and the records that it can be asked for."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Identity:
    """Who is at the other end.

    rx_bytes : size of the receive buffer as the firmware states it; window_bytes : what may stand unanswered
    planner_blocks : motion blocks that an empty planner holds
    reports_lines : whether `Ln:` can be expected in status reports (None: the firmware does not say)
    """

    firmware: str
    version: str
    letters: tuple[str, ...]
    rx_bytes: int
    planner_blocks: int
    window_bytes: int
    options: str = ""
    reports_lines: bool | None = None


@dataclass(frozen=True, slots=True)
class Status:
    """One status report, with what earlier reports said of the fields that this one leaves out.

    machine, work, wco : axis letter -> mm or deg; work and wco are empty until the firmware has told its offsets
    line : N-word of the executing line, None if not reported
    at : clock time at which the report was parsed (s); has_rpm : whether the firmware reports the spindle's speed
    """

    state: str
    substate: int | None
    machine: dict[str, float]
    work: dict[str, float]
    wco: dict[str, float]
    line: int | None
    feed_mm_min: float
    rpm: float
    planner_free: int | None
    rx_free: int | None
    tool: int | None
    pins: str
    overrides: tuple[int, int, int]
    at: float
    has_rpm: bool = True

    @property
    def is_idle(self) -> bool:
        """Whether the machine stands and waits for commands."""
        return self.state == "Idle"

    @property
    def is_held(self) -> bool:
        """Whether the machine stands in a hold (Hold:0: a reset is safe for the position)."""
        return self.state == "Hold" and self.substate in (0, None)


@dataclass(frozen=True, slots=True)
class LineCounts:
    """How far the loaded program has come; each is a number of lines counted from its start.

    sent : given to the wire whole. acknowledged : parsed (`ok`). executing : N-word that moves now (0: none).
    executed : done, by `Ln:` or by Idle with everything answered; never by `ok`.
    """

    sent: int
    acknowledged: int
    executing: int
    executed: int


@dataclass(frozen=True, slots=True)
class Welcome:
    """The banner came: the controller has reset. `forgotten` lines were in flight and will never be answered."""

    banner: str
    expected: bool
    forgotten: int


@dataclass(frozen=True, slots=True)
class StatusReport:
    """A status report was read. unanswered: lines that had no answer yet at its place in the stream of answers."""

    status: Status
    unanswered: int


@dataclass(frozen=True, slots=True)
class LineAccepted:
    """The line with N-word n was parsed without error (not: executed)."""

    n: int


@dataclass(frozen=True, slots=True)
class LineRejected:
    """The line with N-word n was refused, by the firmware (code > 0) or before it was sent (code 0). The stream has stopped."""

    n: int
    code: int
    text: str
    line: str
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class AlarmRaised:
    """The firmware raised an alarm."""

    code: int
    cause: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Message:
    """The firmware said something for a person ([MSG:...])."""

    text: str


@dataclass(frozen=True, slots=True)
class AnswerOverdue:
    """No answer came to the line with N-word n (0: to a command); `garbled` is what came damaged since it was sent."""

    n: int
    line: str
    waited_s: float
    garbled: str = ""


@dataclass(frozen=True, slots=True)
class ProtocolFault:
    """What came cannot be: an answer to nothing (doubled ok), or text that no firmware sends."""

    text: str
    garbled: bool = False


@dataclass(frozen=True, slots=True)
class PortLost:
    """The serial line is gone; the driver sends nothing more."""

    message: str
    hint: str = field(default="plug the CNC's cable in again and reset")


CncEvent = (
    Welcome | StatusReport | LineAccepted | LineRejected | AlarmRaised | Message | AnswerOverdue | ProtocolFault | PortLost
)
