"""Registers, requests and RTU frames of the simulated devices against hand-made bytes and the published examples."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from config import Register, load_cell, load_device
from sim.modbus.pdu import answer
from sim.modbus.registers import ModbusFault, RegisterBank, from_words, to_words
from sim.modbus.rtu import SILENCE_S, RtuReceiver, crc16, frame
from sim.modbus.wire import Wire
from sim.plant.signals import Signals

ROLES = {role: link.device for role, link in load_cell("trunnion_tcp").links.items()}


def bank_of(role: str) -> tuple[RegisterBank, Signals]:
    device = load_device(ROLES[role])  # type: ignore[index]
    signals = Signals(device)
    return RegisterBank(device, signals), signals


def ask(bank: RegisterBank, *request: int) -> bytes:
    return answer(bytes(request), bank, Wire())


def test_float_with_low_word_first_reads_as_its_ieee_bytes_swapped() -> None:
    bank, signals = bank_of("feeder")
    signals.values["rate_readback"] = 12.5
    high, low = struct.unpack(">HH", struct.pack(">f", 12.5))
    assert bank.read("input", 0, 2) == [low, high]


def test_scaled_register_holds_tenths() -> None:
    bank, signals = bank_of("laser")
    bank.write("holding", 0, [12345])
    assert signals.values["power_setpoint"] == pytest.approx(1234.5)
    assert bank.read("holding", 0, 1) == [12345]


types = st.sampled_from(["uint16", "int16", "uint32", "int32", "float32"])


@given(types, st.sampled_from(["big", "little"]), st.sampled_from([1.0, 0.1, 0.01]), st.integers(-30000, 30000))
def test_values_survive_the_way_through_registers(kind: str, order: str, scale: float, raw: int) -> None:
    number = abs(raw) if kind.startswith("u") else raw
    register = Register(table="input", address=0, type=kind, word_order=order, scale=scale)  # type: ignore[arg-type]
    words = to_words(register, number * scale)
    assert len(words) == register.count
    assert all(0 <= word <= 0xFFFF for word in words)
    assert from_words(register, words) == pytest.approx(number * scale, rel=1e-6, abs=1e-9)


def test_every_register_of_every_shipped_map_can_be_read() -> None:
    for role in ROLES:
        bank, _ = bank_of(role)
        for register in load_device(ROLES[role]).registers.values():
            assert len(bank.read(register.table, register.address, register.count)) == register.count


def test_addresses_outside_the_map_answer_exception_2() -> None:
    bank, _ = bank_of("laser")
    with pytest.raises(ModbusFault) as caught:
        bank.read("input", 4, 5)
    assert caught.value.code == 2
    assert ask(bank, 4, 0, 99, 0, 1) == bytes([0x84, 2])
    assert ask(bank, 6, 0, 99, 0, 1) == bytes([0x86, 2])


def test_a_value_beyond_its_bounds_answers_exception_3_and_writes_nothing() -> None:
    bank, signals = bank_of("laser")
    assert ask(bank, 6, 0, 0, 0x4E, 0x21) == bytes([0x86, 3])  # 20001 tenths of a watt; the map ends at 2000 W
    assert ask(bank, 16, 0, 0, 0, 2, 4, 0x4E, 0x21, 0, 7) == bytes([0x90, 3])
    assert signals.values["power_setpoint"] == 0.0
    assert signals.values["heartbeat"] == 0.0


@pytest.mark.parametrize(
    ("request_bytes", "code"),
    [
        ((7,), 1),
        ((43, 14, 1, 0), 1),
        ((4, 0, 0, 0, 0), 3),
        ((4, 0, 0, 0, 126), 3),
        ((4, 0, 0), 3),
        ((5, 0, 0, 0x12, 0x34), 3),
        ((16, 0, 0, 0, 2, 3, 0, 1, 0), 3),
    ],
)
def test_requests_that_are_not_right_answer_their_exception(request_bytes: tuple[int, ...], code: int) -> None:
    bank, _ = bank_of("laser")
    assert ask(bank, *request_bytes) == bytes([request_bytes[0] | 0x80, code])


def test_each_function_code_does_its_work() -> None:
    bank, signals = bank_of("laser")
    assert ask(bank, 5, 0, 1, 0xFF, 0) == bytes([5, 0, 1, 0xFF, 0])
    assert signals.values["emission_permit"] == 1.0
    assert ask(bank, 15, 0, 0, 0, 3, 1, 0b011) == bytes([15, 0, 0, 0, 3])
    assert ask(bank, 1, 0, 0, 0, 3) == bytes([1, 1, 0b011])
    assert ask(bank, 6, 0, 0, 0x03, 0xE8) == bytes([6, 0, 0, 0x03, 0xE8])
    assert ask(bank, 3, 0, 0, 0, 1) == bytes([3, 2, 0x03, 0xE8])
    assert ask(bank, 16, 0, 0, 0, 2, 4, 0, 10, 0, 5) == bytes([16, 0, 0, 0, 2])
    assert signals.values["power_setpoint"] == pytest.approx(1.0)
    assert ask(bank, 2, 0, 0, 0, 1) == bytes([2, 1, 0])
    assert ask(bank, 4, 0, 0, 0, 2)[:2] == bytes([4, 4])


def test_faults_of_the_wire_show_in_the_answers() -> None:
    bank, _ = bank_of("laser")
    assert answer(bytes([4, 0, 0, 0, 2]), bank, Wire(exception=4)) == bytes([0x84, 4])
    assert len(answer(bytes([4, 0, 0, 0, 2]), bank, Wire(extra_count=-1))) == 2 + 2
    assert len(answer(bytes([4, 0, 0, 0, 2]), bank, Wire(extra_count=1))) == 2 + 6


def test_checksum_is_the_one_of_the_specification() -> None:
    assert crc16(b"123456789") == 0x4B37  # catalogue value of CRC-16/MODBUS
    assert frame(2, bytes([7])) == bytes([0x02, 0x07, 0x41, 0x12])  # Modbus over Serial Line 1.02, 6.2.2


@given(st.lists(st.integers(1, 5), min_size=1, max_size=30))
def test_frames_come_out_whole_however_the_bytes_come(chunks: list[int]) -> None:
    requests = [(1, bytes([4, 0, 0, 0, 2])), (3, bytes([16, 0, 0, 0, 1, 2, 0, 9])), (2, bytes([5, 0, 1, 0xFF, 0]))]
    stream = b"".join(frame(*each) for each in requests)
    receiver, found, now = RtuReceiver(), [], 1.0
    position = 0
    while position < len(stream):
        size = chunks[position % len(chunks)]
        found += receiver.feed(stream[position : position + size], now)
        position += size
        now += 0.001
    assert found == requests


def test_a_frame_broken_off_is_forgotten_after_silence() -> None:
    receiver = RtuReceiver()
    whole = frame(1, bytes([4, 0, 0, 0, 2]))
    assert receiver.feed(whole[:5], 1.0) == []
    assert receiver.feed(whole, 1.0 + 2 * SILENCE_S) == [(1, whole[1:-2])]


def test_a_frame_with_a_wrong_checksum_is_not_answered() -> None:
    receiver = RtuReceiver()
    assert receiver.feed(frame(1, bytes([4, 0, 0, 0, 2]))[:-1] + b"\x00", 1.0) == []
    assert receiver.bad_frames == 1
