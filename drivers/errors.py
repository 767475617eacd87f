"""What can go wrong on the wires; every message is one line for a person: which device, what, and in `hint` what to do.

DriverError
├── LinkError              the wire itself
│   ├── PortAbsent         no such serial port, or nothing listens at the address
│   ├── PortDenied         this user may not open the port
│   ├── PortBusy           another program has the port
│   ├── LinkLost           the wire was there and is gone
│   └── DeviceSilent       the wire is there, the device does not answer
├── DeviceFault            the device answered that it will not (Modbus exception, error:n)
├── WrongAnswer            the device answered something that cannot be an answer to the question
├── FirmwareError          the controller is not the one that the cell file names
│   ├── FirmwareUnknown    its firmware is none that these drivers know
│   └── FirmwareMismatch   firmware, axes or line length differ from the cell file
├── RangeError_            a value asked for is outside its bounds
└── CommandRefused         the command makes no sense now (streaming, wrong state)
"""

from __future__ import annotations


class DriverError(Exception):
    """Base of all driver errors.

    message : one line: device, what is wrong
    hint    : one line: what to do about it (may be empty)
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


class LinkError(DriverError):
    """The wire itself is at fault."""


class PortAbsent(LinkError):
    """There is no such serial port, or nothing listens at the address."""


class PortDenied(LinkError):
    """This user may not open the port."""


class PortBusy(LinkError):
    """Another program has the port."""


class LinkLost(LinkError):
    """The wire was there and is gone."""


class DeviceSilent(LinkError):
    """The wire is there, but the device does not answer."""


class DeviceFault(DriverError):
    """The device answered that it will not; `code` is its own (Modbus exception code, grbl error number)."""

    def __init__(self, message: str, hint: str = "", code: int = 0) -> None:
        super().__init__(message, hint)
        self.code = code


class WrongAnswer(DriverError):
    """The device answered something that cannot be an answer to the question."""


class FirmwareError(DriverError):
    """The controller is not the one that the cell file names."""


class FirmwareUnknown(FirmwareError):
    """The controller's firmware is none that these drivers know."""


class FirmwareMismatch(FirmwareError):
    """Firmware or axes differ from the cell file."""


class RangeError_(DriverError):
    """A value that was asked for is outside its bounds; nothing was changed."""


class CommandRefused(DriverError):
    """The command makes no sense now; nothing was sent."""
