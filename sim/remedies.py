"""What would help against each kind of finding, and what the firmware's refusals mean: one sentence each."""

from __future__ import annotations

from sim.cnc import codes

HELP = {
    "collision": "Tilt the tool the other way, shorten the overhang of the holder, raise the link, or place the part elsewhere on the table.",
    "gouge": "Check the tool's measured length and diameter and the work offset; if they are right, re-plan with a smaller cutter or a flatter tilt.",
    "travel": "Move the workpiece on the table or turn it about the table's axis, so that the named axis stays inside its travel.",
    "speed": "Lower the feed of this pass, or tilt more evenly, so that the named axis keeps to its limit and the bead to its speed.",
    "acceleration": "Round the corner of the pass, lower the feed there, or let the laser's power follow the speed.",
    "rapid in metal": "Raise the link above the metal, or make it a feed move.",
    "spindle off": "Start the spindle (M3 S...) before this line, or remove the metal in the way.",
    "stray light": "Close the gate (M63) at the end of the pass, or check the laser's ramp time in the cell's facts.",
    "standstill": "Close the gate before the tip stops, or join the moves so that the machine does not stop between them.",
    "head parked": "Enter the deposit mode (MODE 1 as a barrier) before the laser is opened.",
    "starved": "Start the powder earlier or wait for a steady flow; check hopper, carrier gas and the hose's transport time.",
    "waste": "Stop the powder where the laser stays dark, or open the laser's gate for this pass.",
    "line length": "Write fewer digits or no comments in this line, or post for a firmware that takes longer ones.",
    "firmware": "Correct the line, or post with the dialect of this firmware.",
    "process": "Check that the device can reach the set-point, and that gas, powder and interlocks are ready.",
    "schedule": "Post the Program again: its process schedule does not fit this cell.",
    "work offset": "Set G54 in the controller to what the Program was posted for, or post again for the measured placement.",
    "no stock": "Give the mesh of the stock that lies on the plate.",
    "no emission": "Check the gate's output number (M62 P) and the emission entries of the schedule.",
    "clearance": "Raise the links or tilt less where bodies come so close, or measure the bodies again and state them tighter.",
    "unchecked": "State the bodies of the machine (table, trunnion, head, clamps) in the cell's facts.",
}

REFUSALS = {
    codes.EXPECTED_LETTER: ("a letter is missing before a number", "Write each word as a letter and a number."),
    codes.BAD_NUMBER: ("a number cannot be read", "Write numbers as digits with at most one point."),
    codes.NEGATIVE_VALUE: ("a negative value where none is allowed", "N, F, S, T and P must not be negative."),
    codes.LINE_OVERFLOW: ("the line is longer than the receive buffer takes", "Shorten the line."),
    codes.TRAVEL_EXCEEDED: ("the jog leaves the travel", "Keep the target inside the travel."),
    codes.UNSUPPORTED: ("a word or value that this firmware does not know", "Post with the dialect of this firmware."),
    codes.MODAL_GROUP_VIOLATION: ("two words of one modal group", "Leave one of them, or write two lines."),
    codes.UNDEFINED_FEED: ("a feed move without feed", "Write F; in G93 on every line."),
    codes.NOT_INTEGER: ("a value that must be a whole number is none", "Write a whole number."),
    codes.AXIS_WORD_CONFLICT: ("two commands in one line want the axis words", "Write two lines."),
    codes.WORD_REPEATED: ("a word stands twice", "Leave one of the two."),
    codes.NO_AXIS_WORDS: ("the command needs axis words", "Name an axis."),
    codes.INVALID_LINE_NUMBER: ("the N-word is too large", "Number the lines below 10,000,000."),
    codes.VALUE_WORD_MISSING: ("a value word is missing", "Write the P or L that the command needs."),
    codes.UNSUPPORTED_COORDINATE_SYSTEM: ("no such work offset", "Use G54 to G59."),
    codes.G53_NEEDS_G0_OR_G1: ("G53 without G0 or G1", "Use G53 with straight moves only."),
    codes.UNUSED_AXIS_WORDS: ("axis words that no command uses", "Write G0 or G1 before them."),
    codes.NO_AXIS_WORDS_IN_PLANE: ("an arc without an end in its plane", "Name an axis of the plane."),
    codes.INVALID_TARGET: ("a target that cannot be reached so", "Check the arc's end and centre."),
    codes.ARC_RADIUS: ("the arc's radius does not reach its end", "Check the radius."),
    codes.NO_OFFSETS_IN_PLANE: ("an arc without centre", "Write the offsets of the plane, or R."),
    codes.UNUSED_WORDS: ("words that no command uses", "Take them out."),
    codes.TOOL_OFFSET_AXIS: ("G43.1 with another axis than Z", "Offset Z only."),
    codes.TOOL_NUMBER: ("no such tool in the changer", "Use a tool of the cell's facts."),
    codes.P_VALUE: ("a P value out of range", "Use an output that exists."),
    codes.LOCKED: ("the firmware is locked by an alarm", "Clear the alarm's cause first."),
}
ALARMS = {
    codes.ALARM_HARD_LIMIT: ("a limit switch was hit", "Keep the move inside the travel."),
    codes.ALARM_SOFT_LIMIT: ("a target beyond the travel", HELP["travel"]),
    codes.ALARM_ESTOP: ("the E-stop is pressed", "Release it and reset."),
    codes.ALARM_HOMING_REQUIRED: ("the machine is not homed", "Home it first."),
}


def explain(word: str, number: int) -> tuple[str, str]:
    """Meaning and remedy of an answer `error:number` or `ALARM:number`."""
    known = REFUSALS if word == "error" else ALARMS
    return known.get(number, ("the firmware's manual has its meaning", HELP["firmware"]))
