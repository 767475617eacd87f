"""All drivers of a cell, opened from its cell file, against the simulated cell: pty, Modbus TCP and Modbus RTU."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from config.cell import load_cell
from drivers import CellDrivers, open_cell
from drivers.clock import SystemClock
from drivers.cnc.events import AlarmRaised, AnswerOverdue, CncEvent, LineRejected, ProtocolFault, Welcome
from drivers.errors import DeviceFault
from sim.server import LAG_MAX_S, TICK_S, SimServer
from sim.world import World

CELLS = ["trunnion_tcp", "trunnion_rtu"]
LIMIT_S = 60.0  # until something has come about, on a machine that others use too


@dataclass
class Bench:
    """A simulated cell and the drivers joined to it by its wires."""

    server: SimServer
    drivers: CellDrivers
    events: list[CncEvent]

    @property
    def world(self) -> World:
        return self.server.world

    async def until(self, is_met: Callable[[], bool], timeout_s: float = LIMIT_S) -> None:
        """Pump and poll as a cell does until `is_met`."""
        deadline = time.monotonic() + timeout_s
        polls = [asyncio.ensure_future(self._poll(view)) for view in (self.drivers.laser, self.drivers.feeder, self.drivers.io)]
        try:
            while not is_met():
                assert time.monotonic() < deadline, f"not met; {self.drivers.laser.last_error}, {self.drivers.cnc.status}"
                self.events += self.drivers.cnc.pump()
                await asyncio.sleep(min(0.005, max(0.0005, self.drivers.cnc.due_in_s())))
        finally:
            for poll in polls:
                poll.cancel()
            await asyncio.gather(*polls, return_exceptions=True)

    async def _poll(self, view: object) -> None:
        while True:
            await view.cycle()  # type: ignore[attr-defined]
            await asyncio.sleep(0.01)

    async def ready(self) -> None:
        """Identified, homed, everything connected."""
        await self.drivers.cnc.identify()
        with contextlib.suppress(DeviceFault):
            await self.drivers.cnc.home()
        await self.until(lambda: self.drivers.laser.connected and self.drivers.feeder.connected and self.drivers.io.connected)


@contextlib.asynccontextmanager
async def bench_of(cell: str, run_dir: Path, time_scale: float = 5.0, **cnc: object) -> AsyncIterator[Bench]:
    facts = load_cell(cell)
    facts = facts.model_copy(update={"cnc": facts.cnc.model_copy(update=cnc)})
    links = {role: link.model_copy(update={"tcp_port": 0}) for role, link in facts.links.items()}
    server = SimServer(facts.model_copy(update={"links": links}), run_dir, time_scale=time_scale)
    await server.start()
    running = asyncio.ensure_future(server.run())
    drivers = open_cell(load_cell(server.cell_file), run_dir, SystemClock())
    try:
        yield Bench(server, drivers, [])
    finally:
        await drivers.close()
        server.stop()
        await running
        await server.close()


def lines(count: int) -> list[str]:
    """A zigzag in five axes, inverse time, after the modal words that it needs."""
    head = ["N1 G21 G90 G54", "N2 G93"]
    return head + [f"N{k + 3} G1 X{(k % 2) * 4}. Y{k % 7}. A{k % 3}. C{k % 5}. F600." for k in range(count)]


@pytest.mark.parametrize("cell", CELLS)
async def test_cell_is_identified_and_a_program_is_executed_to_its_end(cell: str, tmp_path: Path) -> None:
    async with bench_of(cell, tmp_path) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        assert cnc.identity is not None and cnc.identity.letters == ("X", "Y", "Z", "A", "C")
        program = lines(60)
        cnc.load(program)
        cnc.release(30)
        await bench.until(lambda: cnc.is_drained)
        assert cnc.counts.executed == 30
        cnc.release(len(program))
        await bench.until(lambda: cnc.is_drained)
        assert (cnc.counts.sent, cnc.counts.acknowledged, cnc.counts.executed) == (62, 62, 62)
        assert not [event for event in bench.events if isinstance(event, (LineRejected, ProtocolFault, AnswerOverdue, AlarmRaised))]
        await bench.until(lambda: cnc.status is not None and cnc.status.work.get("Y") == pytest.approx(59 % 7, abs=1e-3))


@pytest.mark.parametrize("cell", CELLS)
async def test_laser_feeder_and_head_do_at_the_plant_what_is_asked(cell: str, tmp_path: Path) -> None:
    async with bench_of(cell, tmp_path) as bench:
        await bench.ready()
        drivers, world = bench.drivers, bench.world
        drivers.io.deploy_head()
        drivers.feeder.set_rate(8.0)
        drivers.feeder.set_carrier_gas(5.0)
        drivers.laser.set_power(600.0)
        drivers.laser.enable(True)
        await bench.until(lambda: drivers.io.head_deployed and abs(drivers.feeder.rate_readback_g_min - 8.0) < 0.4)
        assert world.io.is_deployed
        assert world.laser.values["power_setpoint"] == pytest.approx(600.0) and world.laser.values["enable"] == 1.0
        assert world.feeder.rate_at_nozzle_g_min == pytest.approx(8.0, abs=1.0)
        drivers.laser.safe()
        drivers.feeder.safe()
        await bench.until(lambda: world.laser.values["power_setpoint"] == 0.0 and world.feeder.values["rate_setpoint"] == 0.0)
        assert world.laser.values["enable"] == 0.0


@pytest.mark.parametrize("cell", CELLS)
async def test_door_estop_and_fault_words_come_through(cell: str, tmp_path: Path) -> None:
    async with bench_of(cell, tmp_path) as bench:
        await bench.ready()
        await bench.until(lambda: bench.drivers.io.door_closed and bench.drivers.io.estop_ok)
        bench.world.open_door()
        await bench.until(lambda: not bench.drivers.io.door_closed)
        await bench.until(lambda: "door interlock open" in bench.drivers.laser.interlocks)
        bench.world.close_door()
        bench.world.faults.add("laser_fault 4")
        await bench.until(lambda: bench.drivers.io.door_closed and "back reflection" in bench.drivers.laser.faults)
        assert bench.drivers.io.estop_ok and bench.drivers.laser.faults == ["back reflection"]


async def test_dead_man_turns_the_laser_off_at_the_plant_when_the_driver_stops_its_cycles(tmp_path: Path) -> None:
    async with bench_of("trunnion_rtu", tmp_path) as bench:  # no gate: the permit alone lets light out
        await bench.ready()
        laser, world = bench.drivers.laser, bench.world
        laser.set_power(500.0)
        laser.enable(True)
        laser.permit(True)
        await bench.until(lambda: world.laser.is_emitting)
        began_s = world.wire_time_s
        async with asyncio.timeout(LIMIT_S):
            while world.laser.is_emitting:
                await asyncio.sleep(0.005)
        assert world.wire_time_s - began_s <= laser.client.device.dead_man_s + LAG_MAX_S + TICK_S
        assert world.laser.emission_w == 0.0 and world.laser.values["emission_permit"] == 0.0
        await bench.until(lambda: any("dead-man" in fault for fault in laser.faults))


@pytest.mark.parametrize(
    ("fault", "word"),
    [
        ("modbus_exception laser 4", "device failure"),
        ("modbus_wrong_count laser", "were asked"),
        ("modbus_silent laser", "no answer within"),
    ],
)
@pytest.mark.parametrize("cell", CELLS)
async def test_modbus_fault_is_one_clear_line_that_names_the_device_and_ends_by_itself(
    cell: str, fault: str, word: str, tmp_path: Path
) -> None:
    async with bench_of(cell, tmp_path) as bench:
        await bench.ready()
        bench.world.faults.add(fault)
        await bench.until(lambda: bench.drivers.laser.last_error is not None and word in bench.drivers.laser.last_error.message)
        error = bench.drivers.laser.last_error
        assert error is not None and error.message.startswith("generic fibre laser: ") and "\n" not in error.message and error.hint
        bench.world.faults.add("modbus_ok laser")
        await bench.until(lambda: bench.drivers.laser.last_error is None and bench.drivers.laser.connected)


async def test_refused_line_holds_and_stops_the_stream_and_a_reset_gives_it_free(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        program = lines(40)
        program[20] = "N21 G5.2 X1. Y1."
        cnc.load(program)
        cnc.release(40)
        await bench.until(lambda: bool(cnc.is_halted))
        rejected = [event for event in bench.events if isinstance(event, LineRejected)]
        assert [event.n for event in rejected] == [21] and rejected[0].code == 20
        await cnc.abort()
        told = bench.events + cnc.pump()
        assert [event.expected for event in told if isinstance(event, Welcome)][-1]
        assert not [event for event in told if isinstance(event, AlarmRaised) and event.code == 3]
        cnc.load(lines(5))
        cnc.release(7)
        await bench.until(lambda: cnc.is_drained)


async def test_controller_that_loses_power_while_streaming_is_told_and_stops_the_stream(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path, time_scale=1.0) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        cnc.load(lines(400))
        cnc.release(402)
        await bench.until(lambda: cnc.counts.executing > 3)
        bench.events.clear()
        bench.world.faults.add("firmware_reset")
        await bench.until(lambda: bool(cnc.is_halted))
        welcome = [event for event in bench.events if isinstance(event, Welcome)]
        assert len(welcome) == 1 and not welcome[0].expected


async def test_line_counts_follow_the_machine_and_not_the_answers(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path, time_scale=1.0) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        cnc.load(lines(300))
        cnc.release(302)
        for _ in range(4):
            last = cnc.status
            await bench.until(lambda: cnc.status is not last and cnc.counts.executing > 0)  # noqa: B023
            counts, truth = cnc.counts, bench.world.cnc.machine.motion.line
            assert counts.executed <= truth <= counts.acknowledged + 1
            assert counts.acknowledged - counts.executed > 5 or counts.sent < 20
            await asyncio.sleep(0.1)
        cnc.hold()
        await bench.until(lambda: cnc.status is not None and cnc.status.is_held)
        cnc.resume()
        await bench.until(lambda: cnc.status is not None and cnc.status.state == "Run")
        cnc.hold()
        await bench.until(lambda: cnc.status is not None and cnc.status.is_held)
        await cnc.soft_reset()


async def test_grbl_is_identified_and_streamed_through_its_small_buffer(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path, firmware="grbl", line_length_max=79) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        assert cnc.identity is not None and cnc.identity.firmware == "grbl" and cnc.identity.window_bytes < 128
        program = lines(80)
        cnc.load(program)
        cnc.release(len(program))
        await bench.until(lambda: cnc.is_drained)
        assert cnc.counts.executed == len(program)
        assert not [event for event in bench.events if isinstance(event, (LineRejected, ProtocolFault, AnswerOverdue))]


@pytest.mark.parametrize("fault", ["lost_ok", "serial_garble"])
async def test_lost_or_damaged_ok_ends_in_an_overdue_answer_and_not_in_waiting_for_ever(fault: str, tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path, answer_timeout_s=2.0) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        cnc.load(lines(30))
        cnc.release(32)
        bench.world.faults.add(fault)
        await bench.until(lambda: any(isinstance(event, AnswerOverdue) for event in bench.events))
        assert not cnc.is_drained and "no answer" in cnc.is_halted
        await cnc.abort()
        cnc.load(lines(3))
        cnc.release(5)
        await bench.until(lambda: cnc.is_drained)


async def test_doubled_ok_is_found_and_stops_the_stream(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        cnc.load(lines(30))
        cnc.release(32)
        bench.world.faults.add("doubled_ok")
        await bench.until(lambda: any(isinstance(event, ProtocolFault) and not event.garbled for event in bench.events))
        assert "to nothing" in cnc.is_halted


async def test_alarm_while_streaming_is_told_with_cause_and_remedy_and_nothing_more_is_sent(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path, time_scale=1.0) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        cnc.load(lines(400))
        cnc.release(402)
        await bench.until(lambda: cnc.counts.executing > 3)
        bench.world.faults.add("alarm 1")
        await bench.until(lambda: any(isinstance(event, AlarmRaised) for event in bench.events))
        alarm = next(event for event in bench.events if isinstance(event, AlarmRaised))
        assert alarm.code == 1 and "limit switch" in alarm.cause and "home" in alarm.remedy
        sent = cnc.counts.sent
        await bench.until(lambda: cnc.status is not None and cnc.status.state == "Alarm")
        assert cnc.counts.sent <= sent + 1 and cnc.is_halted


async def test_silent_serial_line_is_seen_by_the_age_of_the_status(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        bench.world.faults.add("serial_silent")
        await bench.until(lambda: cnc.status is not None and cnc.clock.now() - cnc.status.at > 0.5)
        bench.world.faults.add("serial_ok")
        await bench.until(lambda: cnc.status is not None and cnc.clock.now() - cnc.status.at < 0.2)
        assert cnc.is_connected


async def test_feed_override_is_reported_back_by_the_controller(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        cnc.feed_override(63)
        await bench.until(lambda: cnc.status is not None and cnc.status.overrides[0] != 100)
        assert cnc.status is not None and cnc.status.overrides == (63, 100, 100)


async def test_offsets_settings_and_jog_are_answered(tmp_path: Path) -> None:
    async with bench_of("trunnion_tcp", tmp_path) as bench:
        await bench.ready()
        cnc = bench.drivers.cnc
        assert (await cnc.work_offset())["Z"] == pytest.approx(-420.0)
        assert (await cnc.settings())["32"] == "0"
        assert cnc.status is not None
        before = cnc.status.machine["X"]
        await cnc.jog("X", 5.0, 3000.0)
        await bench.until(lambda: cnc.status is not None and cnc.status.machine["X"] == pytest.approx(before + 5.0, abs=1e-3))
        with pytest.raises(DeviceFault, match="jog would leave the travel"):
            await cnc.jog("X", 5000.0, 3000.0)
