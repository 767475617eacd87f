"""What a port's name in the cell file means: paths, patterns and USB devices that come back under another name."""

from __future__ import annotations

import os
import pty
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.errors import LinkLost, PortAbsent, PortBusy
from drivers.transport import port_name
from drivers.transport.port_name import find_port, port_path
from drivers.transport.serial_port import SerialPort


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> list[SimpleNamespace]:
    """What the system says is plugged in."""
    ports = [SimpleNamespace(device="/dev/ttyUSB0", vid=0x0403, pid=0x6001, serial_number="A5069RR4")]
    monkeypatch.setattr(port_name.list_ports, "comports", lambda: ports)
    return ports


@pytest.fixture
def two_lines() -> Iterator[list[tuple[int, int]]]:
    lines = [pty.openpty(), pty.openpty()]
    yield lines
    for fd in (fd for line in lines for fd in line):
        try:
            os.close(fd)
        except OSError:
            continue


def test_usb_device_is_found_by_its_ids_and_serial_number_wherever_it_turns_up(plugged: list[SimpleNamespace]) -> None:
    assert find_port("usb:0403:6001:A5069RR4") == "/dev/ttyUSB0"
    plugged[0].device = "/dev/ttyUSB3"
    assert find_port("usb:0403:6001") == find_port("usb:0403:6001:A5069RR4") == "/dev/ttyUSB3"


def test_usb_device_that_is_absent_or_not_the_only_one_is_one_clear_line(plugged: list[SimpleNamespace]) -> None:
    with pytest.raises(PortAbsent, match="no USB device usb:0403:6001:OTHER"):
        find_port("usb:0403:6001:OTHER")
    plugged.append(SimpleNamespace(device="/dev/ttyUSB1", vid=0x0403, pid=0x6001, serial_number="B1"))
    with pytest.raises(PortBusy, match=r"more than one USB device .*ttyUSB0, /dev/ttyUSB1"):
        find_port("usb:0403:6001")
    with pytest.raises(PortAbsent, match="is no USB device"):
        find_port("usb:machine")


def test_relative_names_are_of_the_run_directory_and_usb_names_of_none(tmp_path: Path) -> None:
    assert port_path("cnc", tmp_path) == str(tmp_path / "cnc")
    assert port_path("/dev/ttyACM0", tmp_path) == "/dev/ttyACM0"
    assert port_path("usb:0403:6001", tmp_path) == "usb:0403:6001"


def test_pattern_means_the_one_port_that_fits(tmp_path: Path) -> None:
    with pytest.raises(PortAbsent, match="no serial port"):
        find_port(str(tmp_path / "ttyACM*"))
    (tmp_path / "ttyACM1").touch()
    assert find_port(str(tmp_path / "ttyACM*")) == str(tmp_path / "ttyACM1")
    (tmp_path / "ttyACM2").touch()
    with pytest.raises(PortBusy, match="more than one serial port"):
        find_port(str(tmp_path / "ttyACM*"))


@pytest.mark.parametrize("named", ["by-id-link", "ttyUSB*"])
def test_device_replugged_under_another_name_is_opened_again_by_the_same_words(
    named: str, tmp_path: Path, two_lines: list[tuple[int, int]]
) -> None:
    (master, slave), (_, other) = two_lines
    name = tmp_path / ("by-id-link" if named == "by-id-link" else "ttyUSB0")
    name.symlink_to(os.ttyname(slave))
    port = SerialPort(str(tmp_path / named), 115200)
    os.close(master)
    os.close(slave)
    with pytest.raises(LinkLost):
        port.read()
    port.close()
    name.unlink()
    with pytest.raises(PortAbsent):
        SerialPort(str(tmp_path / named), 115200)
    (name if named == "by-id-link" else tmp_path / "ttyUSB7").symlink_to(os.ttyname(other))
    again = SerialPort(str(tmp_path / named), 115200)
    assert again.read() == b""
    again.close()
