"""Wires of the cell that the bench file names: simulated, or real with emission locked out. Nothing here can lead to light."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from config.device import load_device
from drivers.modbus.registers import encode
from tests.hardware.bench_file import SHIPPED, BenchFileError, chosen_bench, load_bench
from tests.hardware.guard import GuardedLink, GuardedPort, GuardError
from tests.hardware.joined import AtBench, BenchDrivers, drivers_at, towards_middle

STATES = {"Idle", "Run", "Hold", "Jog", "Alarm", "Door", "Check", "Home", "Sleep", "Tool"}
GRBL_RX_BYTES_LEAST = 64  # no controller that these drivers know has less
NEAR_MM = 0.01
DEAD_MAN_SHARE = 0.4  # the last heartbeat may be as old as the next one was due


@pytest.mark.hardware_ok
async def test_controller_tells_who_it_is_what_it_holds_and_where_it_stands(bench_cell: AtBench) -> None:
    async with drivers_at(bench_cell) as bench:
        cnc = bench.drivers.cnc
        identity = await cnc.identify()
        assert (identity.firmware, identity.letters) == (bench_cell.cell.cnc.firmware, bench_cell.cell.letters)
        assert identity.rx_bytes >= GRBL_RX_BYTES_LEAST and identity.planner_blocks > 0
        assert 0 < identity.window_bytes <= identity.rx_bytes
        assert cnc.status is not None and cnc.status.state in STATES
        assert set(cnc.status.machine) == set(bench_cell.cell.letters)
        assert set(await cnc.work_offset()) == set(bench_cell.cell.letters)
        assert await cnc.settings()


@pytest.mark.hardware_ok
async def test_every_register_is_read_and_has_a_meaning(bench_cell: AtBench) -> None:
    async with drivers_at(bench_cell) as bench:
        views = (bench.drivers.laser, bench.drivers.feeder, bench.drivers.io)
        await bench.until(lambda: all(view.connected and view.age_s < math.inf for view in views))
        for view in views:
            client = view.client
            for name, register in client.device.registers.items():
                if register.writable:
                    continue
                value = client.value(name)
                assert math.isfinite(value) and client.age(name) < bench_cell.facts.answer_s, name
                if register.type == "bit":
                    assert value in (0.0, 1.0), name
                if register.bits:
                    assert set(client.flags(name)) <= set(register.bits.values()), f"{name}: {value:g} has bits without meaning"
        assert bench.drivers.laser.power_readback_w == pytest.approx(0.0, abs=1.0)
        assert not bench.drivers.laser.is_emitting


@pytest.mark.hardware_ok
async def test_set_points_at_their_safe_values_are_taken_and_read_back(bench_cell: AtBench) -> None:
    if not bench_cell.facts.may_write:
        pytest.skip("the bench file does not permit to write")
    async with drivers_at(bench_cell) as bench:
        clients = [view.client for view in (bench.drivers.laser, bench.drivers.feeder, bench.drivers.io)]
        await bench.until(lambda: all(client.holds(name) for client in clients for name in client.desired))
        feeder, flow = bench.drivers.feeder, bench_cell.facts.shield_gas_l_min
        feeder.set_shield_gas(flow)
        await bench.until(lambda: feeder.client.holds("shield_gas_setpoint"))
        feeder.safe()
        await bench.until(lambda: feeder.client.holds("shield_gas_setpoint"))
        assert [fault for client in clients for fault in client.faults] == []


@pytest.mark.hardware_ok
async def test_feeder_that_hears_no_heartbeat_shuts_the_gas_and_says_so_no_earlier_than_its_dead_man_time(bench_cell: AtBench) -> None:
    flow = bench_cell.facts.shield_gas_l_min
    if not bench_cell.facts.may_write or flow == 0.0:
        pytest.skip("the bench file does not permit to let shield gas flow, and nothing else may be on")
    async with drivers_at(bench_cell) as bench:
        feeder = bench.drivers.feeder
        word = feeder.client.device.registers["fault_word"]
        texts = {text for text in word.bits.values() if "dead-man" in text or "heartbeat" in text}
        if not texts:
            pytest.skip("the feeder's register map has no flag for its dead-man")
        await bench.until(lambda: feeder.connected and not texts & set(feeder.faults))
        feeder.set_shield_gas(flow)
        await bench.until(lambda: feeder.client.holds("shield_gas_setpoint"))
        feeder.client.is_beating = False
        began = bench_cell.clock.now()
        await bench.until(lambda: bool(texts & set(feeder.faults)))
        assert bench_cell.clock.now() - began >= DEAD_MAN_SHARE * feeder.client.device.dead_man_s
        feeder.safe()
        feeder.client.is_beating = True

        def is_reset() -> bool:
            if texts & set(feeder.faults):
                feeder.reset_faults()  # asked again: a request that went lost takes it along
            return not texts & set(feeder.faults)

        await bench.until(is_reset)


@pytest.mark.hardware_ok
async def test_a_small_jog_goes_where_it_should_and_back(bench_cell: AtBench) -> None:
    if not bench_cell.facts.may_move:
        pytest.skip("the bench file does not permit to move")
    async with drivers_at(bench_cell) as bench:
        cnc, letter = bench.drivers.cnc, bench_cell.cell.axes[0].letter
        await cnc.identify()
        if cnc.status is None or not cnc.status.is_idle:
            pytest.skip("the machine is not ready to move: home it first")
        began = _position(bench, letter)
        way = towards_middle(bench_cell.cell, _joints(bench), bench_cell.facts.distance_mm)
        for distance, goal in ((way, began + way), (-way, began)):
            await cnc.jog(letter, distance, bench_cell.facts.feed_mm_min)
            await bench.until(lambda goal=goal: abs(_position(bench, letter) - goal) < NEAR_MM and cnc.status.is_idle)
        assert _position(bench, letter) == pytest.approx(began, abs=NEAR_MM)


def _position(bench: BenchDrivers, letter: str) -> float:
    status = bench.drivers.cnc.status
    assert status is not None
    return status.machine[letter]


def _joints(bench: BenchDrivers) -> list[float]:
    return [_position(bench, letter) for letter in bench.at.cell.letters]


# -- the guard and the file, which need no far end ---------------------------------------------------------------------


class Recorded:
    """A line that takes whatever comes through the guard."""

    name, connected = "recorded", True

    def __init__(self) -> None:
        self.values: list[list[int]] = []
        self.sent = b""

    async def write(
        self, device_id: int, table: str, address: int, values: list[int], sending: Callable[[], None] | None = None
    ) -> None:
        self.values.append(values)


class RecordedPort(Recorded):
    def write(self, data: bytes) -> int:  # type: ignore[override]
        taken = data[:5]  # the operating system takes only so much at once
        self.sent += taken
        return len(taken)


@pytest.mark.parametrize(
    ("role", "register", "value"),
    [("laser", "enable", 1), ("laser", "emission_permit", 1), ("laser", "power_setpoint", 1), ("feeder", "rate_setpoint", 5),
     ("feeder", "carrier_gas_setpoint", 5), ("feeder", "shield_gas_setpoint", 5), ("io", "head_deploy", 1)],
)  # fmt: skip
async def test_guard_lets_safe_values_through_and_nothing_that_could_lead_to_light_or_motion(role: str, register: str, value: int) -> None:
    line = Recorded()
    link = GuardedLink(line, role, load_device(f"{role}_generic"))  # type: ignore[arg-type]
    place = link.device.registers[register]
    safe = encode(place, place.safe or 0.0)
    await link.write(1, place.table, place.address, safe)
    with pytest.raises(GuardError, match=register):
        await link.write(1, place.table, place.address, encode(place, value))
    assert line.values == [safe]


async def test_guard_looks_at_every_value_of_a_group_and_at_places_that_no_map_names() -> None:
    line = Recorded()
    link = GuardedLink(line, "laser", load_device("laser_generic"), may_write=True, may_move=True)  # type: ignore[arg-type]
    with pytest.raises(GuardError, match="emission_permit"):
        await link.write(1, "coil", 0, [0, 1])
    with pytest.raises(GuardError, match="no set-point"):
        await link.write(1, "holding", 77, [1])
    assert line.values == [] and len(link.refused) == 2


@pytest.mark.parametrize(
    ("line", "may_move"),
    [("M62 P0", True), ("N7 G1X1 m3 S100", True), ("M64P0", True), ("M67 E0 Q5", True), ("M03", True), ("G1 X1 S5", True), ("G1 X1 F60", False),
     ("$J=G91 X1 F60", False), ("$H", False), ("X1", False), ("G38.2 Z-5 F10", False)],
)  # fmt: skip
def test_guard_lets_no_line_end_that_opens_a_gate_or_moves_without_leave(line: str, may_move: bool) -> None:
    port, far = GuardedPort(wire := RecordedPort(), may_move=may_move), line.encode() + b"\n"  # type: ignore[arg-type]
    with pytest.raises(GuardError):
        while far:
            far = far[port.write(far) :]
    assert b"\n" not in wire.sent


def test_guard_lets_questions_and_dry_lines_through_byte_for_byte() -> None:
    text = b"?$I\n$#\n$$\nG21 G90 G54\n!~M5 M9\nM65 P0\nM63 P0\nN3 G1 X1.5 F600\x84\nM30\n"
    port, left = GuardedPort(wire := RecordedPort(), may_move=True), text  # type: ignore[arg-type]
    while left:
        left = left[port.write(left) :]
    assert wire.sent == text and port.refused == []


REAL = 'far_end = "real"\ncell = "cell.toml"\n'
STATED = 'emission_locked_out_by = "key switch off, key in my pocket"\n'


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        (REAL + STATED, "sim", 'mode = "sim"'),
        (REAL, "real", "emission_locked_out_by"),
        (REAL + 'emission_locked_out_by = " ok "', "real", "emission_locked_out_by"),
        ('cell = "cell.toml"', "real", 'mode = "real"'),
        ('cell = "nowhere.toml"', "sim", "nowhere.toml"),
        ('cell = "trunnion_tcp"\nmay_fly = true', "sim", "may_fly"),
        ("cell = ", "sim", "bench.toml"),
    ],
)
def test_bench_that_must_not_be_run_is_refused_in_one_line(tmp_path: Path, text: str, mode: str, words: str) -> None:
    _write(tmp_path, text, mode)
    with pytest.raises(BenchFileError) as caught:
        load_bench(tmp_path / "bench.toml")
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_bench_of_a_real_cell_with_the_statement_is_taken_and_the_environment_names_it(tmp_path: Path) -> None:
    _write(tmp_path, REAL + STATED + 'run_dir = "ports"', "real")
    facts, cell = chosen_bench({"BENCH_FILE": str(tmp_path / "bench.toml")})
    assert facts.is_real and cell.mode == "real" and facts.run_dir == str(tmp_path / "ports")
    assert not facts.may_move and not facts.may_write
    assert not chosen_bench({})[0].is_real and load_bench(SHIPPED)[0] == chosen_bench({})[0]


def _write(folder: Path, text: str, mode: str) -> None:
    from config.base import find_facts

    shipped = find_facts("cells", "trunnion_tcp").read_text(encoding="utf-8")
    (folder / "cell.toml").write_text(shipped.replace('mode = "sim"', f'mode = "{mode}"'), encoding="utf-8")
    (folder / "bench.toml").write_text(text, encoding="utf-8")
