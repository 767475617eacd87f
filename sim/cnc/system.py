"""The `$` commands: settings, build, offsets, homing, unlock, jog, check; each answers with an error number, 0 for ok."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING

from sim.cnc import codes
from sim.cnc.actions import Action
from sim.cnc.answers import offset_report
from sim.cnc.codes import GcodeError
from sim.cnc.parser import words_of

if TYPE_CHECKING:
    from sim.cnc.firmware import Firmware

JOG_CODES = frozenset({20.0, 21.0, 53.0, 90.0, 91.0})


def run_system_command(firmware: Firmware, text: str) -> int:
    """Carry out a stripped line that begins with `$`. Returns the error number, 0 for ok."""
    if text.startswith("$J="):
        return jog(firmware, text[3:])
    if text == "$G":
        firmware.transmitter.say(firmware.interpreter.modal.words(firmware.machine.tool))
        return 0
    if not firmware.is_idle and not firmware.machine.alarm and not (text == "$C" and firmware.is_checking):
        return codes.NOT_IDLE
    command = COMMANDS.get(text)
    if command is not None:
        return command(firmware)
    name, sign, value = text[1:].partition("=")
    if sign and name.isdigit():
        return store_setting(firmware, int(name), value)
    return codes.INVALID_STATEMENT


def jog(firmware: Firmware, text: str) -> int:
    """`$J=`: one relative or absolute move with its own F; modal state stays as it is."""
    if firmware.machine.alarm:
        return codes.LOCKED
    if not (firmware.is_idle or firmware.machine.is_jogging):
        return codes.NOT_IDLE
    interpreter = firmware.interpreter
    saved, position = interpreter.modal, list(interpreter.position)
    modal = copy(saved)
    modal.motion, modal.feed_mode, modal.feed_mm_min = 10, 940, 0.0
    interpreter.modal = modal
    try:
        words = words_of(text)
        letters = {letter for letter, _ in words}
        if any(letter == "G" and value not in JOG_CODES for letter, value in words) or letters & set("MSTPL"):
            return codes.INVALID_JOG
        if not letters & set(interpreter.index):
            return codes.NO_AXIS_WORDS
        actions = interpreter.interpret(words)
        if not firmware.machine.is_reachable(interpreter.position) and firmware.machine.is_homed:
            interpreter.position = position
            return codes.TRAVEL_EXCEEDED
    except GcodeError as error:
        interpreter.position = position
        return error.code
    finally:
        interpreter.modal = saved
    start_jog(firmware, actions)
    return 0


def start_jog(firmware: Firmware, actions: list[Action]) -> None:
    """Hand the moves of a jog to the machine."""
    firmware.machine.begin(actions)
    firmware.machine.work()
    firmware.machine.is_jogging = firmware.machine.motion.count > 0


def show_settings(firmware: Firmware) -> int:
    """`$$`."""
    for number, value in firmware.settings.items():
        firmware.transmitter.say(f"${number}={value:.3f}" if number >= 100 and number < 400 else f"${number}={value:g}")
    return 0


def show_offsets(firmware: Firmware) -> int:
    """`$#`."""
    for line in offset_report(firmware.interpreter.offsets, firmware.interpreter.modal.length_offset_mm):
        firmware.transmitter.say(line)
    return 0


def show_build(firmware: Firmware, extended: bool = False) -> int:
    """`$I`, `$I+`."""
    for line in firmware.build.information(extended):
        firmware.transmitter.say(line)
    return 0


def show_help(firmware: Firmware) -> int:
    """`$`."""
    firmware.transmitter.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]")
    return 0


def home(firmware: Firmware) -> int:
    """`$H`: answers when homing ends."""
    refusal = refusal_of_motion(firmware)
    if refusal:
        return refusal
    firmware.machine.home()
    firmware.await_homing()
    return 0


def unlock(firmware: Firmware) -> int:
    """`$X`."""
    refusal = refusal_of_motion(firmware)
    if refusal:
        return refusal
    if firmware.machine.alarm:
        firmware.machine.alarm = 0
        firmware.transmitter.say("[MSG:Caution: Unlocked]")
    return 0


def refusal_of_motion(firmware: Firmware) -> int:
    """Why neither homing nor unlocking is possible; 0 if they are."""
    machine = firmware.machine
    if machine.is_estop_pressed and firmware.build.is_hal:
        return codes.ESTOP_ACTIVE
    if machine.alarm in codes.CRITICAL_ALARMS:
        return codes.CRITICAL_ALARM if firmware.build.is_hal else codes.LOCKED
    return codes.DOOR_AJAR if machine.is_door_open else 0


def toggle_check(firmware: Firmware) -> int:
    """`$C`: lines are checked only; leaving it resets, as grbl does."""
    if firmware.is_checking:
        firmware.transmitter.say("[MSG:Disabled]")
        firmware.is_checking = False
        firmware.reset_after_answer()
        return 0
    if firmware.machine.alarm:
        return codes.NOT_IDLE
    firmware.transmitter.say("[MSG:Enabled]")
    firmware.is_checking = True
    return 0


def store_setting(firmware: Firmware, number: int, value: str) -> int:
    """`$n=value`."""
    if number not in firmware.settings:
        return codes.INVALID_STATEMENT
    try:
        firmware.settings[number] = float(value)
    except ValueError:
        return codes.BAD_NUMBER
    return 0


COMMANDS: dict[str, Callable[[Firmware], int]] = {
    "$": show_help,
    "$$": show_settings,
    "$#": show_offsets,
    "$I": show_build,
    "$I+": lambda firmware: show_build(firmware, extended=True),
    "$H": home,
    "$X": unlock,
    "$C": toggle_check,
}
