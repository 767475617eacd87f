"""The control's `$` settings against the cell file: what differs, and what to do about it. Pure.

Numbers: grbl 1.1 documentation, "Configuring Grbl"; grblHAL keeps them and has $10 bits of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from cellctl.doctor.report import Report, Verdict
from config.cell import Axis, Cell

SECTION = "Settings of the CNC"
STEPS, RATE, ACCELERATION, TRAVEL = 100, 110, 120, 130  # $ number of the first axis
RELATIVE = 1e-3  # settings are printed with three decimals
TRAVEL_TOLERANCE = 0.5  # mm or deg: pull-off distances that makers take off or not
# $10: bits of a status report that the drivers read, per firmware
REPORT_BITS = {
    "grblhal": {0: "machine position", 1: "buffer state", 2: "line numbers", 3: "feed and speed", 4: "pins", 5: "work offset", 6: "overrides"},
    "grbl": {0: "machine position", 1: "buffer state"},
}
# number -> (name, wanted, verdict if it is another, what then)
FIXED: dict[int, tuple[str, float, Verdict, str]] = {
    13: ("reports in inches", 0.0, "FAULT", "set $13=0: positions are read as mm"),
    20: ("soft limits", 1.0, "FAULT", "set $20=1: without soft limits a wrong program drives into the end stops"),
    21: ("hard limits", 1.0, "warning", "set $21=1 if limit switches are fitted"),
    22: ("homing", 1.0, "FAULT", "set $22=1: without homing the travel limits stand nowhere"),
    32: ("laser mode", 0.0, "FAULT", "set $32=0: in laser mode the spindle does not run up, and S-words become laser power"),
}


def compare_settings(told: Mapping[str, str], cell: Cell, report: Report) -> None:
    """Every setting that the cell file, or the way the cell works, has a word about.  told : number -> value, as `$$` tells"""
    _compare_mask(told, cell, report)
    for number, (name, wanted, verdict, remedy) in FIXED.items():
        value = number_of(told, number)
        if value is None:
            report.skip(SECTION, f"${number} {name}", "the control does not tell it")
            continue
        is_good = int(value) & 1 == 1 if number in (20, 21, 22) and wanted else value == wanted  # grblHAL keeps more bits beside
        report.add(SECTION, f"${number} {name}", "ok" if is_good else verdict, f"{value:g}", f"{wanted:g}", "" if is_good else remedy)
    _compare_cornering(told, cell, report)
    _compare_spindle(told, cell, report)
    for k, axis in enumerate(cell.axes):
        _compare_axis(told, k, axis, report)


def number_of(told: Mapping[str, str], number: int) -> float | None:
    """A setting's value; None if it is not told or is no number."""
    try:
        return float(told[str(number)])
    except (KeyError, ValueError):
        return None


def _compare_mask(told: Mapping[str, str], cell: Cell, report: Report) -> None:
    mask, bits = number_of(told, 10), REPORT_BITS[cell.cnc.firmware]
    if mask is None:
        report.skip(SECTION, "$10 status report", "the control does not tell it")
        return
    missing = [name for bit, name in bits.items() if not int(mask) >> bit & 1]
    wanted = int(mask) | sum(1 << bit for bit in bits)
    report.judge(
        SECTION, "$10 status report", not missing, f"{mask:g}" + (f": without {', '.join(missing)}" if missing else ""),
        "with " + ", ".join(bits.values()), f"set $10={wanted}",
    )  # fmt: skip


def _compare_cornering(told: Mapping[str, str], cell: Cell, report: Report) -> None:
    for number, name, said, key in (
        (11, "junction deviation", cell.cnc.junction_deviation_mm, "cnc.junction_deviation_mm"),
        (12, "arc tolerance", cell.cnc.arc_tolerance_mm, "cnc.arc_tolerance_mm"),
    ):
        value = number_of(told, number)
        if value is None:
            report.skip(SECTION, f"${number} {name}", "the control does not tell it")
            continue
        is_good = value <= said * (1.0 + RELATIVE)
        remedy = f"set ${number}={said:g}, or {key} = {value:g} in the cell file and prove the programs anew"
        report.judge(SECTION, f"${number} {name}", is_good, f"{value:g} mm", f"at most {said:g} mm", remedy)


def _compare_spindle(told: Mapping[str, str], cell: Cell, report: Report) -> None:
    value = number_of(told, 30)
    fastest = max((tool.max_rpm for tool in cell.tools if tool.kind != "deposition"), default=0.0)
    if value is None or not fastest:
        return
    is_good = value >= fastest * (1.0 - RELATIVE)
    remedy = "" if is_good else f"programs may ask for more than the control gives: set $30 to the spindle's greatest speed, or max_rpm = {value:g}"
    report.add(SECTION, "$30 spindle speed", "ok" if is_good else "warning", f"{value:g} rpm", f"at least {fastest:g} rpm (max_rpm)", remedy)


def _compare_axis(told: Mapping[str, str], k: int, axis: Axis, report: Report) -> None:
    unit = "mm" if axis.kind == "linear" else "deg"
    steps = number_of(told, STEPS + k)
    what = f"${STEPS + k} steps of {axis.letter}"
    if steps is None or not steps or not math.isfinite(steps):
        report.add(SECTION, what, "FAULT", told.get(str(STEPS + k), "not told"), "not 0", "set it from screw pitch, gear and microsteps")
    else:
        report.add(SECTION, what, "told", f"{steps:g} /{unit}", "", "no fact of the cell file: measure a jog with a dial gauge")
    rate, velocity = number_of(told, RATE + k), 60.0 * axis.max_velocity
    _least(report, f"${RATE + k} greatest rate of {axis.letter}", rate, velocity, f"{unit}/min", f"max_velocity = {(rate or 0.0) / 60.0:g}")
    acceleration = number_of(told, ACCELERATION + k)
    _least(
        report, f"${ACCELERATION + k} acceleration of {axis.letter}", acceleration, axis.max_acceleration, f"{unit}/s2",
        f"max_acceleration = {acceleration or 0.0:g}",
    )  # fmt: skip
    _travel(report, f"${TRAVEL + k} travel of {axis.letter}", number_of(told, TRAVEL + k), axis, unit)


def _least(report: Report, what: str, value: float | None, said: float, unit: str, file_text: str) -> None:
    """The control has to be able to do what plans count on; a control that can do more is worth a look."""
    number = what.split(" ")[0]
    if value is None:
        report.skip(SECTION, what, "the control does not tell it")
    elif value < said * (1.0 - RELATIVE):
        remedy = f"the control is slower than plans and proofs count on: {file_text} in the cell file, or set {number}={said:g} if the drive can"
        report.add(SECTION, what, "FAULT", f"{value:g} {unit}", f"{said:g} {unit}", remedy)
    elif value > said * (1.0 + RELATIVE):
        remedy = f"the control allows more than the cell file says: set {number}={said:g}, or {file_text} in the cell file"
        report.add(SECTION, what, "warning", f"{value:g} {unit}", f"{said:g} {unit}", remedy)
    else:
        report.add(SECTION, what, "ok", f"{value:g} {unit}", f"{said:g} {unit}")


def _travel(report: Report, what: str, value: float | None, axis: Axis, unit: str) -> None:
    said, number = axis.max - axis.min, what.split(" ")[0]
    if value is None:
        report.skip(SECTION, what, "the control does not tell it")
        return
    if value == 0.0 and axis.kind == "rotary":
        remedy = f"the control has no limit here; set {number}={said:g} if cables wind up"
        report.add(SECTION, what, "warning", "0: unlimited", f"{said:g} {unit}", remedy)
        return
    limit = f"{said:g} {unit} ({axis.min:g} to {axis.max:g})"
    if abs(value - said) <= TRAVEL_TOLERANCE:
        report.add(SECTION, what, "ok", f"{value:g} {unit}", limit)
        return
    why = "its soft limit lets the axis leave the travel" if value > said else "programs within the cell file's travel raise ALARM 2"
    remedy = f"{why}: measure the travel, then set {number}={said:g}, or correct min and max of {axis.letter} in the cell file"
    report.add(SECTION, what, "FAULT", f"{value:g} {unit}", limit, remedy)
