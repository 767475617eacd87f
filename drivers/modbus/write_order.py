"""Which registers one write request takes: what turns safe goes first; bits gate what words set, off before and on after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from config.device import Register
from drivers.modbus.registers import spans


def next_group(registers: Mapping[str, Register], to_safe: Sequence[str], others: Sequence[str]) -> list[str]:
    """Names that the next request writes, in order of address; none when nothing is left.

    to_safe : changed, and wanted at the safe value   others : changed otherwise, and the heartbeat
    """
    for names, is_bit in ((to_safe, True), (to_safe, False), (others, False), (others, True)):
        chosen = [name for name in names if (registers[name].type == "bit") == is_bit]
        if chosen:
            return [chosen[0]] if is_bit else list(spans(registers, chosen)[0].names)
    return []
