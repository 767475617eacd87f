"""What the firmware drives: motion, spindle, tool changer, coolant; carries out actions one after the other and knows how it is suspended."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum

import numpy as np

from config import Axis
from sim.cnc import codes
from sim.cnc.actions import RAPID, Action, Coolant, Dwell, Move, Output, Pause, Spindle, ToolChange
from sim.cnc.lookahead import Floats
from sim.cnc.motion import Motion

TOOL_CHANGE_S = 4.0
SPINDLE_RPM_PER_S = 9000.0
DOOR_RESTORE_S = 0.5
TIME_EPS_S = 1e-9
LIMIT_EPS = 1e-6  # mm or deg: rounding of posted numbers is not a violation


class Suspend(Enum):
    """Why motion brakes or stands although there is something to do."""

    NONE = 0
    HOLD = 1
    DOOR = 2
    RESTORE = 3
    JOG_CANCEL = 4
    STOP = 5
    SOFT_LIMIT = 6
    SPINDLE = 7


class Machine:
    """State of everything that moves. `say_alarm(n)` is called when an alarm is raised, `on_flush()` when planned motion was dropped."""

    def __init__(
        self,
        axes: Sequence[Axis],
        capacity: int,
        start: Sequence[float],
        say_alarm: Callable[[int], None],
        on_flush: Callable[[], None],
        junction_deviation_mm: float = 0.01,
    ) -> None:
        self.motion = Motion(axes, capacity, start, junction_deviation_mm)
        self.home_position = [axis.home for axis in axes]
        self._low = [axis.min - LIMIT_EPS for axis in axes]
        self._high = [axis.max + LIMIT_EPS for axis in axes]
        self._first_home = next((i for i, axis in enumerate(axes) if axis.letter == "Z"), None)
        self._say_alarm, self._on_flush = say_alarm, on_flush
        self._actions: deque[Action] = deque()
        self._timer_s = self._restore_s = 0.0
        self._timed: Action | None = None
        self._homing_stage = 0
        self.suspend = Suspend.NONE
        self.alarm = 0
        self.slip: Floats = np.zeros(len(axes))
        self.refused_target: tuple[float, ...] = ()  # of the move that a soft limit stopped, machine coordinates
        self.is_homed = True
        self.is_jogging = False
        self.tool = 0
        self.spindle_command_rpm = self.spindle_rpm = 0.0
        self.spindle_override = 1.0
        self.is_spindle_stopped = False
        self.flood = self.mist = False
        self.is_door_open = self.is_estop_pressed = False

    @property
    def joints(self) -> Floats:
        """(n,) where the axes really are; a reset in motion makes this differ from what the firmware counts."""
        return np.asarray(self.motion.position + self.slip)

    @property
    def is_homing(self) -> bool:
        """Whether `$H` runs."""
        return self._homing_stage > 0

    @property
    def is_changing_tool(self) -> bool:
        """Whether the changer is under way."""
        return isinstance(self._timed, ToolChange)

    @property
    def is_suspended(self) -> bool:
        """Whether lines have to wait: held, door, jog being cancelled and the like."""
        return self.suspend is not Suspend.NONE

    @property
    def is_braking(self) -> bool:
        """Whether it is suspended and still moves."""
        return self.is_suspended and self.motion.speed > 0.0

    @property
    def is_busy(self) -> bool:
        """Whether actions of the last line are still to be carried out."""
        return bool(self._actions) or self._timed is not None

    @property
    def timer_s(self) -> float:
        """Time that a dwell, a tool change or the spindle still takes, s; nothing moves and no line is taken so long."""
        return self._timer_s if self._timed is not None else 0.0

    def begin(self, actions: Sequence[Action]) -> None:
        """Take the actions of a line."""
        self._actions.extend(actions)

    def work(self) -> bool:
        """Carry out what needs no time and no room that is not there. True when the line is done."""
        while self._actions:
            action = self._actions[0]
            if isinstance(action, Move):
                if self.motion.is_full:
                    return False
                if self._is_beyond_travel(action.target):
                    self.refused_target = action.target
                    self._brake(Suspend.SOFT_LIMIT)
                    return False
                self.motion.append(action.target, action.kind, action.value, action.line)
            elif isinstance(action, Output):
                self.motion.output(action.port, action.on, action.synchronised)
            else:
                if self.motion.count or self._timed is not None:
                    return False
                self._start(action)
            self._actions.popleft()
            if self._timed is not None or self.is_suspended:
                return False
        return self._timed is None

    def _start(self, action: Action) -> None:
        """Begin an action that waits for an empty planner."""
        if isinstance(action, Dwell):
            self._timer_s, self._timed = action.seconds, action
        elif isinstance(action, Spindle):
            self.spindle_command_rpm = action.rpm * (action.direction or 1) if action.direction else 0.0
            if action.direction:
                change = abs(self.spindle_command_rpm * self.spindle_override - self.spindle_rpm)
                self._timer_s, self._timed = change / SPINDLE_RPM_PER_S, action
        elif isinstance(action, ToolChange):
            if action.tool != self.tool:
                self.spindle_command_rpm = 0.0
                self._timer_s, self._timed = TOOL_CHANGE_S, action
        elif isinstance(action, Coolant):
            self.flood, self.mist = action.flood, action.mist
        elif isinstance(action, Pause):
            self.suspend = Suspend.HOLD
        else:
            self.spindle_command_rpm, self.flood, self.mist = 0.0, False, False
        if self._timed is not None and self._timer_s <= TIME_EPS_S:
            self._finish()

    def _finish(self) -> None:
        if isinstance(self._timed, ToolChange):
            self.tool = self._timed.tool
        self._timed, self._timer_s = None, 0.0

    def is_reachable(self, target: Sequence[float]) -> bool:
        """Whether a target is inside the travel of every axis."""
        return all(low <= value <= high for low, value, high in zip(self._low, target, self._high, strict=True))

    def _is_beyond_travel(self, target: Sequence[float]) -> bool:
        return self.is_homed and not self.is_reachable(target)

    def advance(self, left: float, stop_count: int) -> float:
        """Let at most `left` seconds go by; returns the time used. `stop_count` as in lookahead.advance."""
        used = 0.0
        blocks, row = self.motion.count, self.motion.row
        if blocks and not self.alarm and (not self.is_suspended or self.motion.speed > 0.0):
            used = self.motion.advance(left, self.is_suspended, stop_count)
            if self.is_suspended and self.motion.speed == 0.0:
                self._stand()
            elif not self.motion.count:
                self._moves_done()
        if used <= 0.0 and self.motion.count == blocks:
            used = self._wait(left)
        self.motion.note_spindle(row, self.spindle_rpm)
        self._turn_spindle(used)
        return used

    def _wait(self, left: float) -> float:
        """Let time go by at standstill, at most until a timer is up."""
        used = left
        if self.suspend in (Suspend.RESTORE, Suspend.SPINDLE):
            used = min(left, self._restore_s)
            self._restore_s -= used
            if self._restore_s <= TIME_EPS_S:
                self.suspend = Suspend.NONE
        elif self._timed is not None and not self.is_suspended and not self.alarm:
            used = min(left, self._timer_s)
            self._timer_s -= used
            self.motion.wait(used, is_timed=True)
            if self._timer_s <= TIME_EPS_S:
                self._finish()
            return used
        self.motion.wait(used)
        return used

    def _turn_spindle(self, dt: float) -> None:
        runs = not self.is_spindle_stopped and self.suspend is not Suspend.DOOR
        goal = self.spindle_command_rpm * self.spindle_override if runs else 0.0
        step = SPINDLE_RPM_PER_S * dt
        self.spindle_rpm += max(-step, min(step, goal - self.spindle_rpm))

    def _moves_done(self) -> None:
        self.is_jogging = False
        if self._homing_stage == 1:
            self._homing_stage = 2
            self.motion.append(self.home_position, RAPID, 0.0, 0)
        if self._homing_stage == 2 and not self.motion.count:
            self._homing_stage, self.is_homed = 0, True

    def home(self) -> None:
        """Find the switches: Z first, then the rest. What was lost is found again."""
        self.motion.place(self.joints)
        self.slip[:] = 0.0
        self.alarm = 0
        self._homing_stage = 1
        if self._first_home is not None:
            goal = self.motion.position
            goal[self._first_home] = self.home_position[self._first_home]
            self.motion.append(goal.tolist(), RAPID, 0.0, 0)
        if not self.motion.count:
            self._moves_done()

    def hold(self) -> None:
        """`!`: brake along the path; a jog is cancelled instead. Harmless twice."""
        if self.suspend is Suspend.NONE and not self.alarm and not self.is_homing:
            self._brake(Suspend.JOG_CANCEL if self.is_jogging else Suspend.HOLD)

    def cancel_jog(self) -> None:
        """0x85."""
        if self.is_jogging and self.suspend is Suspend.NONE:
            self._brake(Suspend.JOG_CANCEL)

    def stop(self) -> None:
        """0x19: brake along the path and drop the rest; the position stays known."""
        if not self.alarm:
            self._brake(Suspend.STOP)

    def door(self, is_open: bool) -> None:
        """Level of the door input; opening brakes like a hold and stops the spindle."""
        self.is_door_open = is_open
        if is_open and self.is_homing:
            self.cut()
            self.raise_alarm(codes.ALARM_HOMING_DOOR)
            self._on_flush()
        elif is_open and not self.alarm and self.suspend in (Suspend.NONE, Suspend.HOLD, Suspend.RESTORE, Suspend.SPINDLE):
            self._brake(Suspend.DOOR)

    def safety_door(self) -> None:
        """0x84: as if the door had been opened and closed."""
        if not self.alarm:
            self._brake(Suspend.DOOR)

    def resume(self) -> None:
        """`~`: only from standstill, and with the door closed. A spindle that was stopped turns again before anything moves.

        Source: grbl 1.1, "Real-time commands": toggle spindle stop (0x9E), in HOLD alone; a cycle start restores the spindle, waits, then moves.
        """
        if self.is_braking:
            return
        if self.suspend is Suspend.DOOR and not self.is_door_open:
            self.suspend = Suspend.RESTORE if self.spindle_command_rpm else Suspend.NONE
            self._restore_s = self._run_up_s()
        elif self.suspend is Suspend.HOLD:
            is_restored = self.is_spindle_stopped and self.spindle_command_rpm != 0.0
            self.suspend = Suspend.SPINDLE if is_restored else Suspend.NONE
            self._restore_s = self._run_up_s()
            self.is_spindle_stopped = False

    def _run_up_s(self) -> float:
        """Time that the firmware is set to wait for a spindle that it restores: as long as this one takes from where it is."""
        change = abs(self.spindle_command_rpm * self.spindle_override - self.spindle_rpm)
        return max(DOOR_RESTORE_S, change / SPINDLE_RPM_PER_S)

    def _brake(self, why: Suspend) -> None:
        self.suspend = why
        if self.motion.speed == 0.0:
            self._stand()

    def _stand(self) -> None:
        """Standstill reached: drop what will not be resumed."""
        if self.suspend in (Suspend.JOG_CANCEL, Suspend.STOP, Suspend.SOFT_LIMIT):
            was = self.suspend
            self.motion.flush()
            self._drop()
            if was is Suspend.SOFT_LIMIT:
                self.raise_alarm(codes.ALARM_SOFT_LIMIT)
            self._on_flush()

    def _drop(self) -> None:
        self._actions.clear()
        self._timed, self._timer_s = None, 0.0
        self._homing_stage = 0
        self.suspend = Suspend.NONE
        self.is_jogging = False

    def cut(self) -> bool:
        """Everything stops at once, planned motion and actions are dropped. True if it moved: then steps are lost."""
        was_moving = self.motion.speed > 0.0
        was_homing = self.is_homing
        self.slip += self.motion.flush()
        self._drop()
        self.spindle_command_rpm, self.flood, self.mist = 0.0, False, False
        self.is_spindle_stopped = False
        self.spindle_override = 1.0
        self.motion.override(1.0, 1.0)
        if was_homing:
            self.is_homed = False
        return was_moving

    def raise_alarm(self, number: int) -> None:
        """Latch an alarm and say so."""
        self.alarm = number
        self._say_alarm(number)
