"""A register bank: the map's addresses on one side, the plant's values in units on the other."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from config import Device, Register
from sim.plant.signals import Signals

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE, DEVICE_BUSY = 1, 2, 3, 4, 6

# struct codes of the value as it stands in big-endian registers
FORMATS = {"uint16": ">H", "int16": ">h", "uint32": ">I", "int32": ">i", "float32": ">f"}
RANGES = {
    "bit": (0, 1),
    "uint16": (0, 0xFFFF),
    "int16": (-0x8000, 0x7FFF),
    "uint32": (0, 0xFFFF_FFFF),
    "int32": (-(1 << 31), (1 << 31) - 1),
}


class ModbusFault(Exception):
    """An exception answer; `code` as in Modbus Application Protocol 1.1b3, chapter 7."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


def to_words(register: Register, value: float) -> list[int]:
    """Registers (or one bit) of a value in units; what does not fit the type is clipped to its range."""
    raw = (value - register.offset) / register.scale
    if register.type == "float32":
        packed = struct.pack(">f", raw)
    else:
        low, high = RANGES[register.type]
        whole = min(max(round(raw), low), high)
        if register.type == "bit":
            return [whole]
        packed = struct.pack(FORMATS[register.type], whole)
    words = list(struct.unpack(f">{len(packed) // 2}H", packed))
    return words[::-1] if register.word_order == "little" else words


def from_words(register: Register, words: Sequence[int]) -> float:
    """Value in units of registers (or one bit)."""
    if register.type == "bit":
        raw = float(words[0])
    else:
        ordered = list(words)[::-1] if register.word_order == "little" else list(words)
        raw = float(struct.unpack(FORMATS[register.type], struct.pack(f">{len(ordered)}H", *ordered))[0])
    return raw * register.scale + register.offset


class RegisterBank:
    """All tables of one device. Addresses that the map does not name do not exist."""

    def __init__(self, device: Device, signals: Signals) -> None:
        self._signals = signals
        self._registers = device.registers
        self._places: dict[tuple[str, int], tuple[str, int]] = {
            (register.table, register.address + k): (name, k)
            for name, register in device.registers.items()
            for k in range(register.count)
        }
        self.shown: dict[str, float] = {}  # registers that read wrong, and as what, in units
        self.stuck: dict[str, float] = {}  # registers that keep their value, whatever is written or happens

    @property
    def names(self) -> frozenset[str]:
        """Names of the registers."""
        return frozenset(self._registers)

    def stick(self, name: str) -> None:
        """Have a register keep the value that it has now."""
        self.stuck[name] = self._signals.values[name]

    def mend(self) -> None:
        """All registers work again."""
        self.shown.clear()
        self.stuck.clear()

    def _check(self, table: str, address: int, count: int) -> None:
        if any((table, at) not in self._places for at in range(address, address + count)):
            raise ModbusFault(ILLEGAL_ADDRESS)

    def _words(self, name: str) -> list[int]:
        value = self._signals.values[name]
        if self.shown or self.stuck:
            value = self.shown.get(name, self.stuck.get(name, value))
        return to_words(self._registers[name], value)

    def read(self, table: str, address: int, count: int) -> list[int]:
        """`count` registers or bits. Raises ModbusFault 2 when one of them does not exist."""
        self._check(table, address, count)
        places = [self._places[table, at] for at in range(address, address + count)]
        return [self._words(name)[k] for name, k in places]

    def write(self, table: str, address: int, values: Sequence[int]) -> None:
        """Write registers or bits. Raises ModbusFault 2 when one does not exist, 3 when a value is beyond its bounds; then nothing is written."""
        self._check(table, address, len(values))
        images: dict[str, list[int]] = {}
        for at, word in zip(range(address, address + len(values)), values, strict=True):
            name, k = self._places[table, at]
            images.setdefault(name, self._words(name))[k] = word
        decoded = {name: from_words(self._registers[name], words) for name, words in images.items()}
        for name, value in decoded.items():
            register = self._registers[name]
            slack = abs(register.scale) * 1e-6
            below = register.min is not None and value < register.min - slack
            above = register.max is not None and value > register.max + slack
            if below or above or value != value:
                raise ModbusFault(ILLEGAL_VALUE)
        for name, value in decoded.items():
            if name not in self.stuck:
                self._signals.write(name, value)
