"""Which device a port's name in the cell file means at this moment: a path, a pattern, or a USB device wherever it has turned up."""

from __future__ import annotations

import glob
from pathlib import Path

from serial.tools import list_ports

from drivers.errors import PortAbsent, PortBusy

USB = "usb:"
PATTERN = frozenset("*?[")


def port_path(named: str, run_dir: Path) -> str:
    """The name as `find_port` takes it: a relative path is one in run_dir; absolute paths and usb: names stay as they are."""
    return named if named.startswith(USB) else str(run_dir / named)


def find_port(named: str) -> str:
    """The device path that `named` means now; a device that was unplugged may come back under another one.

    named : a path (a link such as /dev/serial/by-id/... is followed when it is opened), a pattern of paths, or
            usb:VID:PID or usb:VID:PID:SERIAL with hexadecimal ids
    Raises PortAbsent if nothing fits, PortBusy if more than one device does: none is chosen by guess.
    """
    if named.startswith(USB):
        found, what = _usb(named), "USB device"
    elif PATTERN & set(named) and not Path(named).exists():
        found, what = sorted(glob.glob(named)), "serial port"
    else:
        return named
    if not found:
        raise PortAbsent(f"no {what} {named} is there", "plug the device in, or correct its port in the cell file")
    if len({str(Path(path).resolve()) for path in found}) > 1:
        raise PortBusy(f"more than one {what} fits {named}: {', '.join(found)}", "name one by its serial number or by /dev/serial/by-id/...")
    return found[0]


def _usb(named: str) -> list[str]:
    parts = named[len(USB) :].split(":", 2)
    try:
        vendor, product = int(parts[0], 16), int(parts[1], 16)
    except (ValueError, IndexError):
        raise PortAbsent(f"{named!r} is no USB device", "write usb:VID:PID or usb:VID:PID:SERIAL, as in usb:0403:6001:A5069RR4") from None
    serial = parts[2] if len(parts) > 2 else None
    ports = list_ports.comports()
    return sorted(port.device for port in ports if (port.vid, port.pid) == (vendor, product) and serial in (None, port.serial_number))
