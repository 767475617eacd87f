"""Alarm and error numbers of grbl 1.1 and grblHAL as data: cause and remedy in the operator's words.

Numbers: grbl 1.1 documentation (error and alarm code tables) and grblHAL core (status and alarm code enumerations).
"""

from __future__ import annotations

REHOME = "reset, then home the machine before going on: its position cannot be trusted"
CHECK_PROGRAM = "abort the job; the program does not fit this controller, post it again for this cell"
CHECK_SETTINGS = "correct the controller's settings ($$)"

# number -> (cause, remedy)
ALARMS: dict[int, tuple[str, str]] = {
    1: ("a limit switch was hit and the machine stopped at once", REHOME),
    2: ("a move would leave the travel of the machine (soft limit)", "reset and unlock; check work offset and placement of the part"),
    3: ("the controller was reset while the machine moved", REHOME),
    4: ("the probe was not in its expected state before probing", "check the probe, reset"),
    5: ("the probe did not touch the workpiece within its travel", "check probe and workpiece, reset"),
    6: ("homing was interrupted by a reset", REHOME),
    7: ("the door was opened while homing", "close the door, reset, home again"),
    8: ("a limit switch did not release after homing", "check switch and pull-off distance, reset, home again"),
    9: ("no limit switch was found while homing", "check switches and travel, reset, home again"),
    10: ("emergency stop", "release the E-stop, reset, home the machine"),
    11: ("the machine has not been homed", "home the machine"),
    12: ("a limit switch is engaged", "move the axis off its switch, reset"),
    13: ("probe protection was triggered", "clear the probe, reset"),
    14: ("the spindle did not reach its speed in time", "check the spindle drive, reset"),
    15: ("no second limit switch was found on an axis with two motors", "check switches, reset, home again"),
    16: ("the controller's power-on self-test failed", "switch the controller off and on; call service if it stays"),
    17: ("a motor driver reports a fault", "check the motor drivers, reset, home the machine"),
    18: ("homing is configured wrongly", CHECK_SETTINGS),
}

ERRORS: dict[int, tuple[str, str]] = {
    1: ("a word does not begin with a letter", CHECK_PROGRAM),
    2: ("a number is missing or malformed", CHECK_PROGRAM),
    3: ("unknown $ command", "send a command that this controller knows"),
    4: ("a value is negative that has to be positive", CHECK_PROGRAM),
    5: ("homing is not enabled in the controller's settings", CHECK_SETTINGS),
    6: ("step pulse too short", CHECK_SETTINGS),
    7: ("the controller could not read its settings", "check the settings ($$), they may be back at their defaults"),
    8: ("a $ command needs the machine to stand idle", "wait until the job has ended"),
    9: ("G-code is locked while in alarm or jog", "reset, home or unlock first"),
    10: ("soft limits need homing", CHECK_SETTINGS),
    11: ("the line is too long for the controller", CHECK_PROGRAM),
    12: ("step rate too high", CHECK_SETTINGS),
    13: ("the safety door is open", "close the door and resume"),
    14: ("start-up line too long", CHECK_SETTINGS),
    15: ("the jog would leave the travel", "jog less far"),
    16: ("malformed jog command", "jog with axis, distance and feed"),
    17: ("laser mode needs a PWM output", CHECK_SETTINGS),
    18: ("the controller is being reset", "wait for its banner"),
    19: ("a value has to be positive", CHECK_PROGRAM),
    20: ("the controller does not know a command of this line", CHECK_PROGRAM),
    21: ("two commands of one modal group in one line", CHECK_PROGRAM),
    22: ("no feed rate (with G93 every move needs its own F)", CHECK_PROGRAM),
    23: ("a command needs a whole number", CHECK_PROGRAM),
    24: ("two commands of this line want the axis words", CHECK_PROGRAM),
    25: ("a word stands twice in the line", CHECK_PROGRAM),
    26: ("axis words are missing", CHECK_PROGRAM),
    27: ("the line number is out of range", CHECK_PROGRAM),
    28: ("a command lacks a value word", CHECK_PROGRAM),
    29: ("work coordinate system not supported", CHECK_PROGRAM),
    30: ("G53 needs G0 or G1", CHECK_PROGRAM),
    31: ("axis words without a command that uses them", CHECK_PROGRAM),
    32: ("an arc without axis words in its plane", CHECK_PROGRAM),
    33: ("the target of the move is invalid", CHECK_PROGRAM),
    34: ("the radius of an arc is invalid", CHECK_PROGRAM),
    35: ("an arc without centre offsets in its plane", CHECK_PROGRAM),
    36: ("unused words in the line", CHECK_PROGRAM),
    37: ("tool length offset on an axis that has none", CHECK_PROGRAM),
    38: ("the tool number is too high or no tool is selected", "check the tool table of cell and controller"),
    39: ("a value is out of range", CHECK_PROGRAM),
    40: ("a tool change is pending", "finish the tool change"),
    41: ("the spindle does not run", "check the spindle"),
    42: ("wrong plane for threading", CHECK_PROGRAM),
    43: ("feed rate too high", CHECK_PROGRAM),
    44: ("spindle speed out of range", CHECK_PROGRAM),
    45: ("a limit switch is engaged; only homing is allowed", "home the machine"),
    46: ("the machine has not been homed", "home the machine"),
    47: ("the controller does not know which tool is mounted", "set the tool number at the controller (M61)"),
    48: ("two value words contradict each other", CHECK_PROGRAM),
    49: ("power-on self-test failed", "switch the controller off and on; call service if it stays"),
    50: ("emergency stop is active", "release the E-stop, reset, home the machine"),
    51: ("a motor driver reports a fault", "check the motor drivers, reset, home the machine"),
    52: ("setting out of range", CHECK_SETTINGS),
    53: ("setting not available on this controller", CHECK_SETTINGS),
    54: ("retract position below drilling depth", CHECK_PROGRAM),
    55: ("two axes with two motors each homed at once", CHECK_SETTINGS),
    56: ("the coordinate system is locked", CHECK_SETTINGS),
    57: ("unexpected file mark", CHECK_PROGRAM),
    58: ("the controller has no such port (check the laser gate output)", "correct laser_gate_output in the cell file or the wiring"),
    60: ("the controller's card cannot be mounted", "check the card"),
    61: ("a file on the controller cannot be read", "check the card"),
    62: ("a folder on the controller cannot be opened", "check the card"),
    63: ("no such folder on the controller", "check the card"),
    64: ("no card is mounted", "check the card"),
    65: ("no file system is mounted", "check the card"),
    66: ("the file system is read-only", "check the card"),
    70: ("the controller's Bluetooth failed to start", "check the controller"),
    71: ("unknown operation in an expression", CHECK_PROGRAM),
    72: ("division by zero in an expression", CHECK_PROGRAM),
    73: ("an argument in an expression is too large or too small", CHECK_PROGRAM),
    74: ("an argument in an expression is invalid", CHECK_PROGRAM),
    75: ("malformed expression", CHECK_PROGRAM),
    76: ("the result of an expression is no number", CHECK_PROGRAM),
    77: ("the controller asks for a password", "sign in at the controller"),
    78: ("the controller denies access", "sign in at the controller"),
    79: ("locked until a critical event has been cleared", "clear the cause (E-stop, limit), then reset"),
    80: ("flow control outside a macro", CHECK_PROGRAM),
    81: ("unknown flow statement", CHECK_PROGRAM),
    82: ("flow statements nested too deep", CHECK_PROGRAM),
    83: ("the controller has no memory left for flow statements", CHECK_PROGRAM),
    84: ("a file on the controller cannot be opened", "check the card"),
    253: ("a macro on the controller raised an error", "check the macro"),
}


def explain_alarm(code: int) -> tuple[str, str]:
    """Cause and remedy of ALARM:`code`."""
    return ALARMS.get(code, (f"alarm {code}, which these drivers do not know", "see the controller's manual, then reset and home"))


def explain_error(code: int) -> tuple[str, str]:
    """Cause and remedy of error:`code`."""
    return ERRORS.get(code, (f"error {code}, which these drivers do not know", "see the controller's manual; abort the job"))
