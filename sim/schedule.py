"""The controller as it should be: feeds lines as the receive buffer takes them and carries out the schedule without delay."""

from __future__ import annotations

import numpy as np

from sim import job as facts
from sim.job import Job
from sim.world import World

NEAR_LINES = 2  # set-points of lines this close to the executing one: time goes in fine steps
POWDER_TOLERANCE = 0.05  # relative; flow is steady within
DRY_G_MIN = 0.05
MACHINE_WAIT_S = 60.0  # a barrier that takes longer will never be passed


class IdealController:
    """Streams a Program into a World's firmware in memory.

    `supply` is the firmware's source of lines; `hear` takes its answers; `step` carries out what is due and returns a problem or "".
    """

    def __init__(self, program: Job, world: World) -> None:
        self._program, self._world = program, world
        schedule = program.schedule
        is_barrier = schedule["barrier"] == 1
        self._barriers: dict[int, list[tuple[int, float]]] = {}
        for row in schedule[is_barrier]:
            self._barriers.setdefault(int(row["n"]), []).append((int(row["channel"]), float(row["value"])))
        self._events = schedule[~is_barrier]
        self._next_event = 0
        self._sent = 0
        self.acknowledged = 0
        self._pending: list[tuple[int, float]] | None = None
        self._waited_s = 0.0
        self._last_time_s = 0.0
        self._purged_s = 0.0
        self.powder_setpoint = 0.0

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
    def changes_near(self) -> bool:
        """Whether a set-point is due within the next lines."""
        if self._next_event >= len(self._events):
            return False
        return int(self._events[self._next_event]["n"]) <= self.executing + NEAR_LINES

    def supply(self, free: int) -> bytes:
        """The next line if it fits and no barrier holds it back."""
        if self._sent >= len(self._program.lines) or self.next_line in self._barriers:
            return b""
        line = self._program.lines[self._sent].encode("ascii") + b"\n"
        if len(line) > free:
            return b""
        self._sent += 1
        return line

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
        return f"channel {channel} never reached {value:g}" if self._waited_s > MACHINE_WAIT_S else ""

    def _is_drained(self) -> bool:
        machine = self._world.cnc.machine
        return self.acknowledged == self._sent and machine.motion.count == 0 and not machine.is_busy

    def _apply_events(self) -> None:
        current = self.executing if self._world.cnc.machine.motion.count else self.acknowledged
        while self._next_event < len(self._events) and int(self._events[self._next_event]["n"]) <= current:
            row = self._events[self._next_event]
            self._set(int(row["channel"]), float(row["value"]))
            self._next_event += 1

    def _set(self, channel: int, value: float) -> None:
        laser, feeder = self._world.laser.values, self._world.feeder.values
        if channel == facts.LASER_W:
            laser["power_setpoint"] = value
        elif channel == facts.EMISSION:
            laser["emission_permit"] = value
        elif channel == facts.POWDER_G_MIN:
            self.powder_setpoint = value
            feeder["rate_setpoint"] = value
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
        laser["enable"] = laser["emission_permit"] = laser["power_setpoint"] = 0.0
        self._set(facts.POWDER_G_MIN, 0.0)
        dry = feeder.rate_at_nozzle_g_min <= DRY_G_MIN
        self._purged_s = self._purged_s + elapsed if dry else 0.0
        if self._purged_s < world.cell.limits.purge_s:
            return False
        world.io.values["head_deploy"] = 0.0
        if mode == facts.SAFE:
            feeder.values["carrier_gas_setpoint"] = feeder.values["shield_gas_setpoint"] = 0.0
        return bool(world.io.is_parked and not np.any(world.laser.is_emitting))
