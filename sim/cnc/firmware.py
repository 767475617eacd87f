"""The firmware as a host sees it: bytes in, bytes out, and time going by."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from config import Cell
from sim.cnc import codes
from sim.cnc.answers import ALARM_SUBSTATE, Snapshot, StatusReport, build_of, default_settings
from sim.cnc.codes import GcodeError
from sim.cnc.interpreter import Interpreter
from sim.cnc.line import REAL_TIME, LineNoise, ReceiveRing, Transmitter
from sim.cnc.machine import TIME_EPS_S, Machine, Suspend
from sim.cnc.parser import strip_line, words_of
from sim.cnc.system import run_system_command

STATES = {
    Suspend.HOLD: "Hold", Suspend.SPINDLE: "Hold", Suspend.STOP: "Hold", Suspend.SOFT_LIMIT: "Hold", Suspend.JOG_CANCEL: "Jog",
    Suspend.DOOR: "Door", Suspend.RESTORE: "Door",
}  # fmt: skip
AUTO_REPORT_S = 0.2
FEED_STEPS = {0x91: 10, 0x92: -10, 0x93: 1, 0x94: -1}
SPINDLE_STEPS = {0x9A: 10, 0x9B: -10, 0x9C: 1, 0x9D: -1}
RAPID_PERCENT = {0x95: 100, 0x96: 50, 0x97: 25}
OVERRIDE_MIN, OVERRIDE_MAX = 10, 200
NUMBER_WORD = re.compile(r"N(\d+)")


class Firmware:
    """grblHAL, or grbl 1.1 when the cell says so. `receive` bytes from the host, `transmit` the answers, `step` time.

    `supply(free) -> bytes`, if set, is asked for more lines whenever the receive ring has none: a host without a wire.
    """

    def __init__(self, cell: Cell, tool: int | None = None) -> None:
        letters = "".join(cell.letters)
        rpm_max = max(each.max_rpm for each in cell.tools)
        simulation = cell.simulation
        self.build = build_of(
            cell.cnc.firmware, letters, len(cell.tools), simulation.rx_bytes, simulation.planner_blocks
        )
        self.settings = default_settings(self.build, cell.axes, rpm_max, cell.cnc)
        start = [axis.home for axis in cell.axes]
        work_offset = [cell.placement.work_offset.get(letter, 0.0) for letter in letters]
        self.interpreter = Interpreter(cell.axes, work_offset, start, rpm_max)
        self.interpreter.tools = frozenset(each.number for each in cell.tools)
        self.interpreter.arc_tolerance_mm = cell.cnc.arc_tolerance_mm
        self.machine = Machine(
            cell.axes, self.build.planner_blocks, start, self._say_alarm, self._flushed, cell.cnc.junction_deviation_mm
        )
        self.machine.tool = cell.tools[0].number if tool is None else tool
        self.interpreter.modal.tool_selected = self.machine.tool
        self.rx = ReceiveRing(self.build.rx_bytes)
        self.transmitter = Transmitter()
        self.noise = LineNoise()
        self.refusals: dict[int, int] = {}  # N-word -> error code of lines to refuse; 0 stands for the next line, whichever
        self.supply: Callable[[int], bytes] | None = None
        self.is_checking = False
        self.is_cut_off = False  # the wire carries nothing, either way
        self.is_deaf = False  # it carries nothing to the machine
        self.overrides = [100, 100, 100]
        self._report = StatusReport()
        self._line_is_open = False
        self._latched = 0
        self._auto_s = 0.0
        self._has_auto = False
        self._reset_is_due = False
        self._welcome()

    # -- host's side -----------------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Bytes from the host: real-time bytes act at once, wherever they stand, the others go into the ring."""
        if self.is_cut_off or self.is_deaf:
            return
        start = 0
        for match in REAL_TIME.finditer(data):
            self._store(data[start : match.start()])
            self._real_time(data[match.start()])
            start = match.end()
        self._store(data[start:] if start else data)

    def transmit(self) -> bytes:
        """Bytes to the host since the last call."""
        data = self.transmitter.take()
        return b"" if self.is_cut_off else data

    def _store(self, data: bytes) -> None:
        data = self.noise.pass_on(data)
        while data:
            cut = min(data.find(b"\n") + 1 or len(data), self.rx.free) or len(data)
            self.rx.put(data[:cut])
            data = data[cut:]
            self._work()

    # -- time ------------------------------------------------------------------------------------------------------

    def step(self, dt_s: float, wire_dt_s: float | None = None) -> None:
        """Let time go by; `machine.motion.pieces` then holds the motion. Auto-reports count the wire's time."""
        motion = self.machine.motion
        motion.begin()
        left = dt_s
        refill = motion.capacity // 2
        while left > TIME_EPS_S:
            self._work()
            stop_count = refill if motion.count > refill and self._has_lines else -1
            left -= self.machine.advance(left, stop_count)
        self._work()
        interval = self.settings.get(481, 0.0) / 1000.0 or (AUTO_REPORT_S if self._has_auto else 0.0)
        if interval:
            self._auto_s += dt_s if wire_dt_s is None else wire_dt_s
            if self._auto_s >= interval:
                self._auto_s = 0.0
                self.report()

    @property
    def _has_lines(self) -> bool:
        return self.supply is not None or self.rx.has_line or self._line_is_open

    @property
    def is_idle(self) -> bool:
        """Whether nothing moves, waits or is locked (a dwell is not seen here, as in the real firmware)."""
        return self.state[0] == "Idle"

    @property
    def state(self) -> tuple[str, int | None]:
        """Name and sub-state as in the status report."""
        machine = self.machine
        if machine.alarm:
            with_number = self.build.is_hal and int(self.settings[10]) & ALARM_SUBSTATE
            return "Alarm", machine.alarm if with_number else None
        if machine.is_homing:
            return "Home", None
        if machine.suspend is Suspend.DOOR:
            return "Door", 2 if machine.is_braking else int(machine.is_door_open)
        if machine.is_suspended:
            name = STATES[machine.suspend]
            return name, None if name == "Jog" else 3 if name == "Door" else int(machine.is_braking)
        if machine.is_jogging:
            return "Jog", None
        if self.is_checking:
            return "Check", None
        if machine.is_changing_tool:
            return "Tool", None
        return ("Run" if machine.motion.count else "Idle"), None

    def report(self, full: bool = False) -> None:
        """Send a status report."""
        machine = self.machine
        state, substate = self.state
        pins = ("D" if machine.is_door_open else "") + ("E" if machine.is_estop_pressed and self.build.is_hal else "")
        direction = "S" if machine.spindle_command_rpm > 0 else "C" if machine.spindle_command_rpm < 0 else ""
        accessories = direction + ("F" if machine.flood else "") + ("M" if machine.mist else "")
        now = Snapshot(
            state, substate, machine.motion.position.tolist(), self.interpreter.shift(), machine.motion.free, self.rx.free,
            machine.motion.line, machine.motion.feed_mm_min, abs(machine.spindle_rpm),
            (self.overrides[0], self.overrides[1], self.overrides[2]), pins, accessories, machine.tool,
        )  # fmt: skip
        self.transmitter.say(self._report.text(now, self.build, int(self.settings[10]), full))

    # -- lines -----------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        """Parse and plan as far as room, waiting actions and suspensions allow. No `ok` while held."""
        machine = self.machine
        while not machine.is_suspended and not machine.is_homing:
            if self._line_is_open or machine.is_busy:
                if not machine.work():
                    return
                if self._line_is_open:
                    self._line_is_open = False
                    self.transmitter.answer()
            line = self.rx.take_line(not self.build.is_hal)
            if line is None:
                if self.supply is None:
                    return
                data = self.supply(self.rx.free)
                if not data:
                    return
                self.rx.put(data)
            else:
                self._take(line)

    def _take(self, line: str) -> None:
        text = strip_line(line)
        if len(line if self.build.is_hal else text) > self.build.line_length_max:
            self._refuse(codes.LINE_OVERFLOW)
        elif not text or text == "%":
            self._latched = 0
            self.transmitter.answer()
        elif text[0] == "$":
            self._take_system(text)
        elif self._latched and self.build.is_hal:
            self.transmitter.answer(self._latched)
        elif self.machine.alarm or self.machine.is_jogging:
            self._refuse(codes.LOCKED)
        elif self.refusals and (code := self._refusal(text)):
            self._refuse(code)
        else:
            try:
                actions = self.interpreter.interpret(words_of(text))
            except GcodeError as error:
                self._refuse(error.code)
                return
            if not self.is_checking:
                self.machine.begin(actions)
            self._line_is_open = True

    def _take_system(self, text: str) -> None:
        code = run_system_command(self, text)
        if code:
            self._refuse(code)
            return
        self._latched = 0
        if not self._line_is_open:
            self.transmitter.answer()
        if self._reset_is_due:
            self._reset_is_due = False
            self.reset()

    def _refusal(self, text: str) -> int:
        """Error code of a line that is to be refused, 0 for the others; each is refused once."""
        word = NUMBER_WORD.match(text)
        return self.refusals.pop(0, 0) or self.refusals.pop(int(word[1]) if word else -1, 0)

    def _refuse(self, code: int) -> None:
        if self.build.is_hal:
            self._latched = code
        self.transmitter.answer(code)

    def await_homing(self) -> None:
        """Have the `ok` of `$H` wait until homing ends."""
        self._line_is_open = True
        self.interpreter.position = list(self.machine.home_position)

    def reset_after_answer(self) -> None:
        """Have the next answer followed by a reset."""
        self._reset_is_due = True

    # -- real-time bytes and signals -------------------------------------------------------------------------------

    def _real_time(self, byte: int) -> None:
        machine, is_hal = self.machine, self.build.is_hal
        if byte == 0x18:
            self.reset()
        elif byte == ord("?") or (is_hal and byte == 0x80):
            self.report()
        elif byte == ord("!") or (is_hal and byte == 0x82):
            machine.hold()
        elif byte == ord("~") or (is_hal and byte == 0x81):
            machine.resume()
            self._work()
        elif byte == 0x84:
            machine.safety_door()
        elif byte == 0x85:
            if is_hal:
                self.rx.clear()
            machine.cancel_jog()
        elif 0x90 <= byte <= 0x9E:
            self._override(byte)
        elif is_hal and byte == 0x19:
            self.rx.clear()
            machine.stop()
        elif is_hal and byte == 0x87:
            self.report(full=True)
        elif is_hal and byte == 0x8C:
            self._has_auto = not self._has_auto

    def _override(self, byte: int) -> None:
        feed, rapid, spindle = self.overrides
        if byte == 0x90:
            feed = 100
        elif byte == 0x99:
            spindle = 100
        elif byte == 0x9E and self.machine.suspend is Suspend.HOLD:
            self.machine.is_spindle_stopped = not self.machine.is_spindle_stopped
        feed += FEED_STEPS.get(byte, 0)
        spindle += SPINDLE_STEPS.get(byte, 0)
        rapid = RAPID_PERCENT.get(byte, rapid)
        self.overrides = [
            min(max(feed, OVERRIDE_MIN), OVERRIDE_MAX),
            rapid,
            min(max(spindle, OVERRIDE_MIN), OVERRIDE_MAX),
        ]
        self.machine.motion.override(self.overrides[0] / 100.0, rapid / 100.0)
        self.machine.spindle_override = self.overrides[2] / 100.0
        self._report.refresh()

    def reset(self) -> None:
        """0x18: buffers are lost without an answer, modal state goes to defaults; in motion the position becomes suspect."""
        was_moving = self.machine.cut()
        had_alarm = self.machine.alarm
        self.machine.alarm = 0
        self.rx.clear()
        self._start_again()
        if self.machine.is_estop_pressed and self.build.is_hal:
            self._welcome()
            self.machine.raise_alarm(codes.ALARM_ESTOP)
            return
        if was_moving:
            self.machine.raise_alarm(codes.ALARM_RESET_IN_MOTION)
        elif had_alarm and had_alarm not in codes.CRITICAL_ALARMS:
            self.machine.alarm = had_alarm
        elif had_alarm or not self.machine.is_homed:
            self.machine.alarm = codes.ALARM_HOMING_REQUIRED
        self._welcome()
        self.machine.door(self.machine.is_door_open)

    def stand_at(self, joints: Sequence[float], tool: int) -> None:
        """Stand at machine coordinates, in the order of the axes, with a tool in: where another program has left the machine."""
        self.machine.motion.place(joints)
        self.interpreter.reset(joints)
        self.machine.tool = tool
        self.interpreter.modal.tool_selected = tool

    def power_off(self) -> None:
        """Without power: drives and spindle stop, the line is silent, until `power_on`."""
        self.machine.cut()
        self.rx.clear()
        self._line_is_open = False
        self.is_cut_off = True

    def power_on(self) -> None:
        """Power is back, and nothing is remembered."""
        self.is_cut_off = False
        self.power_cycle()

    def power_cycle(self) -> None:
        """Power lost and back: everything is forgotten, the position counter too; homing is required."""
        machine = self.machine
        machine.cut()
        real = machine.joints
        machine.motion.place(machine.home_position)
        machine.slip = real - machine.motion.position
        machine.is_homed = False
        machine.alarm = codes.ALARM_ESTOP if machine.is_estop_pressed else codes.ALARM_HOMING_REQUIRED
        self.rx.clear()
        self.transmitter.take()
        self._start_again()
        self._welcome()

    def estop(self, is_pressed: bool) -> None:
        """Level of the E-stop input: drives and spindle lose power at once. grbl has that input on its reset pin."""
        machine = self.machine
        was_pressed, machine.is_estop_pressed = machine.is_estop_pressed, is_pressed
        if not is_pressed or was_pressed:
            return
        if not self.build.is_hal:
            self.reset()
            return
        machine.cut()
        self.rx.clear()
        self._line_is_open = False
        self.interpreter.position = machine.motion.position.tolist()
        machine.raise_alarm(codes.ALARM_ESTOP)

    def trip(self, alarm: int) -> None:
        """Raise an alarm from outside, as a limit switch or a drive does."""
        self.machine.cut()
        self.rx.clear()
        self._line_is_open = False
        self.interpreter.position = self.machine.motion.position.tolist()
        self.machine.raise_alarm(alarm)

    def _start_again(self) -> None:
        self._line_is_open, self._latched, self.is_checking = False, 0, False
        self._has_auto = False
        self.overrides = [100, 100, 100]
        self.interpreter.reset(self.machine.motion.position.tolist())
        self._report.refresh()

    def _welcome(self) -> None:
        self.transmitter.say("")
        self.transmitter.say(self.build.welcome)
        if self.machine.alarm:
            self.transmitter.say("[MSG:'$H'|'$X' to unlock]")

    def _say_alarm(self, number: int) -> None:
        self.transmitter.say(f"ALARM:{number}")
        if number in codes.CRITICAL_ALARMS:
            self.transmitter.say("[MSG:Reset to continue]")

    def _flushed(self) -> None:
        """Planned motion was dropped: the parser stands where the axes stand; lines in flight get no answer after a soft limit."""
        self.interpreter.position = self.machine.motion.position.tolist()
        self._line_is_open = False
        if self.machine.alarm:
            self.rx.clear()
