"""A serial port that never waits: pyserial opens and sets it, its descriptor is read and written directly."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import struct
import termios

import serial

from drivers.errors import LinkError, LinkLost, PortAbsent, PortBusy, PortDenied
from drivers.transport.port_name import find_port

READ_BYTES = 4096
ZEROS = 16
GONE = "check the cable and the device's power"


class SerialPort:
    """8N1 serial line on `path` (as `find_port` takes it), opened exclusively.

    Raises PortAbsent, PortDenied or PortBusy when it cannot be opened; LinkLost from any method once the line is gone.
    """

    def __init__(self, path: str, baud: int) -> None:
        device = find_port(path)
        self.name = path if device == path else f"{path} ({device})"
        try:
            self._serial = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise open_error(device, error) from None
        self._fd: int | None = self._serial.fileno()
        self._zeros = 0  # empty queues told in a row
        self._block_on_silence(self._fd)

    def _block_on_silence(self, fd: int) -> None:
        """Make silence (EAGAIN) differ from a line that hung up (end of file): VMIN 0 shows both as no bytes."""
        settings = termios.tcgetattr(fd)
        settings[6][termios.VMIN] = 1
        settings[6][termios.VTIME] = 0
        termios.tcsetattr(fd, termios.TCSANOW, settings)
        os.set_blocking(fd, False)

    def read(self) -> bytes:
        """All bytes that have come in."""
        try:
            data = os.read(self._open_fd(), READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost(error) from None
        if not data:
            raise self._lost(None)
        return data

    def write(self, data: bytes) -> int:
        """Number of bytes that the operating system took."""
        try:
            return os.write(self._open_fd(), data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._lost(error) from None

    def queued(self) -> int:
        """Bytes in the operating system's output queue (a pty always says 0; who always does is asked only now and then)."""
        self._zeros += 1
        if self._zeros > ZEROS and self._zeros % ZEROS:
            return 0
        try:
            answer = fcntl.ioctl(self._open_fd(), termios.TIOCOUTQ, b"\0\0\0\0")
        except OSError as error:
            raise self._lost(error) from None
        count = int(struct.unpack("i", answer)[0])
        self._zeros = 0 if count else self._zeros
        return count

    def discard_output(self) -> None:
        """Drop the operating system's output queue."""
        try:
            termios.tcflush(self._open_fd(), termios.TCOFLUSH)
        except (OSError, termios.error) as error:
            raise self._lost(error) from None

    def close(self) -> None:
        """Give the line back."""
        self._fd = None
        self._serial.close()

    def fileno(self) -> int | None:
        """Descriptor of the open port."""
        return self._fd

    def _open_fd(self) -> int:
        if self._fd is None:
            raise LinkLost(f"serial port {self.name} is closed", "open it again")
        return self._fd

    def _lost(self, error: Exception | None) -> LinkLost:
        reason = f": {os.strerror(error.errno)}" if isinstance(error, OSError) and error.errno else ""
        return LinkLost(f"serial port {self.name} is gone{reason}", GONE)


def open_error(path: str, error: Exception) -> LinkError:
    """The error that says in one line why `path` cannot be opened."""
    number = getattr(error, "errno", None)
    if isinstance(error, termios.error):
        number = error.args[0]
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return PortBusy(f"serial port {path} is in use by another program", "close the other program, or name another port in the cell file")
    if number in (errno.EACCES, errno.EPERM):
        return PortDenied(f"serial port {path}: permission denied", "add this user to the port's group (dialout), then sign in again")
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return PortAbsent(f"serial port {path} does not exist", "connect the device, or name its port in the cell file")
    if number in (errno.ENOTTY, errno.EISDIR, errno.EINVAL) or _is_other_than_device(path):
        return PortAbsent(f"{path} is not a serial port", "name the device's port in the cell file")
    return PortAbsent(f"serial port {path} cannot be opened: {error}", "check port and baud rate in the cell file")


def _is_other_than_device(path: str) -> bool:
    try:
        return not stat.S_ISCHR(os.stat(path).st_mode)
    except OSError:
        return False
