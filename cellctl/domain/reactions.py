"""What the operator reads about each fault: one table from code to cause and remedy. What the cell does about it is in config.reactions."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Words:
    """cause, remedy : for the operator, one line each; {detail} and {remedy} are filled in"""

    cause: str
    remedy: str


REACTIONS: dict[str, Words] = {
    "estop": Words("The emergency stop chain is open", "release the E-stop, then reset and home"),
    "door": Words("The door is open", "close the door, reset, then resume or abort"),
    "chiller": Words("The chiller does not report ready", "look at the chiller's display; reset when it is ready"),
    "gas_pressure": Words("Gas pressure is low", "open or change the gas bottle, then reset"),
    "fume_extraction": Words("Fume extraction is off", "switch the extraction on, then reset"),
    "head_position": Words("The head left the position that the operation needs: {detail}", "look at the head's slide; reset, then abort"),
    "laser_fault": Words("The laser reports: {detail}", "remove the cause at the laser, then reset"),
    "laser_interlock": Words("The laser's interlock chain reports: {detail}", "close the chain, then reset"),
    "laser_silent": Words("The laser does not answer in time: {detail}", "look at its power, cable and network; reset when it answers"),
    "laser_lost": Words("The laser lost what it was told: {detail}", "look at its power and cable; reset, then resume or abort"),
    "laser_emitting": Words("The laser reports emission that was not permitted: {detail}", "press the E-stop and call service"),
    "dark_pass": Words(
        "The laser emits nothing though the program asks for it: {detail}", "look at gate wire, shutter and fibre; reset, then resume or abort"
    ),
    "feeder_fault": Words("The powder feeder reports: {detail}", "remove the cause at the feeder, then reset"),
    "feeder_silent": Words("The powder feeder does not answer in time: {detail}", "look at its power, cable and network; reset when it answers"),
    "feeder_lost": Words("The powder feeder lost what it was told: {detail}", "look at its power and cable; reset, then resume or abort"),
    "powder_flow": Words("Powder does not flow as set: {detail}", "look for a clog or an empty hopper, then reset"),
    "gas_flow": Words("Gas does not flow as set: {detail}", "look at the gas supply, then reset"),
    "io_silent": Words("The I/O coupler does not answer in time: {detail}", "look at its power, cable and network; reset when it answers"),
    "io_fault": Words("The I/O coupler is not to be trusted: {detail}", "look at the coupler and its outputs; reset, then resume or abort"),
    "power": Words(
        "The whole machine fell silent at once: {detail}",
        "look at its main switch and supply, then at its network; when all devices answer, reset and home; the job goes on from where metal ended",
    ),
    "io_lost": Words("The I/O coupler lost what it was told: {detail}", "look at its power and cable; reset, then resume or abort"),
    "cnc_lost": Words("The serial link to the CNC is lost: {detail}", "look at the cable; reset when it answers"),
    "cnc_silent": Words("The CNC does not answer: {detail}", "look at the CNC; reset when it answers"),
    "cnc_alarm": Words("The CNC is in alarm: {detail}", "{remedy}"),
    "cnc_reset": Words("The CNC restarted by itself", "look at its power supply; reset and home"),
    "line_rejected": Words("The CNC rejected a line: {detail}", "reset; post the program again for this machine"),
    "answer_overdue": Words("A line was never answered: {detail}", "look at the serial cable; reset"),
    "cnc_answers": Words("What the CNC says cannot be trusted: {detail}", "look at the serial cable and its shield; reset"),
    "step_failed": Words("{detail}", "{remedy}"),
    "tool": Words("The wrong tool is in the spindle: {detail}", "change the tool; reset, then start again"),
    "datum": Words("The work offset is not the program's: {detail}", "set the offset or post again; reset"),
    "store": Words("The journal cannot be written: {detail}", "make room on the disk or free the store, then reset"),
    "internal": Words("The cell process failed at its work: {detail}", "note what was done, reset, tell the maintainers"),
    "restarted": Words("The cell process ended while a job ran: {detail}", "look at the part; reset; the job has to be planned again"),
}

INTERLOCK_CAUSE: dict[str, str] = {
    "estop_ok": "estop",
    "door_closed": "door",
    "chiller_ok": "chiller",
    "gas_pressure_ok": "gas_pressure",
    "fume_extraction_ok": "fume_extraction",
}
"""Level of the I/O coupler -> cause in REACTIONS when it is not safe."""


def explain(code: str, detail: str = "", remedy: str = "") -> tuple[str, str]:
    """Cause and remedy of a fault in the operator's words. Raises KeyError for a code that is not in the table."""
    reaction = REACTIONS[code]
    fill = {"detail": detail or "no more is known", "remedy": remedy or "remove the cause, then reset"}
    return reaction.cause.format(**fill), reaction.remedy.format(**fill)
