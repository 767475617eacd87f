"""Serial ports of this computer, their lasting names, and, only where told, who answers as grbl or grblHAL at which speed."""

from __future__ import annotations

from pathlib import Path

from serial.tools import list_ports

from cellctl.doctor.cnc import QuietCnc
from cellctl.doctor.report import Report
from config.cell import Cell
from drivers.errors import DriverError
from drivers.interfaces import Clock
from drivers.transport.serial_port import SerialPort

SECTION = "Serial ports"
BY_ID = Path("/dev/serial/by-id")
BAUDS = (115200, 250000, 230400, 57600, 38400, 19200, 9600)
PROBE_S = 2.5  # a board that reset when its port was opened is there by then
WHY_NOT = "opening a port resets some boards, and a byte at the wrong speed may be a command: --probe-ports where no machine is running"


def lasting_names() -> dict[str, str]:
    """Device path -> its name under /dev/serial/by-id, which stays when it is plugged in elsewhere."""
    if not BY_ID.is_dir():
        return {}
    return {str(link.resolve()): str(link) for link in sorted(BY_ID.iterdir())}


def list_serial_ports(cell: Cell, report: Report) -> list[str]:
    """Tell every port that this computer has; their device paths. None is opened."""
    names = lasting_names()
    ports = sorted(list_ports.comports(), key=lambda port: port.device)
    for port in ports:
        usb = f"usb:{port.vid:04x}:{port.pid:04x}" + (f":{port.serial_number}" if port.serial_number else "") if port.vid else "no USB device"
        text = ", ".join(part for part in (port.description, usb, names.get(port.device, "")) if part and part != "n/a")
        report.add(SECTION, port.device, "told", text)
    if not ports:
        report.add(SECTION, "ports of this computer", "told", "none is known to the operating system")
    if cell.cnc.port.startswith("/dev/tty") and Path(cell.cnc.port).exists():
        better = names.get(str(Path(cell.cnc.port).resolve()))
        if better:
            report.add(SECTION, cell.cnc.port, "warning", "a name that may change when devices are plugged", "", f'cnc.port = "{better}"')
    return [port.device for port in ports]


async def probe_ports(paths: list[str], taken: set[str], clock: Clock, report: Report) -> None:
    """Open each port but those in `taken` and ask `?` at every usual speed until one answers as grbl or grblHAL does."""
    for path in paths:
        if str(Path(path).resolve()) in taken:
            continue
        for baud in BAUDS:
            try:
                port = SerialPort(path, baud)
            except DriverError as error:
                report.add(SECTION, f"{path} asked", "not checked", remedy=error.message)
                break
            try:
                answer = await QuietCnc(port, (), clock).status(PROBE_S)
            except DriverError as error:
                report.add(SECTION, f"{path} asked", "not checked", remedy=error.message)
                break
            finally:
                port.close()
            if answer is not None:
                report.add(SECTION, f"{path} asked", "told", f"answers as grbl or grblHAL at {baud} baud, state {answer[0].state}")
                break
        else:
            report.add(SECTION, f"{path} asked", "told", f"nobody answers ? at {', '.join(map(str, BAUDS))} baud")
