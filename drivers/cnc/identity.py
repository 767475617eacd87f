"""Reads the answer to `$I` and compares it with the cell file."""

from __future__ import annotations

from config.cell import Cnc
from drivers.cnc.events import Identity
from drivers.errors import FirmwareMismatch, FirmwareUnknown

AXES_OF_GRBL = ("X", "Y", "Z")
NAMES = {"grblhal": "grblHAL", "grbl": "grbl 1.1"}


def read_identity(lines: list[str], banner: str, port: str) -> Identity:
    """Identity from the feedback lines of `$I` (or `$I+`); window_bytes is the whole receive buffer, letters () if not told.

    lines : `[VER:...]`, `[OPT:flags,planner,rx,axes,tools]`, `[AXS:5:XYZAC]`, `[FIRMWARE:grblHAL]`
    Raises FirmwareUnknown if it is neither grbl 1.1 nor grblHAL, or states no buffer sizes.
    """
    fields: dict[str, str] = {}
    for line in lines:
        key, _, value = line.strip("[]").partition(":")
        fields.setdefault(key, value)
    version = fields.get("VER", "").rstrip(":")
    firmware = _firmware(fields.get("FIRMWARE", ""), version, banner)
    if not firmware:
        said = fields.get("FIRMWARE") or version or banner or "nothing that tells its name"
        raise FirmwareUnknown(f"CNC at {port}: unknown firmware (it says {said!r})", "these drivers know grbl 1.1 and grblHAL")
    options = fields.get("OPT", "").split(",")
    if len(options) < 3 or not (options[1].isdigit() and options[2].isdigit()):
        raise FirmwareUnknown(f"CNC at {port}: {NAMES[firmware]} states no buffer sizes ([OPT:...] is missing)", "update the firmware")
    rx_bytes = int(options[2])
    letters = tuple(fields["AXS"].partition(":")[2]) if "AXS" in fields else ()
    return Identity(
        firmware=firmware, version=version, letters=letters, rx_bytes=rx_bytes, planner_blocks=int(options[1]),
        window_bytes=rx_bytes, options=options[0], reports_lines=True if "N" in options[0] else None,
    )  # fmt: skip


def _firmware(stated: str, version: str, banner: str) -> str:
    if stated:
        return "grblhal" if stated.lower() == "grblhal" else ""
    if banner.lower().startswith("grblhal"):
        return "grblhal"
    is_grbl = banner.lower().startswith("grbl 1.1") or not banner
    return "grbl" if is_grbl and version.startswith("1.1") else ""


def check_identity(identity: Identity, facts: Cnc, letters: tuple[str, ...], axes_reported: int) -> tuple[str, ...]:
    """The controller's axis letters, once they agree with the cell file.

    axes_reported : number of positions in a status report; a grbl that does not name its axes is known by it.
    Raises FirmwareMismatch.
    """
    if identity.firmware != facts.firmware:
        raise FirmwareMismatch(
            f"the CNC runs {NAMES[identity.firmware]}, the cell file says {NAMES[facts.firmware]}",
            "correct cnc.firmware in the cell file, or connect the right machine",
        )
    named = identity.letters
    if not named:
        named = letters if axes_reported == len(letters) else AXES_OF_GRBL
    if named != letters:
        raise FirmwareMismatch(
            f"the CNC has axes {''.join(named)}, the cell file says {''.join(letters)}",
            "correct the axes in the cell file, or connect the right machine",
        )
    return named
