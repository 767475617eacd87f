"""Speed of the tip under the limits of all axes: finite differences of the motion that results, and a second way to the shortest time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from planner.kinematics.feed import AxisLimits, SpeedProfile, speed_profile

Array = np.ndarray
Path = Callable[[Array], Array]

ACCELERATION = np.array([1500.0, 1500.0, 1200.0, 400.0, 800.0])
LIMITS = AxisLimits(np.array([250.0, 250.0, 200.0, 90.0, 180.0]), ACCELERATION, 20.0 * ACCELERATION)
STEP_S = 0.001
MEANT_S = 0.01  # jerk is meant over this: no drive tells shorter changes apart
VELOCITY_SLACK, ACCELERATION_SLACK, JERK_SLACK = 1.01, 1.05, 1.5
RADIUS_MM = 20.0


def tilting_circle(way: Array) -> Array:
    """Once round with the table, which tilts by 30 degrees to and fro three times: the tilt axis cannot hold 40 mm/s."""
    turn = way / RADIUS_MM
    x, y = RADIUS_MM * np.cos(turn), RADIUS_MM * np.sin(turn)
    return np.column_stack([x, y, 0.0 * way, 30.0 * np.sin(3.0 * turn), np.rad2deg(turn)])


def past_the_pole(way: Array) -> Array:
    """A tool that leans from one side to the other, its axis 0.3 mm off the pole on the way: the table has to turn round quickly."""
    x, off = way - 20.0, 0.3
    return np.column_stack([x, 0.0 * x + 5.0, 0.0 * x, 0.5 * np.hypot(x, off), np.rad2deg(np.arctan2(x, off))])


def round_the_corner(way: Array) -> Array:
    """10 mm along x, a fillet of 0.05 mm, along y."""
    radius, first = 0.05, 10.0
    arc = radius * np.pi / 2.0
    turned = np.clip((way - first) / radius, 0.0, np.pi / 2.0)
    x = np.minimum(way, first) + radius * np.sin(turned)
    y = radius * (1.0 - np.cos(turned)) + np.maximum(way - first - arc, 0.0)
    none = 0.0 * way
    return np.column_stack([x, y, none, none, none])


SAMPLES: dict[Path, Array] = {
    tilting_circle: np.linspace(0.0, 2.0 * np.pi * RADIUS_MM, 400),
    past_the_pole: np.unique(
        np.append(np.linspace(0.0, 40.0, 200), 20.0 + 5.0 * np.sinh(np.linspace(-4, 4, 200)) / np.sinh(4))
    ),
    round_the_corner: np.unique(np.append(np.linspace(0.0, 20.0, 100), np.linspace(10.0, 10.0 + 0.025 * np.pi, 20))),
}


def profile_of(path: Path, asked: float) -> SpeedProfile:
    way = SAMPLES[path]
    return speed_profile(path(way), way, np.full(len(way) - 1, asked), LIMITS)


def places(profile: SpeedProfile) -> Array:
    """Way of the tip at every STEP_S: between two places the speed is linear in time."""
    ends = np.append(0.0, np.cumsum(profile.stretch_times_s))
    time = np.arange(0.0, ends[-1], STEP_S)
    at = np.searchsorted(ends, time, side="right").clip(1, len(ends) - 1) - 1
    since, speed = time - ends[at], profile.speed_mm_s
    acceleration = (speed[at + 1] - speed[at]) / (ends[at + 1] - ends[at])
    return profile.way_mm[at] + speed[at] * since + 0.5 * acceleration * since**2


def differences(positions: Array) -> tuple[Array, Array, Array]:
    """Greatest velocity, acceleration and jerk by finite differences."""
    velocity = np.diff(positions, axis=0) / STEP_S
    acceleration = np.diff(velocity, axis=0) / STEP_S
    over = round(MEANT_S / STEP_S)
    jerk = (acceleration[over:] - acceleration[:-over]) / MEANT_S
    return np.abs(velocity).max(axis=0), np.abs(acceleration).max(axis=0), np.abs(jerk).max(axis=0)


@pytest.mark.parametrize("path", SAMPLES)
@pytest.mark.parametrize("asked", [12.0, 40.0])
def test_no_axis_is_asked_for_more_velocity_acceleration_or_jerk_than_it_has(path: Path, asked: float) -> None:
    profile = profile_of(path, asked)
    velocity, acceleration, jerk = differences(path(places(profile)))
    assert np.all(velocity <= VELOCITY_SLACK * LIMITS.velocity)
    smeared = (
        ACCELERATION_SLACK if path is not round_the_corner else 2.0 * ACCELERATION_SLACK
    )  # a fillet passed within 10 ms
    assert np.all(acceleration <= smeared * LIMITS.acceleration)
    assert np.all(jerk <= JERK_SLACK * LIMITS.jerk)


@pytest.mark.parametrize("path", SAMPLES)
def test_speed_is_nowhere_above_what_is_asked_and_changes_without_steps(path: Path) -> None:
    profile = profile_of(path, 40.0)
    assert profile.speed_mm_s.max() <= 40.0 + 1e-9 and profile.speed_mm_s.min() > 0.0
    speed, acceleration, _ = differences(places(profile)[:, None])
    assert speed[0] <= 40.0 + 1e-6 and acceleration[0] <= LIMITS.acceleration[:3].max()


def test_speed_that_all_axes_hold_is_the_asked_one_all_along() -> None:
    profile = profile_of(tilting_circle, 12.0)
    assert np.all(profile.speed_mm_s == 12.0) and np.all(profile.limiting == -1)
    assert profile.times_s.sum() == pytest.approx(2.0 * np.pi * RADIUS_MM / 12.0)


def test_a_change_of_the_asked_speed_is_gone_along_smoothly_from_below() -> None:
    way = np.linspace(0.0, 40.0, 81)
    joints = np.column_stack([way, *np.zeros((4, 81))])
    asked = np.where(way[1:] <= 20.0, 12.0, 30.0)
    profile = speed_profile(joints, way, asked, LIMITS)
    middle = 0.5 * (profile.way_mm[1:] + profile.way_mm[:-1])
    assert np.all(np.minimum(profile.speed_mm_s[1:], profile.speed_mm_s[:-1])[middle < 20.0] <= 12.0 + 1e-9)
    _, acceleration, jerk = differences(places(profile)[:, None])
    assert acceleration[0] <= LIMITS.acceleration[0] and jerk[0] <= JERK_SLACK * LIMITS.jerk[0]
    assert profile.speed_mm_s[-1] == pytest.approx(30.0, rel=1e-3)


def test_the_axis_that_limits_is_named_where_it_does() -> None:
    profile = profile_of(past_the_pole, 12.0)
    way = SAMPLES[past_the_pole]
    slow = profile.limiting >= 0
    assert np.all(np.abs(0.5 * (way[1:] + way[:-1])[slow] - 20.0) < 3.0)
    assert np.all(profile.limiting[slow] // 3 == 4)  # C


def shortest_time(path: Path, asked: float, cells: int = 6000) -> float:
    """Least time under velocities and accelerations alone, any jerk, by brute force backward and forward on a fine even grid."""
    end = SAMPLES[path][-1]
    way = np.linspace(0.0, end, cells + 1)
    step = way[1]
    first = np.gradient(path(way), step, axis=0)
    second = np.gradient(first, step, axis=0)
    with np.errstate(divide="ignore"):
        cap = np.minimum(asked, (LIMITS.velocity / np.abs(first)).min(axis=1)) ** 2
        cap = np.minimum(cap, (LIMITS.acceleration / np.abs(second)).min(axis=1))
    for order in (range(cells - 1, -1, -1), range(1, cells + 1)):
        ahead = order.step  # the neighbour that was done before
        for i in order:
            other = cap[i - ahead]
            sign = -np.sign(ahead) * np.sign(first[i])
            room = (LIMITS.acceleration - np.abs(sign * second[i] * other) * (sign * second[i] < 0.0)) / np.maximum(
                np.abs(first[i]), 1e-12
            )
            cap[i] = min(cap[i], other + 2.0 * max(float(room.min()), 0.0) * step)
    speed = np.sqrt(cap)
    return float(np.sum(2.0 * step / (speed[1:] + speed[:-1])))


@pytest.mark.parametrize(("path", "asked", "share"), [(tilting_circle, 40.0, 1.04), (past_the_pole, 12.0, 1.16)])
def test_time_is_not_much_above_the_shortest_of_axes_without_bounds_of_jerk(
    path: Path, asked: float, share: float
) -> None:
    time = float(profile_of(path, asked).times_s.sum())
    least = shortest_time(path, asked)
    assert 0.99 * least <= time <= share * least
