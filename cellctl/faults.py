"""The one place where the errors of every package become a title, one line and a hint, an exit code and an HTTP status."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Fault:
    """An error in a person's words. status : of HTTP; exit_code : 2 for bad input, 1 for what failed otherwise"""

    title: str
    detail: str
    hint: str
    status: int
    exit_code: int


# module, class: title, HTTP status, exit code. Looked up by name, so that no package is imported to explain another's error.
TABLE: dict[tuple[str, str], tuple[str, int, int]] = {
    ("planner.errors", "MeshError"): ("The mesh cannot be used", 422, 2),
    ("planner.errors", "RecipeError"): ("The recipe cannot be used", 422, 2),
    ("planner.errors", "FileFormatError"): ("The file cannot be used", 422, 2),
    ("planner.errors", "InputError"): ("The input cannot be used", 422, 2),
    ("planner.errors", "TravelLimitError"): ("Outside the machine's travel", 422, 2),
    ("planner.errors", "ReachError"): ("Out of the machine's reach", 422, 2),
    ("planner.errors", "PostError"): ("The plan does not fit this cell", 422, 2),
    ("planner.errors", "ResumeError"): ("The program cannot be gone on with", 422, 2),
    ("planner.errors", "PlanningError"): ("The part cannot be planned", 422, 2),
    ("planner.errors", "FitError"): ("A curve cannot be fitted", 422, 2),
    ("planner.errors", "PlannerError"): ("Planning failed", 422, 2),
    ("config.base", "ConfigError"): ("The facts file cannot be used", 422, 2),
    ("sim.errors", "SimError"): ("The simulated cell cannot do this", 422, 2),
    ("drivers.errors", "DriverError"): ("A device of the cell cannot be used", 503, 1),
    ("cellctl.store.errors", "StoreError"): ("The store cannot be used", 503, 2),
    ("cellctl.passwords", "PasswordError"): ("The password will not do", 422, 2),
    ("cellctl.store.users", "UserNameError"): ("The name cannot be used", 422, 2),
    ("cellctl.store.users", "LastAdminError"): ("The last admin", 409, 2),
    ("cellctl.tls", "TlsError"): ("The certificate cannot be used", 503, 2),
    ("cellctl.client", "ServiceError"): ("The service refused", 502, 1),
    ("cellctl.record.seal", "SealError"): ("The record is not what was sealed", 500, 1),
    ("cellctl.first_start", "ServeError"): ("The service cannot start", 503, 2),
    ("cellctl.planning.pool.wire", "PoolError"): ("The planning pool cannot be used", 503, 2),
    ("cellctl.cli.input", "InputFault"): ("Bad input", 422, 2),
    ("cellctl.demo", "DemoError"): ("The demo failed", 500, 1),
    ("cellctl.doctor.options", "DoctorError"): ("The cell cannot be checked", 503, 1),
}


def explain(error: BaseException) -> Fault | None:
    """The fault behind an error that a user can cause, None for one that is ours.

    The most derived class in TABLE counts; an error may bring its own `exit_code` and `status`.
    """
    for cls in type(error).__mro__:
        row = TABLE.get((cls.__module__, cls.__name__))
        if row is not None:
            title, status, exit_code = row
            detail = str(getattr(error, "message", "") or error)
            return Fault(
                _own(error, "title", title),
                one_line(detail),
                one_line(str(getattr(error, "hint", "") or "")),
                _own(error, "status", status),
                _own(error, "exit_code", exit_code),
            )
    return _of_disk(error)


def _of_disk(error: BaseException) -> Fault | None:
    """A disk or store that refuses is nobody's bug: whoever asked can do something about it."""
    from cellctl.domain.trouble import trouble_of

    trouble = trouble_of(error)
    return Fault(trouble.title, one_line(trouble.detail), trouble.hint, trouble.status, 1) if trouble is not None else None


def _own(error: BaseException, name: str, default: Any) -> Any:
    value = getattr(error, name, None)
    return value if isinstance(value, type(default)) and value else default


def one_line(text: str) -> str:
    """Text without line breaks and other control characters."""
    return " ".join("".join(char if char.isprintable() else " " for char in text).split())


def report(fault: Fault) -> None:
    """The fault's line, and its hint, on stderr."""
    sys.stderr.write(f"cellctl: {fault.detail}\n")
    if fault.hint:
        sys.stderr.write(f"  hint: {fault.hint}\n")
