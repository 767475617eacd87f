"""What a field's name says about its unit, and every fault of a validation with field, value, bound and unit."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

UNITS = {
    "_w_m2_k": "W/(m² K)", "_w_mm_k": "W/(mm K)", "_j_g_k": "J/(g K)", "_g_mm3": "g/mm³", "_j_g": "J/g", "_j_k": "J/K", "_w_k": "W/K",
    "_g_min": "g/min", "_l_min": "L/min", "_mm_min": "mm/min", "_deg_min": "deg/min", "_m_min": "m/min", "_mm_s": "mm/s", "_mm_s2": "mm/s²",
    "_deg_s": "deg/s", "_g_s": "g/s", "_mm2": "mm²", "_mm3": "mm³", "_mm": "mm", "_deg": "deg", "_rad": "rad", "_rpm": "1/min",
    "_ms": "ms", "_hz": "Hz", "_bytes": "bytes", "_percent": "%", "_kg": "kg", "_w": "W", "_k": "K", "_s": "s",
}  # fmt: skip
"""Ends of field names -> unit; the longest that fits counts."""
BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


def unit_of(path: tuple[Any, ...]) -> str:
    """Unit of the field at a path such as ("deposition", "laser_w", "max"): of the innermost name that has one; empty if none."""
    for step in reversed(path):
        ends = [end for end in UNITS if isinstance(step, str) and step.endswith(end)]
        if ends:
            return UNITS[max(ends, key=len)]
    return ""


def faults_of(error: ValidationError) -> list[dict[str, str]]:
    """Each fault as {field, error, value, bound, unit}; what does not apply is empty. error : one line that says it all."""
    found = []
    for fault in error.errors(include_url=False):
        path = tuple(fault["loc"])
        field = ".".join(str(step) for step in path) or "the whole"
        unit = unit_of(path)
        bound = ", ".join(f"{sign} {fault['ctx'][name]:g}" for name, sign in BOUNDS.items() if name in fault.get("ctx", {}))
        value = "" if fault["type"] in ("missing", "extra_forbidden") or isinstance(fault["input"], dict) else str(fault["input"])[:60]
        found.append({"field": field, "error": _line(fault, field, value, bound, unit), "value": value, "bound": bound, "unit": unit})
    return found


def _line(fault: Any, field: str, value: str, bound: str, unit: str) -> str:
    with_unit = f" {unit}" if unit else ""
    if fault["type"] == "extra_forbidden":
        return f"{field}: unknown key"
    if fault["type"] == "missing":
        return f"{field}: is missing" + (f" (in {unit})" if unit else "")
    if bound:
        return f"{field}: {value}{with_unit} is out of bounds, it must be {bound}{with_unit}"
    said = str(fault["msg"]).removeprefix("Value error, ")
    return f"{field}: {said}" + (f" (got {value}{with_unit})" if value else with_unit and f" (in {unit})")
