"""The controller as it should be: feeds lines as the receive buffer takes them and carries out the schedule without delay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim import job as facts
from sim.job import Job
from sim.state import freeze, thaw
from sim.world import World

POWDER_TOLERANCE = 0.05  # relative; flow is steady within
DRY_G_MIN = 0.05
MACHINE_WAIT_S = 60.0  # a barrier that takes longer will never be passed
HOLD_MARGIN_S = 0.25  # of motion left in the planner when lines come again: every axis brakes in less
SHORT_S = 2.0  # of planned motion: several steps
CHANNEL_NAMES = {
    facts.MODE: ("mode", ""),
    facts.LASER_W: ("laser power", " W"),
    facts.POWDER_G_MIN: ("powder", " g/min"),
    facts.CARRIER_GAS_L_MIN: ("carrier gas", " L/min"),
    facts.SHIELD_GAS_L_MIN: ("shield gas", " L/min"),
    facts.EMISSION: ("emission permit", ""),
}
CARRIED = (
    "_next_event", "_sent", "acknowledged", "_pending", "_waited_s", "_last_time_s", "_purged_s", "_passed", "step_s", "power_setpoint",
    "powder_setpoint",
)  # fmt: skip
MODE_NAMES = {facts.SAFE: "safe", facts.DEPOSIT: "deposit", facts.MILL: "mill"}


class IdealController:
    """Streams a Program into a World's firmware in memory.

    `supply` is the firmware's source of lines; `hear` takes its answers; `step` carries out what is due and returns a problem or "".

    boundaries : (k,) int, ordered   N-words of lines that begin a layer. No line from there on is sent in the step that comes to one,
    if the planner has motion enough, so that at the end of that step nothing yet depends on it: `at_boundary`, until `pass_boundary`.
    """

    def __init__(self, program: Job, world: World, boundaries: Sequence[int] = ()) -> None:
        self._program, self._world = program, world
        schedule = program.schedule
        is_barrier = schedule["barrier"] == 1
        self._all_barriers: dict[int, list[tuple[int, float]]] = {}
        for row in schedule[is_barrier]:
            self._all_barriers.setdefault(int(row["n"]), []).append((int(row["channel"]), float(row["value"])))
        self._barriers = dict(self._all_barriers)
        self._events = schedule[~is_barrier]
        self._event_lines: list[int] = self._events["n"].tolist()
        self._next_event = 0
        self._sent = 0
        self.acknowledged = 0
        self._pending: list[tuple[int, float]] | None = None
        self._waited_s = 0.0
        self._last_time_s = 0.0
        self._purged_s = 0.0
        self._boundaries = tuple(boundaries)
        self._passed = 0
        self.step_s = 0.0
        self.power_setpoint = self.powder_setpoint = 0.0

    @property
    def next_line(self) -> int:
        """N-word of the next line to be sent."""
        return self._sent + 1

    @property
    def executing(self) -> int:
        """N-word of the line that moves now."""
        return int(self._world.cnc.machine.motion.line)

    @property
    def is_done(self) -> bool:
        """Whether all lines are acknowledged and the machine stands."""
        cnc = self._world.cnc
        return self.acknowledged >= len(self._program.lines) and self._pending is None and cnc.is_idle and not cnc.machine.is_busy

    @property
    def is_waiting(self) -> bool:
        """Whether a barrier is being carried out."""
        return self._pending is not None

    @property
    def until_next_s(self) -> float:
        """Time that goes by at least before the line of the next set-point begins; what is behind the next layer's begin does not count."""
        if self._next_event >= len(self._event_lines):
            return float("inf")
        line = self._event_lines[self._next_event]
        if 0 < self.boundary <= line:
            return float("inf")
        machine = self._world.cnc.machine
        return machine.timer_s + machine.motion.planned_before_s(line)

    @property
    def quiet_s(self) -> float:
        """Length of a step in which nothing is due and whose end finds motion enough for lines to wait; 0 if a set-point may be due.

        What is not sent yet cannot move before the planned blocks are done, and those take no less than `planned_s`.
        """
        if self._next_event < len(self._event_lines) and self._event_lines[self._next_event] < self.next_line:
            return 0.0
        return max(0.0, 0.5 * (self._world.cnc.machine.motion.planned_s() - HOLD_MARGIN_S))

    @property
    def boundary(self) -> int:
        """N-word of the next line that begins a layer, 0: none."""
        return self._boundaries[self._passed] if self._passed < len(self._boundaries) else 0

    @property
    def boundary_near(self) -> bool:
        """Whether the planner might take all lines before the next layer in one step and not have motion enough to wait for its end."""
        motion = self._world.cnc.machine.motion
        return 0 < self.boundary <= self.next_line + motion.capacity and motion.planned_s() < SHORT_S

    @property
    def at_boundary(self) -> bool:
        """Whether all lines before the next layer are sent and none of it."""
        return self.next_line == self.boundary

    def pass_boundary(self) -> None:
        """Let the lines of the next layer go."""
        self._passed += 1

    def begin_step(self, step_s: float) -> None:
        """Say how long the coming step is; boundaries that were run over count as passed."""
        self.step_s = step_s
        while 0 < self.boundary < self.next_line:
            self._passed += 1

    def supply(self, free: int) -> bytes:
        """The next line if it fits and no barrier holds it back."""
        if self._sent >= len(self._program.lines) or self.next_line in self._barriers:
            return b""
        if self.at_boundary and self._can_hold():
            return b""
        line = self._program.lines[self._sent].encode("ascii") + b"\n"
        if len(line) > free:
            return b""
        self._sent += 1
        return line

    def state(self) -> dict[str, Any]:
        """How far the Program is carried out, as plain data."""
        return {name: freeze(getattr(self, name)) for name in CARRIED}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state: barriers before the next line are behind."""
        for name in CARRIED:
            setattr(self, name, thaw(state[name]))
        self._barriers = {line: entries for line, entries in self._all_barriers.items() if line >= self.next_line}

    def _can_hold(self) -> bool:
        """Whether lines may wait for the end of the step without slowing the machine: it stands for a line, or has motion enough."""
        machine = self._world.cnc.machine
        return bool(machine.is_busy or machine.motion.planned_s() >= self.step_s + HOLD_MARGIN_S)

    def hear(self, text: str) -> None:
        """One answer of the firmware."""
        if text == "ok" or text.startswith("error:"):
            self.acknowledged += 1

    def step(self) -> str:
        """Carry out what is due; returns what will never come, or ""."""
        now = self._world.time_s
        elapsed, self._last_time_s = now - self._last_time_s, now
        self._apply_events()
        barrier = self._barriers.get(self.next_line)
        if barrier is None or not self._is_drained():
            self._waited_s = 0.0
            return ""
        if self._pending is None:
            self._pending = list(barrier)
        self._waited_s += elapsed
        while self._pending and self._carry_out(*self._pending[0], elapsed):
            self._pending.pop(0)
            self._waited_s = 0.0
        if not self._pending:
            self._pending = None
            del self._barriers[self.next_line]
            return ""
        channel, value = self._pending[0]
        return self._complaint(channel, value) if self._waited_s > MACHINE_WAIT_S else ""

    def _complaint(self, channel: int, value: float) -> str:
        name, unit = CHANNEL_NAMES.get(channel, (f"channel {channel}", ""))
        wanted = MODE_NAMES.get(int(value), f"{value:g}") if channel == facts.MODE else f"{value:g}{unit}"
        seen = ""
        if channel == facts.POWDER_G_MIN:
            feeder = self._world.feeder
            seen = f"; {feeder.rate_at_nozzle_g_min:.1f} g/min at the nozzle, hopper {100.0 * feeder.hopper_fraction:.0f} % full"
        return f"{name} does not reach {wanted} within {MACHINE_WAIT_S:g} s{seen}"

    def _is_drained(self) -> bool:
        machine = self._world.cnc.machine
        return self.acknowledged == self._sent and machine.motion.count == 0 and not machine.is_busy

    def _apply_events(self) -> None:
        current = self.executing if self._world.cnc.machine.motion.count else self.acknowledged
        while self._next_event < len(self._event_lines) and self._event_lines[self._next_event] <= current:
            row = self._events[self._next_event]
            self._set(int(row["channel"]), float(row["value"]))
            self._next_event += 1

    def _set(self, channel: int, value: float) -> None:
        laser, feeder = self._world.laser.values, self._world.feeder.values
        if channel == facts.LASER_W:
            self.power_setpoint = value
            laser["power_setpoint"] = value
        elif channel == facts.EMISSION:
            laser["emission_permit"] = value
        elif channel == facts.POWDER_G_MIN:
            self.powder_setpoint = value
            feeder["rate_setpoint"] = value
            if "diverter" in feeder:
                feeder["diverter"] = float(value <= 0.0)
        elif channel == facts.CARRIER_GAS_L_MIN:
            feeder["carrier_gas_setpoint"] = value
        elif channel == facts.SHIELD_GAS_L_MIN:
            feeder["shield_gas_setpoint"] = value

    def _carry_out(self, channel: int, value: float, elapsed: float) -> bool:
        """Set a barrier's value; whether the plant shows it."""
        if channel == facts.MODE:
            return self._change_mode(int(value), elapsed)
        self._set(channel, value)
        feeder = self._world.feeder
        if channel == facts.POWDER_G_MIN:
            flow = feeder.rate_at_nozzle_g_min
            return bool(abs(flow - value) <= max(POWDER_TOLERANCE * value, DRY_G_MIN))
        if channel == facts.CARRIER_GAS_L_MIN:
            return bool(abs(feeder.carrier_l_min - value) <= POWDER_TOLERANCE * max(value, 1.0))
        if channel == facts.SHIELD_GAS_L_MIN:
            return bool(abs(feeder.shield_l_min - value) <= POWDER_TOLERANCE * max(value, 1.0))
        return True

    def _change_mode(self, mode: int, elapsed: float) -> bool:
        """Deposit, mill or safe: head out or in, laser armed or locked out, powder purged first."""
        world = self._world
        laser, feeder = world.laser.values, world.feeder
        if mode == facts.DEPOSIT:
            world.io.values["head_deploy"] = 1.0
            laser["enable"] = 1.0
            if self._program.gate == "stream":
                laser["emission_permit"] = 1.0
            return world.io.is_deployed
        self._set(facts.LASER_W, 0.0)
        laser["enable"] = laser["emission_permit"] = 0.0
        self._set(facts.POWDER_G_MIN, 0.0)
        dry = feeder.rate_at_nozzle_g_min <= DRY_G_MIN
        self._purged_s = self._purged_s + elapsed if dry else 0.0
        if self._purged_s < world.cell.limits.purge_s:
            return False
        world.io.values["head_deploy"] = 0.0
        if mode == facts.SAFE:
            feeder.values["carrier_gas_setpoint"] = feeder.values["shield_gas_setpoint"] = 0.0
        return bool(world.io.is_parked and not np.any(world.laser.is_emitting))
