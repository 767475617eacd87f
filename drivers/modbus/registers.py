"""Values in units to words on the wire and back; which registers go into one request. Pure."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from config.device import Register, Table
from drivers.errors import RangeError_, WrongAnswer

# type -> struct code (big-endian) of the whole value; a bit is its own word
CODES = {"uint16": ">H", "int16": ">h", "uint32": ">I", "int32": ">i", "float32": ">f"}
LIMITS = {"bit": (0, 1), "uint16": (0, 0xFFFF), "int16": (-0x8000, 0x7FFF), "uint32": (0, 0xFFFFFFFF), "int32": (-(2**31), 2**31 - 1)}
REGISTERS_MAX = 120  # of one request: the protocol's 125, less a margin that some gateways need
BITS_MAX = 960


@dataclass(frozen=True, slots=True)
class Span:
    """Neighbouring registers of one table that one request reads or writes. names in order of address."""

    table: Table
    address: int
    count: int
    names: tuple[str, ...]


def encode(register: Register, value: float) -> list[int]:
    """Words (16 bit each; a bit as 0 or 1) of a value in the register's unit, rounded to its resolution.

    Raises ValueError when the value is not finite or does not fit the type.
    """
    raw = (value - register.offset) / register.scale
    if not math.isfinite(raw):
        raise ValueError(f"{value} is no finite number")
    if register.type == "float32":
        packed = _pack_float(raw)
    else:
        low, high = LIMITS[register.type]
        whole = round(raw)
        if not low <= whole <= high:
            raise ValueError(f"{value} does not fit {register.type}")
        if register.type == "bit":
            return [whole]
        packed = struct.pack(CODES[register.type], whole)
    words = [int.from_bytes(packed[k : k + 2], "big") for k in range(0, len(packed), 2)]
    return words[::-1] if register.word_order == "little" else words


def _pack_float(raw: float) -> bytes:
    try:
        return struct.pack(">f", raw)
    except OverflowError:
        raise ValueError(f"{raw} does not fit float32") from None


def decode(register: Register, words: Sequence[int]) -> float:
    """Value in the register's unit. Raises WrongAnswer when the number of words is not that of the type."""
    if len(words) != register.count:
        raise WrongAnswer(f"{len(words)} words for a {register.type}", "compare the register map with the device's document")
    if register.type == "bit":
        return float(bool(words[0])) * register.scale + register.offset
    ordered = words[::-1] if register.word_order == "little" else words
    packed = struct.pack(f">{len(ordered)}H", *ordered)
    return float(struct.unpack(CODES[register.type], packed)[0]) * register.scale + register.offset


def check_range(device: str, name: str, register: Register, value: float) -> None:
    """Raise RangeError_ that names device, value asked, limit and unit unless the value may be written."""
    unit = f" {register.unit}" if register.unit else ""
    asked = f"{device}: {name} {value:g}{unit} asked"
    if not register.writable:
        raise RangeError_(f"{device}: {name} is read only", "set the set-point, not the read-back")
    if not math.isfinite(value):
        raise RangeError_(f"{asked}, no finite number", "give a number")
    if register.min is not None and value < register.min:
        raise RangeError_(f"{asked}, least is {register.min:g}{unit}", "ask for more, or correct the register map")
    if register.max is not None and value > register.max:
        raise RangeError_(f"{asked}, greatest is {register.max:g}{unit}", "ask for less, or correct the register map")
    try:
        encode(register, value)
    except ValueError as error:
        raise RangeError_(f"{asked}: {error}", "compare the register map with the device's document") from None


def spans(registers: Mapping[str, Register], names: Iterable[str]) -> list[Span]:
    """The fewest requests that touch `names` and no address between them that the map does not name."""
    found: list[Span] = []
    for name in sorted(names, key=lambda name: (registers[name].table, registers[name].address)):
        register = registers[name]
        last = found[-1] if found else None
        most = BITS_MAX if register.type == "bit" else REGISTERS_MAX
        is_next = last is not None and last.table == register.table and last.address + last.count == register.address
        if last is not None and is_next and last.count + register.count <= most:
            found[-1] = Span(last.table, last.address, last.count + register.count, (*last.names, name))
        else:
            found.append(Span(register.table, register.address, register.count, (name,)))
    return found


def meanings(name: str, register: Register, value: float) -> list[str]:
    """Texts of the bits that are set in a word of flags, lowest first."""
    if not math.isfinite(value):
        return []
    word = round((value - register.offset) / register.scale)
    set_bits = [bit for bit in range(16 * register.count) if word >> bit & 1]
    return [register.bits.get(str(bit), f"{name} bit {bit} (not in the register map)") for bit in set_bits]
