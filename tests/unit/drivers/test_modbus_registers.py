"""Register codes against values written down by hand, and round trips of any value."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.device import Register, load_device
from drivers.errors import RangeError_, WrongAnswer
from drivers.modbus.registers import check_range, decode, encode, meanings, spans


def register(**facts: object) -> Register:
    return Register.model_validate({"table": "holding", "address": 0, "safe": 0.0, "type": "uint16"} | facts)


@pytest.mark.parametrize(
    ("facts", "value", "words"),
    [
        ({}, 513.0, [513]),
        ({"type": "int16"}, -2.0, [0xFFFE]),
        ({"type": "uint32"}, 65538.0, [1, 2]),
        ({"type": "uint32", "word_order": "little"}, 65538.0, [2, 1]),
        ({"type": "int32"}, -1.0, [0xFFFF, 0xFFFF]),
        ({"type": "float32"}, 1.5, [0x3FC0, 0]),
        ({"type": "float32", "word_order": "little"}, -2.0, [0, 0xC000]),
        ({"scale": 0.1}, 750.0, [7500]),
        ({"scale": 0.5, "offset": 10.0}, 12.0, [4]),
        ({"type": "bit", "table": "coil"}, 1.0, [1]),
    ],
)
def test_value_and_words_correspond_as_the_standard_says(facts: dict[str, object], value: float, words: list[int]) -> None:
    assert encode(register(**facts), value) == words
    assert decode(register(**facts), words) == pytest.approx(value)


@given(st.floats(-3000, 3000), st.sampled_from(["int16", "int32", "float32"]), st.sampled_from(["big", "little"]))
def test_round_trip_is_within_half_a_step(value: float, kind: str, order: str) -> None:
    one = register(type=kind, word_order=order, scale=0.1, offset=3.0)
    assert decode(one, encode(one, value)) == pytest.approx(value, abs=0.05 + 1e-3)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 65536.0])
def test_value_that_does_not_fit_its_type_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match=r"fit|finite"):
        encode(register(), value)


def test_wrong_number_of_words_is_a_wrong_answer() -> None:
    with pytest.raises(WrongAnswer):
        decode(register(type="float32"), [1])


@pytest.mark.parametrize(("value", "says"), [(2500.0, "2500 W asked, greatest is 2000 W"), (-1.0, "least is 0 W"), (math.nan, "no finite number")])
def test_value_beyond_its_bounds_is_refused_with_device_asked_limit_and_unit(value: float, says: str) -> None:
    laser = load_device("laser_generic")
    with pytest.raises(RangeError_, match=says) as caught:
        check_range(laser.name, "power_setpoint", laser.registers["power_setpoint"], value)
    assert caught.value.message.startswith("generic fibre laser: power_setpoint")


@pytest.mark.parametrize("name", ["laser_generic", "feeder_generic", "io_generic"])
def test_requests_cover_every_register_once_and_no_address_beside_them(name: str) -> None:
    registers = load_device(name).registers
    found = spans(registers, registers)
    covered = [(span.table, address) for span in found for address in range(span.address, span.address + span.count)]
    wanted = [(one.table, address) for one in registers.values() for address in range(one.address, one.address + one.count)]
    assert sorted(covered) == sorted(wanted)
    assert len(found) == len({one.table for one in registers.values()})


def test_bits_of_a_word_are_told_by_their_texts_and_unknown_ones_by_their_number() -> None:
    word = load_device("laser_generic").registers["fault_word"]
    assert meanings("fault_word", word, 18.0) == ["over-temperature", "fault_word bit 4 (not in the register map)"]
    assert meanings("fault_word", word, math.nan) == []
