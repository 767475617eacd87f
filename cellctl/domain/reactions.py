"""What the cell does about each fault: one table from cause to reaction, with the cause and remedy that the operator reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Motion = Literal["hold", "reset"]


@dataclass(frozen=True)
class Reaction:
    """Laser and permit are off in every one; what differs is told here.

    cause, remedy : for the operator, one line each; {detail} is filled in
    motion : "hold" (decelerate, the stream stays intact) or "reset" (decelerate, then drop what is buffered)
    ends_job : whether the job is over (interrupted); otherwise it is held and can be resumed after the reset
    powder_off : whether powder and gas are shut
    """

    cause: str
    remedy: str
    motion: Motion = "hold"
    ends_job: bool = False
    powder_off: bool = True


REACTIONS: dict[str, Reaction] = {
    "estop": Reaction(
        "The emergency stop chain is open", "release the E-stop, then reset and home", "reset", ends_job=True
    ),
    "door": Reaction("The door is open", "close the door, reset, then resume or abort"),
    "chiller": Reaction("The chiller does not report ready", "look at the chiller's display; reset when it is ready"),
    "gas_pressure": Reaction("Gas pressure is low", "open or change the gas bottle, then reset"),
    "fume_extraction": Reaction("Fume extraction is off", "switch the extraction on, then reset"),
    "head_position": Reaction(
        "The head left the position that the operation needs: {detail}",
        "look at the head's slide; reset, then abort",
        ends_job=True,
        motion="reset",
    ),
    "laser_fault": Reaction("The laser reports: {detail}", "remove the cause at the laser, then reset"),
    "laser_interlock": Reaction("The laser's interlock chain reports: {detail}", "close the chain, then reset"),
    "laser_silent": Reaction(
        "The laser does not answer: {detail}", "look at its power and cable; reset when it answers"
    ),
    "laser_emitting": Reaction(
        "The laser reports emission that was not permitted: {detail}",
        "press the E-stop and call service",
        "reset",
        ends_job=True,
    ),
    "feeder_fault": Reaction("The powder feeder reports: {detail}", "remove the cause at the feeder, then reset"),
    "feeder_silent": Reaction(
        "The powder feeder does not answer: {detail}", "look at its power and cable; reset when it answers"
    ),
    "powder_flow": Reaction("Powder does not flow as set: {detail}", "look for a clog or an empty hopper, then reset"),
    "gas_flow": Reaction("Gas does not flow as set: {detail}", "look at the gas supply, then reset"),
    "io_silent": Reaction(
        "The I/O coupler does not answer: {detail}", "look at its power and cable; reset when it answers"
    ),
    "cnc_lost": Reaction(
        "The serial link to the CNC is lost: {detail}",
        "look at the cable; reset when it answers",
        "reset",
        ends_job=True,
    ),
    "cnc_silent": Reaction(
        "The CNC does not answer: {detail}", "look at the CNC; reset when it answers", "reset", ends_job=True
    ),
    "cnc_alarm": Reaction("The CNC is in alarm: {detail}", "{remedy}", "reset", ends_job=True),
    "cnc_reset": Reaction(
        "The CNC restarted by itself", "look at its power supply; reset and home", "reset", ends_job=True
    ),
    "line_rejected": Reaction(
        "The CNC rejected a line: {detail}", "reset; post the program again for this machine", "reset", ends_job=True
    ),
    "answer_overdue": Reaction(
        "A line was never answered: {detail}", "look at the serial cable; reset", "reset", ends_job=True
    ),
    "cnc_answers": Reaction(
        "What the CNC says cannot be trusted: {detail}",
        "look at the serial cable and its shield; reset",
        "reset",
        ends_job=True,
    ),
    "step_failed": Reaction("{detail}", "{remedy}", ends_job=False),
    "tool": Reaction(
        "The wrong tool is in the spindle: {detail}", "change the tool; reset, then start again", "reset", ends_job=True
    ),
    "datum": Reaction(
        "The work offset is not the program's: {detail}", "set the offset or post again; reset", "reset", ends_job=True
    ),
    "store": Reaction("The journal cannot be written: {detail}", "make room on the disk or free the store, then reset"),
    "internal": Reaction(
        "The cell process failed at its work: {detail}",
        "note what was done, reset, tell the maintainers",
        "reset",
        ends_job=True,
    ),
    "restarted": Reaction(
        "The cell process ended while a job ran: {detail}", "look at the part; reset; the job has to be planned again"
    ),
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
