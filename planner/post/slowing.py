"""Where and how much the tip is slower than asked, which axis is why, and what the whole Program will take: for the report of a post."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from planner.post.clock import barrier_waits_s
from planner.post.tracking import ActualSpeed
from planner.program import Program

if TYPE_CHECKING:
    from planner.post.sequence import Sequencer

SLOW = 0.95
"""Of the asked speed: below it a move counts as slow."""
_LEAST_MM = 0.2  # of an operation: less is not worth a line
_LINES_MOST = 5
_KINDS = ("velocity", "acceleration", "jerk")


@dataclass(frozen=True)
class Slowed:
    """What of one operation is slower than asked.

    operation, layer : numbers   process : in words   share : least speed of the asked one   length_mm : of all that is slow
    mean : mean speed there of the asked one   why : the axis and what of it is short, or what the control does
    """

    operation: int
    layer: int
    process: str
    share: float
    mean: float
    length_mm: float
    why: str

    def __str__(self) -> str:
        return (
            f"operation {self.operation} ({self.process}), layer {self.layer}: {self.length_mm:.1f} mm at {100.0 * self.mean:.0f} % "
            f"of the asked speed, at least {100.0 * self.share:.0f} %, {self.why}"
        )


@dataclass(frozen=True)
class SpeedReport:
    """slowed : operations with slow stretches, longest first   slowed_blocks, limited_blocks : moves lengthened for the control's
    blocks per second, for an axis   process_mm : length of all passes at feed
    program_s : predicted, without barriers   waits_s : predicted of all barriers
    """

    slowed: tuple[Slowed, ...]
    slowed_blocks: int
    limited_blocks: int
    process_mm: float
    program_s: float
    waits_s: float
    shortest: tuple[int, int, float, float] | None = None
    """Operation, pass, way in mm and share of the asked speed of the move that the control's rates slowed most."""

    @property
    def total_s(self) -> float:
        """Predicted time of the job, s."""
        return self.program_s + self.waits_s

    @property
    def lines(self) -> list[str]:
        """At most a few lines for a person."""
        told = [str(item) for item in self.slowed[:_LINES_MOST]]
        rest = self.slowed[_LINES_MOST:]
        if rest:
            length, least = sum(item.length_mm for item in rest), min(item.share for item in rest)
            told.append(
                f"{len(rest)} more operations: {length:.1f} mm slower than asked, at least {100.0 * least:.0f} %"
            )
        if self.slowed_blocks:
            text = f"{self.slowed_blocks} moves slowed to what the controller takes per second (max_blocks_per_s, baud)"
            if self.shortest is not None:
                operation, index, way, share = self.shortest
                text += f", most of all pass {index} of operation {operation} at {way:.2f} mm: to {100.0 * share:.0f} %"
            told.append(text)
        return told


def speed_report(sequencer: Sequencer, program: Program) -> SpeedReport:
    """Of a sequencer that has run, and the Program made of its tape."""
    speed, timer = sequencer.speed, sequencer.timer
    found: list[Slowed] = []
    total_mm = 0.0
    if speed is not None:
        total_mm = float(speed.length_mm.sum())
        found = _slowed(sequencer, speed)
    found = [item for item in found if item.length_mm >= _LEAST_MM]
    found.sort(key=lambda item: -item.length_mm * (1.0 - item.mean))
    return SpeedReport(
        tuple(found),
        timer.slowed_blocks,
        timer.limited_blocks,
        total_mm,
        program.duration_s,
        barrier_waits_s(sequencer.tape.entries, sequencer.cell),
        timer.shortest,
    )


def _slowed(sequencer: Sequencer, speed: ActualSpeed) -> list[Slowed]:
    number = sequencer.tape.items()["operation"][speed.item]
    slow = np.flatnonzero(speed.share < SLOW)
    why = _reasons(sequencer)
    found = []
    for operation in np.unique(number[slow]).tolist():
        rows = slow[number[slow] == operation]
        posted = sequencer.posted[operation]
        length = float(speed.length_mm[rows].sum())
        planned_s = float((speed.length_mm[rows] / speed.planned[rows, 1]).sum())
        mean = planned_s / float(speed.time_s[rows].sum())
        because = why.get(operation, "corners")
        found.append(
            Slowed(operation, posted.layer, posted.process.value, float(speed.share[rows].min()), mean, length, because)
        )
    return found


def _reasons(sequencer: Sequencer) -> dict[int, str]:
    """Operation -> which axis limits it over the longest way."""
    letters = sequencer.cell.letters
    lengths: dict[int, dict[int, float]] = {}
    for operation, _, begin, end, code in sequencer.timer.limiting:
        of_operation = lengths.setdefault(operation, {})
        of_operation[code] = of_operation.get(code, 0.0) + end - begin
    most = {operation: max(of.items(), key=lambda pair: pair[1])[0] for operation, of in lengths.items()}
    return {operation: f"{_KINDS[code % 3]} of axis {letters[code // 3]}" for operation, code in most.items()}
