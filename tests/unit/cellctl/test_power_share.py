"""Power goes with the speed where the machine will be: against the share that a feed override leaves, and what is worth a write."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

import pytest

from cellctl.cell.power_share import PowerShare
from cellctl.domain.sync import Follower


@dataclass
class Moving:
    """A machine that goes on at `speed` times what is planned, told by a report at `at`."""

    speed: float = 1.0
    at: float = 0.0
    is_run: bool = True
    period_s: float = 0.1
    rate: float = 1.0
    last: Moving = field(init=False)

    def __post_init__(self) -> None:
        self.last = self

    def predicted_time(self, at: float) -> float:
        return self.speed * at


def share_of(moving: Moving) -> PowerShare:
    return PowerShare(cast("Follower", moving), 0.02)


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.5, 0.9])
def test_power_per_length_is_kept_below_the_planned_speed(speed: float) -> None:
    assert share_of(Moving(speed)).at(0.05, 0.06, 0.001) == pytest.approx(speed)


@pytest.mark.parametrize("speed", [0.985, 1.0, 1.5])
def test_the_set_power_is_the_most_there_is(speed: float) -> None:
    assert share_of(Moving(speed)).at(0.05, 0.06, 0.001) == 1.0


def test_two_writes_are_as_far_apart_as_a_slow_line_needs() -> None:
    moving = Moving(0.5, at=1.0)
    share = share_of(moving)
    assert share.at(1.00, 1.01, 0.040) == pytest.approx(0.5)
    moving.speed = 0.4
    assert share.at(1.10, 1.11, 0.040) == pytest.approx(0.5)
    moving.at = 1.2
    assert share.at(1.20, 1.21, 0.040) == pytest.approx(0.4)


def test_a_machine_that_stands_changes_nothing() -> None:
    assert share_of(Moving(0.2, is_run=False)).at(0.05, 0.06, 0.001) == 1.0
