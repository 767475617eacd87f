"""`cellctl doctor` at a simulated cell, over its wires: what is wrong is named; nothing moves and nothing comes out unless told."""

from __future__ import annotations

import asyncio
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from cellctl.doctor import DoctorError, Options, Report, examine_cell
from cellctl.doctor.page import html_of
from config.base import FACTS_DIR
from config.cell import load_cell
from sim.server import SimServer
from sim.world import World

QUICK: dict[str, Any] = {"status_queries": 2, "requests": 10, "answer_s": 0.6}
TIME_SCALE = 1.0


class Witness:
    """Looks at the plant at every step of the simulated world: whether anything moved, and whether light or powder came out."""

    def __init__(self, world: World) -> None:
        self.joints, self.slide = world.joints.copy(), world.io.slide
        self.has_moved = self.has_emitted = self.was_enabled = False
        step = world.step

        def watched(dt_s: float) -> None:
            step(dt_s)
            self.has_moved |= bool((world.joints != self.joints).any()) or world.io.slide != self.slide
            self.has_emitted |= world.laser.emission_w > 0.0 or world.laser.is_pilot_lit or world.feeder.rate_at_nozzle_g_min > 0.0
            self.was_enabled |= bool(world.laser.values["enable"])

        world.step = watched  # type: ignore[method-assign]


def device_file(folder: Path, name: str, change: Callable[[dict[str, Any]], None]) -> str:
    """A register map that differs from what the device really has."""
    facts = tomllib.loads((FACTS_DIR / "devices" / f"{name}.toml").read_text(encoding="utf-8"))
    change(facts)
    path = folder / f"{name}.toml"
    path.write_text(tomli_w.dumps(facts), encoding="utf-8")
    return str(path)


async def examined(
    folder: Path, *, cell: str = "trunnion_tcp", prepare: Callable[[World], None] | None = None, believed: dict[str, str] | None = None,
    options: Callable[[World], Options] | None = None, faults: tuple[str, ...] = (),
) -> tuple[Report, Witness]:
    """The doctor's report of a simulated cell. believed : register maps that the doctor has instead, by role"""
    facts = load_cell(cell)
    links = {role: link.model_copy(update={"tcp_port": 0}) for role, link in facts.links.items()}
    server = SimServer(facts.model_copy(update={"links": links}), folder / "run", time_scale=TIME_SCALE)
    witness = Witness(server.world)
    await server.start()
    running = asyncio.ensure_future(server.run())
    try:
        if prepare is not None:
            prepare(server.world)
        for fault in faults:
            server.world.faults.add(fault)
        document = tomllib.loads(server.cell_file.read_text(encoding="utf-8"))
        for role, path in (believed or {}).items():
            document["links"][role]["device"] = path
        given = folder / "cell.toml"
        given.write_text(tomli_w.dumps(document), encoding="utf-8")
        chosen = options(server.world) if options else Options(**QUICK)
        return await asyncio.to_thread(examine_cell, str(given), server.run_dir, chosen), witness
    finally:
        server.stop()
        await running
        await server.close()


def texts(report: Report) -> list[str]:
    return [f"{check.section}: {check.what}: {check.found}; {check.remedy}" for check in report.faults]


def is_left_in_peace(witness: Witness) -> bool:
    return not (witness.has_moved or witness.has_emitted or witness.was_enabled)


@pytest.mark.parametrize("cell", ["trunnion_tcp", "trunnion_rtu"])
async def test_a_good_cell_is_told_with_every_register_and_setting_and_left_in_peace(cell: str, tmp_path: Path) -> None:
    before = time.time()
    report, witness = await examined(tmp_path, cell=cell)
    assert [text for text in texts(report) if "placement" not in text and "time" not in text] == []
    told = {check.what.split(":")[0] for check in report.checks}
    assert {"firmware", "axes", "receive buffer", "status round trip", "$130 travel of X", "$114 greatest rate of C"} <= told
    assert {"estop_ok", "power_readback", "hopper_level", "fault_word"} <= told
    assert len([check for check in report.checks if check.section == "Axes" and check.verdict == "not checked"]) == 1
    assert report.at >= before and report.facts_sha256 == load_cell(tmp_path / "cell.toml").sha256
    assert is_left_in_peace(witness)


async def test_a_travel_and_a_rate_that_differ_are_named_with_what_to_set(tmp_path: Path) -> None:
    def flash(world: World) -> None:
        world.cnc.settings[130] = 900.0
        world.cnc.settings[114] = 60.0
        world.cnc.settings[10] = 511 - 4
        world.cnc.settings[20] = 0

    report, witness = await examined(tmp_path, prepare=flash)
    found = "\n".join(texts(report))
    assert "$130 travel of X" in found and "set $130=520" in found
    assert "$114 greatest rate of C" in found and "max_velocity = 1" in found
    assert "line numbers" in found and "$20=1" in found
    assert is_left_in_peace(witness)


async def test_swapped_registers_are_named(tmp_path: Path) -> None:
    def swap(facts: dict[str, Any]) -> None:
        one, two = facts["registers"]["power_setpoint_readback"], facts["registers"]["temperature"]
        one["address"], two["address"] = two["address"], one["address"]

    report, witness = await examined(tmp_path, believed={"laser": device_file(tmp_path, "laser_generic", swap)})
    assert any("power_setpoint_readback" in text and "read-back 22 W" in text for text in texts(report))
    assert is_left_in_peace(witness)


async def test_a_silent_device_a_slow_one_and_a_mute_cnc_are_each_named(tmp_path: Path) -> None:
    report, witness = await examined(tmp_path, faults=("modbus_silent feeder", "modbus_slow io 0.09", "serial_silent"))
    found = texts(report)
    assert any(text.startswith("Feeder: generic powder feeder") and "no answer within" in text for text in found)
    assert any(text.startswith("Io: request time") and "too near to the time-out" in text for text in found)
    assert any(text.startswith("CNC: port") and "no answer to ?" in text for text in found)
    assert is_left_in_peace(witness)


async def test_dead_men_are_let_expire_measured_and_left_as_they_were(tmp_path: Path) -> None:
    report, witness = await examined(tmp_path, options=lambda _: Options(let_dead_man_expire=True, **QUICK))
    timers = {check.what.split(":")[0]: check for check in report.checks if check.section == "Dead-man timers"}
    assert (timers["laser"].verdict, timers["feeder"].verdict, timers["io"].verdict) == ("ok", "ok", "not checked"), timers
    assert "heartbeat lost (dead-man)" in timers["laser"].found
    assert is_left_in_peace(witness)


async def test_a_dead_man_that_never_expires_and_one_that_is_slower_than_its_map_are_named(tmp_path: Path) -> None:
    def stick(world: World) -> None:
        world.laser.watches_heartbeat = False

    slow = device_file(tmp_path, "feeder_generic", lambda facts: facts.update(dead_man_s=0.2))
    report, witness = await examined(
        tmp_path, prepare=stick, believed={"feeder": slow}, options=lambda _: Options(let_dead_man_expire=True, **QUICK)
    )
    found = [text for text in texts(report) if text.startswith("Dead-man timers")]
    assert any("laser" in text and "still on" in text and "watchdog" in text for text in found)
    assert any("feeder" in text and "longer than the map says" in text for text in found)
    assert is_left_in_peace(witness)


async def test_a_laser_that_is_enabled_is_refused_its_dead_man_and_nothing_is_written(tmp_path: Path) -> None:
    written: list[str] = []

    def enable(world: World) -> None:
        world.laser.watches_heartbeat = False
        world.laser.values["enable"] = 1.0
        write = world.laser.write
        world.laser.write = lambda name, value: (written.append(name), write(name, value))[1]  # type: ignore[assignment]

    report, witness = await examined(tmp_path, prepare=enable, options=lambda _: Options(let_dead_man_expire=True, **QUICK))
    assert any(check.verdict == "not checked" and "enable is 1" in check.remedy for check in report.checks)
    assert written == [] and not witness.has_emitted


async def test_contacts_are_checked_by_hand_and_a_stuck_door_is_named(tmp_path: Path) -> None:
    def hands(world: World) -> Options:
        deeds = {
            "Press the E-stop": "estop_press", "Release": "estop_release", "Open the door": "door_open", "Close the door": "door_close",
            "Switch the chiller off": "chiller_fail", "Switch the chiller on": "chiller_ok",
        }  # fmt: skip

        async def ask(text: str) -> str | None:
            if "gas" in text:
                return "s"
            if "extraction" in text:
                return None
            world.faults.add(next(fault for words, fault in deeds.items() if text.startswith(words)))
            await asyncio.sleep(0.1)
            return ""

        return Options(ask=ask, **QUICK)

    report, witness = await examined(tmp_path, prepare=lambda world: world.banks["io"].stick("door_closed"), options=hands)
    by_hand = {check.what: check for check in report.checks if check.section == "By hand"}
    assert by_hand["E-stop opened"].verdict == by_hand["E-stop closed again"].verdict == "ok"
    assert by_hand["E-stop at the laser's own interlock"].verdict == by_hand["chiller at the laser's own interlock"].verdict == "ok"
    assert by_hand["door opened"].verdict == "FAULT" and "bridged" in by_hand["door opened"].remedy
    assert (by_hand["gas pressure"].remedy, by_hand["fume extraction"].remedy) == ("skipped by hand", "nobody answers")
    assert is_left_in_peace(witness)


async def test_axes_step_only_after_a_yes(tmp_path: Path) -> None:
    def moves(world: World) -> Options:
        world.cnc.machine.is_homed, world.cnc.machine.alarm = True, 0

        async def ask(text: str) -> str | None:
            return "yes" if " X " in f" {text} " else "s" if "Enter" in text else "no"

        return Options(ask=ask, may_move=True, **QUICK)

    report, witness = await examined(tmp_path, options=moves)
    axes = {check.what[0]: check for check in report.checks if check.section == "Axes"}
    assert axes["X"].verdict == "ok" and "+1.000 mm" in axes["X"].found, axes["X"]
    assert axes["Y"].verdict == "not checked"
    assert witness.has_moved and not witness.has_emitted


async def test_a_port_that_another_program_has_is_refused_in_one_line(tmp_path: Path) -> None:
    from drivers.transport.serial_port import SerialPort

    held: list[SerialPort] = []

    def hold(_: World) -> Options:
        held.append(SerialPort(str(tmp_path / "run" / "cnc"), 115200))
        return Options(**QUICK)

    with pytest.raises(DoctorError, match="in use by another program"):
        try:
            await examined(tmp_path, options=hold)
        finally:
            held[0].close()


def test_page_has_no_script_shows_text_as_text_and_lists_what_was_not_checked() -> None:
    report = Report("cell <script>", "sim", "a.toml", "0" * 64, "1" * 64, "me & you", 0.0)
    report.add("CNC", "firmware", "FAULT", "<b>grbl</b>", "grblHAL", "connect the right machine")
    report.skip("Axes", "X", "nobody said yes")
    page = html_of(report)
    assert "<script" not in page and "<b>grbl" not in page and "&lt;b&gt;grbl" in page
    assert "Not checked" in page and "nobody said yes" in page and "me &amp; you" in page and "1970-01-01" in page
